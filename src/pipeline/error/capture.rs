//! Why a rig did not capture what it should.

use std::path::PathBuf;

use tdcr_hw::capture::CaptureError;
use tdcr_hw::plan::PlanError;
use tdcr_sim::robot::LoadsError;
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
    #[error("command {row} of those given{}: {error}", payload.map_or(String::new(), |mass| format!(", under {mass} kg")))]
    Given {
        /// Which, from 0.
        row: usize,
        /// What hangs at the tip meanwhile (kg), where something may.
        payload: Option<f64>,
        /// What is wrong with it.
        error: PlanError,
    },
    /// Payloads of which no data set can be made.
    #[error("payloads are {found}; expected each once, and one at least above 0 kg")]
    Payloads {
        /// What is wrong with them.
        found: String,
    },
    /// A payload is none.
    #[error(transparent)]
    Loads(#[from] LoadsError),
    /// Nobody hung a payload at the tip. The rig is released.
    #[error("nobody says that {payload} kg hang at the tip")]
    NotHung {
        /// Payload (kg).
        payload: f64,
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
