//! The stages of a study, from commands to scores, as library calls that the command line wraps.
//!
//! [`collect`] makes a data set, [`train`] a network, an [`Evaluator`] scores it. Each tells a
//! [`Monitor`] how far it is and stops when the monitor says so, leaving files from which the same
//! call takes up the work.

mod collect;
mod evaluate;
mod journal;
mod monitor;
mod train;

pub use collect::{CollectSettings, collect};
pub use evaluate::{Distances, EvalSettings, Evaluation, Evaluator, Scores};
pub use monitor::{Monitor, Silent};
pub use train::{NetworkSize, Trained, model_path, train};

use std::path::PathBuf;

use tdcr_learn::data::DataError;
use tdcr_learn::metrics::MetricError;
use tdcr_learn::train::{FileError, PredictError, TrainError};
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
    #[error("the robot did not settle under command {command:?} m: residual {residual:e} N m")]
    NotSettled {
        /// Largest gradient component (N m).
        residual: f64,
        /// The command (m).
        command: Vec<f64>,
    },
    /// A folder or file of the stage's own could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Folder {
        /// The folder or file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// Training cannot start, or diverged.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// The folder holds a run with other settings or data.
    #[error("{} cannot be taken up: {source}; choose another folder, or remove this one", path.display())]
    OtherRun {
        /// The state's file.
        path: PathBuf,
        /// What differs.
        source: TrainError,
    },
    /// A model or training state could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The model cannot predict for a command.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// Two clouds cannot be compared.
    #[error(transparent)]
    Metric(#[from] MetricError),
    /// The model and the data set are of different robots.
    #[error("the model is of robot `{model}`, the data set of a different robot, `{data}`")]
    OtherRobot {
        /// Name of the model's robot.
        model: String,
        /// Name of the data set's robot.
        data: String,
    },
    /// More points are to be compared than there are.
    #[error("{wanted} points are to be compared; expected 1 to {available}, as many as there are")]
    EvalPoints {
        /// Points asked for.
        wanted: usize,
        /// Points there are.
        available: usize,
    },
}
