//! Why captures end early.

use std::time::Duration;

use thiserror::Error;

use crate::mask::MaskError;
use crate::plan::PlanError;
use crate::rig::RigError;

/// Why a capture ended.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CaptureError {
    /// The rig did not do what it should.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The robot cannot be told from what else is in a picture.
    #[error(transparent)]
    Mask(#[from] MaskError),
    /// There is no command, or no way to it.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// No camera saw the robot.
    #[error("no camera sees the robot under command {index}: are the masks right?")]
    NotSeen {
        /// Which command.
        index: u64,
    },
    /// No camera saw the robot at home.
    #[error("no camera sees the robot at home: are the masks right?")]
    NotSeenAtHome,
    /// The robot at home is not where it was.
    #[error(
        "the robot at home is seen {:.1} mm from where it was at first; safety.drift is {:.1} mm: has a tendon snapped or slipped, \
         or a camera moved? Samples since the last look are not to be trusted",
        1e3 * drift, 1e3 * limit
    )]
    Drift {
        /// Distance of what is seen from where it was (m).
        drift: f64,
        /// What it may be (m).
        limit: f64,
    },
    /// A tendon does not pull.
    #[error(
        "servo {id} takes {pull:.3} A where all tendons share one tension, and the median of the servos {expected:.3} A: has its tendon \
         snapped, or left its spool? Samples since the last look, if there are any, are not to be trusted"
    )]
    Slack {
        /// Address of the servo.
        id: u8,
        /// Its current (A).
        pull: f64,
        /// The median of all (A).
        expected: f64,
    },
    /// Servos stay hot.
    #[error(
        "servo {id} is still at {temperature} degrees Celsius after {} s of rest; safety.resume_below is {limit}",
        waited.as_secs()
    )]
    Hot {
        /// Address of the servo.
        id: u8,
        /// Its temperature (degrees Celsius).
        temperature: f64,
        /// What it should come to (degrees Celsius).
        limit: f64,
        /// How long one waited.
        waited: Duration,
    },
}
