//! The `tdcr` command line.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(tdcr::cli::run(std::env::args_os().collect()))
}
