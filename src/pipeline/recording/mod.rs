//! Recordings of robots as files: tables of numbers, the maps of their columns, data sets and logs of clouds, and robots
//! [calibrated](calibrate()) on them.

mod calibrate;
mod calibrate_error;
mod clouds;
mod column_corrections;
mod columns;
mod compared;
mod fitted;
mod markers;
mod priors;
mod reader;
mod repeat;
mod rotation;
mod rows;
mod servo_column;
mod servos;
mod wild;

pub use calibrate::{CalibrateSettings, Calibrated, Calibration, Measured, calibrate};
pub use calibrate_error::CalibrateError;
pub use column_corrections::MovedFrame;
pub use columns::{Columns, FramePose, TimeColumn, TimeUnit};
pub use compared::Compared;
pub use fitted::Fitted;
pub use markers::{DiscName, MarkerColumns};
pub use priors::GivenPriors;
pub use rows::{BadRows, RecordingFile};
pub use servo_column::{PullUnit, ServoColumn};
pub use servos::{FoundServo, FoundServos};

use std::path::PathBuf;

use tdcr_hw::recorded::RecordedError;
use tdcr_learn::data::DataError;
use thiserror::Error;

/// Most rows of a recording: each is settled in every iteration of a fit.
const MOST_ROWS: usize = 100_000;

/// Lines that a message names at most.
const NAMED: usize = 5;

/// A row that cannot be used.
#[derive(Clone, Debug, PartialEq)]
pub struct BadRow {
    /// Its line in the file, from 1; of a cloud the number of its sample, from 0.
    pub line: usize,
    /// What is wrong with it.
    pub reason: String,
}

/// Why a recording could not be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RecordingFileError {
    /// The file could not be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The column map is not one of the robot's.
    #[error("{}: {reason}", path.display())]
    Columns {
        /// The map's file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Priors that are of no unknown, or that it cannot have.
    #[error("{}: {reason}", path.display())]
    Priors {
        /// The priors' file.
        path: PathBuf,
        /// What is wrong with them.
        reason: String,
    },
    /// A column that the map names is not there.
    #[error("{} has no column `{column}`; its columns are {found}", path.display())]
    NoColumn {
        /// The table's file.
        path: PathBuf,
        /// The column.
        column: String,
        /// The columns that are there.
        found: String,
    },
    /// There are no rows.
    #[error("{} has no rows; expected a line with the columns' names and one for each moment", path.display())]
    Empty {
        /// The table's file.
        path: PathBuf,
    },
    /// A data set that cannot be used.
    #[error(transparent)]
    DataSet(#[from] DataError),
    /// A log that cannot be used.
    #[error(transparent)]
    Log(#[from] RecordedError),
    /// A log without clouds.
    #[error("{} has no cloud after a command; expected the log of a capture", path.display())]
    NoClouds {
        /// The log.
        path: PathBuf,
    },
    /// Commands of another robot.
    #[error("{} has commands of {found} tendons; the robot has {tendons}", path.display())]
    Commands {
        /// The data set or log.
        path: PathBuf,
        /// Values of a command there.
        found: usize,
        /// Tendons of the robot.
        tendons: usize,
    },
    /// A column that the map names is there more than once.
    #[error("{} has {count} columns `{column}`; expected one", path.display())]
    SameColumn {
        /// The table's file.
        path: PathBuf,
        /// The column.
        column: String,
        /// How many there are.
        count: usize,
    },
    /// More rows than a robot is calibrated on.
    #[error(
        "{} has {found} rows; expected at most {MOST_ROWS}: keep one of {} rows, which tells as much where they are that close",
        path.display(), found.div_ceil(MOST_ROWS)
    )]
    TooManyRows {
        /// The table's file, or the folder of the data set.
        path: PathBuf,
        /// Its rows.
        found: usize,
    },
    /// Rows that cannot be used.
    #[error("{}", bad_rows(path, rows))]
    BadRows {
        /// The table's file.
        path: PathBuf,
        /// The rows.
        rows: Vec<BadRow>,
    },
}

fn bad_rows(path: &std::path::Path, rows: &[BadRow]) -> String {
    let named = rows
        .iter()
        .take(NAMED)
        .map(|bad| format!("\n  line {}: {}", bad.line, bad.reason));
    let more = match rows.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!("\n  and {more} more"),
    };
    let named: String = named.collect();
    format!(
        "{} has {}:{named}{more}",
        path.display(),
        bad_row_count(rows.len())
    )
}

/// So many bad rows, in words.
fn bad_row_count(rows: usize) -> String {
    match rows {
        1 => "1 bad row".to_owned(),
        rows => format!("{rows} bad rows"),
    }
}
