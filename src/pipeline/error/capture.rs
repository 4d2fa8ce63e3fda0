//! Why a rig did not capture what it should.

use std::path::PathBuf;

use tdcr_hw::capture::CaptureError;
use tdcr_hw::plan::PlanError;
use thiserror::Error;

use super::PipelineError;

/// Why a capture stopped.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CaptureStop {
    /// The rig did not do what it should.
    #[error(transparent)]
    Rig(#[from] CaptureError),
    /// A command that was given is none that the robot survives. Nothing has moved.
    #[error("command {row} of those given: {error}")]
    Given {
        /// Which, from 0.
        row: usize,
        /// What is wrong with it.
        error: PlanError,
    },
    /// It ended early. What was captured is kept, and the same call goes on.
    #[error("{ended}; {kept} of {count} samples are kept in {}", path.display())]
    Ended {
        /// Why.
        ended: Box<PipelineError>,
        /// Samples that are in the folder, those of earlier runs too.
        kept: usize,
        /// Samples that are wanted.
        count: usize,
        /// Folder of the data set.
        path: PathBuf,
    },
}
