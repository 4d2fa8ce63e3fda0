//! Why a rig did not capture what it should.

use std::path::PathBuf;

use tdcr_hw::capture::CaptureError;
use thiserror::Error;

use super::PipelineError;

/// Why a capture stopped.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CaptureStop {
    /// The rig did not do what it should.
    #[error(transparent)]
    Rig(#[from] CaptureError),
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
