//! Whatever stands in a file: an answer, in memory and time that the file warrants, never a panic.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod bus;
mod cases;
mod files;
mod learned;
mod marks;
mod readers;
mod tables;

use std::path::Path;
use std::time::Instant;

use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, TestRunner};

use readers::{READERS, Reader};

/// Most memory that a reader may hold at once for `length` bytes: a few copies of what the limit lets a file ask for.
fn most_memory(length: usize) -> u64 {
    (400 << 20) + 256 * length as u64
}

/// Longest time that a reader may take (s): an unoptimised build on a busy machine takes a tenth of it.
const MOST_SECONDS: f64 = 30.0;

/// Has a reader read `bytes`; says what it took too much of.
fn read((name, reader): Reader, bytes: &[u8]) -> Result<(), String> {
    let began = Instant::now();
    let held = allocation_counter::measure(|| reader(bytes)).bytes_max;
    let seconds = began.elapsed().as_secs_f64();
    let length = bytes.len();
    if held > most_memory(length) {
        return Err(format!("{name}: {length} bytes took {held} of memory"));
    }
    if seconds > MOST_SECONDS {
        return Err(format!("{name}: {length} bytes took {seconds} s"));
    }
    Ok(())
}

/// Writes the sound files as the corpora that fuzzing starts from, where WRITE_CORPUS names a folder.
#[test]
fn corpus() {
    let Some(dir) = std::env::var_os("WRITE_CORPUS") else {
        return;
    };
    for (name, _) in READERS {
        let dir = Path::new(&dir).join(name);
        std::fs::create_dir_all(&dir).unwrap();
        for (case, bytes) in cases::sound(name) {
            std::fs::write(dir.join(case), bytes).unwrap();
        }
    }
}

/// Files that ask for more than they hold get an answer.
fn check_hostile(reader: Reader) {
    for (case, bytes) in cases::hostile(reader.0) {
        read(reader, &bytes).unwrap_or_else(|problem| panic!("{case}: {problem}"));
    }
}

/// A change of a file. Places are shares of its length.
#[derive(Clone, Debug)]
enum Damage {
    Byte(Index, u8),
    Remove(Index, usize),
    Insert(Index, &'static [u8]),
    Repeat(Index, usize, usize),
    Truncate(Index),
}

/// Words that mean something to one reader or another.
const WORDS: [&[u8]; 22] = [
    b"0",
    b"-1",
    b"1e308",
    b"nan",
    b"inf",
    b"18446744073709551615",
    b"4294967295",
    b"1e-320",
    b"[",
    b"]",
    b"{",
    b"}",
    b"\"",
    b"\n",
    b",",
    b"<",
    b"/>",
    b"null",
    b"\xff\xff\xff\xff",
    b"\0\0\0\0\0\0\0\0",
    b"\xff\xff\xff\xff\xff\xff\xff\x7f",
    b"\x80",
];

fn damage() -> impl Strategy<Value = Damage> {
    let place = any::<Index>;
    prop_oneof![
        4 => (place(), any::<u8>()).prop_map(|(place, byte)| Damage::Byte(place, byte)),
        2 => (place(), 1..40_usize).prop_map(|(place, length)| Damage::Remove(place, length)),
        4 => (place(), prop::sample::select(&WORDS[..])).prop_map(|(place, word)| Damage::Insert(place, word)),
        1 => (place(), 1..40_usize, 1..200_usize).prop_map(|(place, length, times)| Damage::Repeat(place, length, times)),
        1 => place().prop_map(Damage::Truncate),
    ]
}

impl Damage {
    fn on(&self, bytes: &mut Vec<u8>) {
        let at = |place: &Index| place.index(bytes.len() + 1);
        let end = |start: usize, length: usize| bytes.len().min(start + length);
        match self {
            Self::Byte(place, byte) => {
                let start = at(place);
                let end = end(start, 1);
                bytes.splice(start..end, [*byte]);
            }
            Self::Remove(place, length) => {
                let start = at(place);
                let end = end(start, *length);
                bytes.drain(start..end);
            }
            Self::Insert(place, word) => {
                let start = at(place);
                bytes.splice(start..start, word.iter().copied());
            }
            Self::Repeat(place, length, times) => {
                let start = at(place);
                let end = end(start, *length);
                let part = bytes[start..end].repeat(*times);
                bytes.splice(start..start, part);
            }
            Self::Truncate(place) => {
                let length = at(place);
                bytes.truncate(length);
            }
        }
    }
}

/// Sound files and damaged ones get an answer.
fn check_damaged(reader: Reader) {
    let sound = cases::sound(reader.0);
    assert!(!sound.is_empty(), "{} has no file to damage", reader.0);
    for (_, bytes) in &sound {
        read(reader, bytes).unwrap();
    }
    let mut runner = TestRunner::new(Config {
        cases: 300,
        source_file: Some(file!()),
        ..Config::default()
    });
    let damaged = (0..sound.len(), prop::collection::vec(damage(), 1..6));
    let result = runner.run(&damaged, |(file, damages)| {
        let mut bytes = sound[file].1.clone();
        damages.iter().for_each(|damage| damage.on(&mut bytes));
        read(reader, &bytes).map_err(TestCaseError::fail)
    });
    result.unwrap_or_else(|error| panic!("{}: {error}", reader.0));
}

/// The tests of each reader, by its name.
macro_rules! tests_of {
    ($($name:ident)*) => {
        $(mod $name {
            #[test]
            fn files_that_ask_for_more_than_they_hold_get_an_answer() {
                crate::check_hostile((stringify!($name), crate::readers::$name));
            }

            #[test]
            fn damaged_files_get_an_answer() {
                crate::check_damaged((stringify!($name), crate::readers::$name));
            }
        })*

        /// All of them.
        const NAMES: &[&str] = &[$(stringify!($name)),*];
    };
}

tests_of!(
    robot_toml robot_json mjcf urdf stl meta part motor_ranges point_scale shard npy npz pcd ply motors split_file
    model training_state journal commands servo_frames servo_answers rig_log columns priors
    recording predictions study_file rig_file scene_file
);

/// A reader is tested, and has a fuzz target.
#[test]
fn every_reader_is_tested_and_fuzzed() {
    assert_eq!(READERS.map(|(name, _)| name), NAMES);
    for name in NAMES {
        let target = concat!(env!("CARGO_MANIFEST_DIR"), "/fuzz/fuzz_targets");
        let text = std::fs::read_to_string(format!("{target}/{name}.rs")).unwrap();
        assert!(text.contains(&format!("readers::{name}(bytes)")), "{name}");
    }
}
