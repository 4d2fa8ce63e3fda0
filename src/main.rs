//! The `tdcr` command line.
fn main() {}
