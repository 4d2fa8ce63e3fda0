//! Numbers separated by commas, or none at all.

use std::num::ParseFloatError;
use std::str::FromStr;

use anyhow::Context;
use clap::error::ErrorKind;

/// What stands between two commas: a number, or nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry(Option<f64>);

impl FromStr for Entry {
    type Err = ParseFloatError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.trim() {
            "" => Ok(Self(None)),
            number => number.parse().map(|value| Self(Some(value))),
        }
    }
}

/// The numbers of `--command`; of an empty one none, as robots without tendons take it.
///
/// # Errors
/// For nothing between two commas.
pub(super) fn numbers(entries: &[Entry]) -> anyhow::Result<Vec<f64>> {
    if let [] | [Entry(None)] = entries {
        return Ok(Vec::new());
    }
    let number = |(index, entry): (usize, &Entry)| {
        (entry.0).with_context(|| format!("command entry {index} is empty; expected a number"))
    };
    entries.iter().enumerate().map(number).collect()
}

/// Ends with the parser's message and status for arguments that are missing where a robot of `tendons`
/// tendons gets no command.
pub(super) fn require_command(entries: &[Entry], tendons: usize) {
    if entries.is_empty() && tendons > 0 {
        let message =
            format!("--command is missing; expected a number for each of {tendons} tendons\n");
        clap::Error::raw(ErrorKind::MissingRequiredArgument, message).exit();
    }
}
