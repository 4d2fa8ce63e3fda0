//! A recording beside what a robot does under its commands.

use tdcr_sim::inverse::recording::{Replay, Residuals};

use super::rows::RecordingFile;

/// A recording, and how far the robot was and is from it.
#[derive(Clone, Debug)]
pub struct Compared {
    /// The recording.
    pub file: RecordingFile,
    /// Residuals of the robot as given.
    pub before: Residuals,
    /// Residuals of the calibrated robot.
    pub after: Residuals,
    /// Where the calibrated robot says that the markers are.
    pub replay: Replay,
}
