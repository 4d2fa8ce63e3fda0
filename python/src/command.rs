//! The command line, as `pip` installs it.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs the command line with arguments, of which the first is the program; returns the exit status. Wrong usage ends the process.
#[pyfunction]
pub fn run_command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| tdcr::cli::run(arguments))
}
