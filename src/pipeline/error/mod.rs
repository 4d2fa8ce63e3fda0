//! Why a stage ended before it was done: what all stages share, and an enum for each.
//!
//! The errors say what was found. How a caller goes on, by an option or an argument, the command line and the Python package add
//! in their own words.

mod capture;
mod compare;
mod evaluate;
mod train;

pub use capture::CaptureStop;
pub use compare::CompareError;
pub use evaluate::EvalError;
pub use train::{Divergence, TrainRunError};

use std::path::PathBuf;

use tdcr_hw::capture::CaptureError;
use tdcr_hw::rig::RigError;
use tdcr_learn::data::{DataError, SimulateError};
use tdcr_learn::flow::FlowError;
use tdcr_learn::metrics::MetricError;
use tdcr_learn::predict::PredictError;
use tdcr_learn::prior::SurfaceError;
use tdcr_learn::train::{FileError, TrainError};
use tdcr_sim::robot::SpecError;
use thiserror::Error;

/// Why a stage ended before it was done.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The monitor asked to stop. What was done is kept, and the same call goes on.
    #[error("interrupted")]
    Interrupted,
    /// The monitor asked to stop work that keeps nothing to resume from.
    #[error("interrupted")]
    Abandoned,
    /// The robot was refused.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// The data set could not be read or written.
    #[error(transparent)]
    Data(DataError),
    /// A sample could not be simulated.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// A folder or file of the stage's own could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The folder or file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// Another process works in the folder.
    #[error("{} is being written by another process", path.display())]
    InUse {
        /// The folder.
        path: PathBuf,
    },
    /// A model or training state could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A predictor has no cloud for a command.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// Two clouds cannot be compared.
    #[error(transparent)]
    Metric(#[from] MetricError),
    /// More points are to be compared than there are.
    #[error("{setting} is {found}; expected 1 to {most}, as many points as there are to compare")]
    ComparedPoints {
        /// The field of [`EvalSettings`](super::EvalSettings) or [`CompareSettings`](super::CompareSettings) that asks for them.
        setting: &'static str,
        /// Points asked for.
        found: usize,
        /// Points there are.
        most: usize,
    },
    /// A network was not trained.
    #[error(transparent)]
    Train(#[from] TrainRunError),
    /// A predictor was not scored.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// Two data sets were not compared.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// A rig did not capture what it should.
    #[error(transparent)]
    Capture(#[from] CaptureStop),
}

impl PipelineError {
    /// Whether a monitor asked to stop.
    pub fn is_interruption(&self) -> bool {
        match self {
            Self::Interrupted | Self::Abandoned => true,
            Self::Capture(CaptureStop::Ended { ended, .. }) => ended.is_interruption(),
            _ => false,
        }
    }
}

impl From<DataError> for PipelineError {
    fn from(error: DataError) -> Self {
        match error {
            DataError::Interrupted => Self::Interrupted,
            error => Self::Data(error),
        }
    }
}

impl From<CaptureError> for PipelineError {
    fn from(error: CaptureError) -> Self {
        match error {
            CaptureError::Rig(RigError::Interrupted) => Self::Interrupted,
            error => Self::Capture(error.into()),
        }
    }
}

impl From<TrainError> for PipelineError {
    fn from(error: TrainError) -> Self {
        Self::Train(error.into())
    }
}

impl From<SurfaceError> for PipelineError {
    fn from(error: SurfaceError) -> Self {
        Self::Train(error.into())
    }
}

impl From<FlowError> for PipelineError {
    fn from(error: FlowError) -> Self {
        Self::Train(error.into())
    }
}
