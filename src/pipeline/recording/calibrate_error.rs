//! Why a robot could not be calibrated on a recording.

use std::path::PathBuf;

use tdcr_sim::inverse::recording::RecordingError;
use thiserror::Error;

use super::RecordingFileError;

/// Why a robot could not be calibrated.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// A file that cannot be used.
    #[error(transparent)]
    File(#[from] RecordingFileError),
    /// Servos that never move alone.
    #[error(
        "cannot tell which servo pulls which tendon: {} never moves alone; the recording needs each servo pulled while all others rest",
        columns.join(", ")
    )]
    NeverAlone {
        /// Their columns.
        columns: Vec<String>,
    },
    /// Clouds tell no servos apart.
    #[error(
        "cannot tell which servo pulls which tendon from {}, whose rows are clouds; expected a table of markers",
        path.display()
    )]
    NoMarkers {
        /// The recording.
        path: PathBuf,
    },
    /// A recording of markers beside one of clouds.
    #[error(
        "cannot hold a robot that is calibrated on {} against {}: one has markers, the other clouds",
        data.display(),
        validate.display()
    )]
    OtherKind {
        /// The one.
        data: PathBuf,
        /// The other.
        validate: PathBuf,
    },
    /// The recording says too little, or the robot does not follow it.
    #[error("cannot calibrate on {}: {source}", path.display())]
    Recording {
        /// The recording.
        path: PathBuf,
        /// Why.
        source: RecordingError,
    },
    /// The monitor asked to stop.
    #[error("interrupted")]
    Interrupted,
}
