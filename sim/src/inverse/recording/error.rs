//! Why a robot could not be calibrated on a recording.

use thiserror::Error;

use super::Group;
use crate::inverse::PriorError;
use crate::robot::SpecError;

/// Why a robot could not be calibrated on a recording.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum RecordingError {
    /// The robot is not valid.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// A list of another length than the robot or the recording asks for.
    #[error("{what}: found {found}, expected {expected}")]
    Count {
        /// What the list is of.
        what: String,
        /// Its length.
        found: usize,
        /// The length asked for.
        expected: usize,
    },
    /// A number that is not finite, or times that do not ascend.
    #[error("row {row} of the recording: {reason}")]
    Row {
        /// The row, from 0.
        row: usize,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// A marker on a disc that the robot does not have.
    #[error("marker {marker} is on disc {disc}; the robot has discs 0 to {last}")]
    Marker {
        /// The marker, from 0.
        marker: usize,
        /// Its disc.
        disc: usize,
        /// The robot's last disc.
        last: usize,
    },
    /// Unknowns that the robot does not have.
    #[error("cannot fit {group}: {reason}")]
    Group {
        /// The group.
        group: Group,
        /// Why.
        reason: &'static str,
    },
    /// A prior of no unknown, or one that its unknown cannot have.
    #[error(transparent)]
    Prior(#[from] PriorError),
    /// Fewer measured coordinates than unknowns.
    #[error(
        "{coordinates} measured coordinates cannot tell {unknowns} unknowns; expected more of them than unknowns"
    )]
    TooFew {
        /// Coordinates measured.
        coordinates: usize,
        /// Unknowns asked for.
        unknowns: usize,
    },
    /// Servos that never move alone, whose tendons cannot be told so.
    #[error(
        "servos {} never move alone; to find which tendons they pull, the recording needs each of them pulled while all others rest",
        numbers(servos)
    )]
    NeverAlone {
        /// Their numbers in the recording, from 0.
        servos: Vec<usize>,
    },
    /// The robot settles under hardly any row.
    #[error(
        "the robot settles in {settled} of {rows} rows; expected at least half. Are the commands in the right unit, and do they pull the tendons that the robot file says?"
    )]
    Unsettled {
        /// Rows in which it settles.
        settled: usize,
        /// All rows.
        rows: usize,
    },
    /// The watcher asked to stop.
    #[error("interrupted")]
    Interrupted,
}

fn numbers(servos: &[usize]) -> String {
    let numbers: Vec<String> = servos.iter().map(usize::to_string).collect();
    numbers.join(", ")
}
