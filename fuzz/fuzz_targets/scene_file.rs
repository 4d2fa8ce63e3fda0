#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| tdcr_fuzz::readers::scene_file(bytes));
