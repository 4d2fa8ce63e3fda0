//! The stages of a study, from commands to scores, as library calls that the command line wraps.
//!
//! [`collect`] makes a data set, [`train`] a network, [`evaluate`] scores it. Each tells a
//! [`Monitor`] how far it is and stops when the monitor says so, leaving files from which the same
//! call takes up the work.

mod collect;
mod monitor;

pub use collect::{CollectSettings, collect};
pub use monitor::{Monitor, Silent};

use tdcr_learn::data::DataError;
use tdcr_sim::robot::{CommandError, SpecError};
use thiserror::Error;

/// Why a stage ended before it was done.
#[derive(Debug, Error)]
pub enum PipelineError {
    /// The monitor asked to stop. What was done is kept.
    #[error("interrupted; run the same command again to go on")]
    Interrupted,
    /// The robot was refused.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// A command does not fit the robot.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// The data set could not be read or written.
    #[error(transparent)]
    Data(#[from] DataError),
    /// A robot did not settle.
    #[error("sample {index} did not settle: residual {residual:e} N m under command {command:?}")]
    NotSettled {
        /// Index of the sample.
        index: usize,
        /// Largest gradient component (N m).
        residual: f64,
        /// The command (m).
        command: Vec<f64>,
    },
}
