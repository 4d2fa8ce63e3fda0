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
    /// A servo does not come to its goal, or left it.
    #[error(
        "servo {id} stands at {position} ticks from home, {} from its goal of {goal}, after {} s; motion.arrived is {limit}: does its \
         tendon jam, or is motion.patience short? What it stands off under a tension, a larger Position P Gain makes less",
        (goal - position).abs(), waited.as_secs()
    )]
    OffGoal {
        /// Address of the servo.
        id: u8,
        /// Its goal (ticks from home).
        goal: i32,
        /// Where it stands (ticks from home).
        position: i32,
        /// How far from it that may be (ticks).
        limit: i32,
        /// How long one waited.
        waited: Duration,
    },
    /// A tendon pulls with another tension than its command.
    #[error(
        "servo {id} takes {pull:.3} A under command {index}, in which the simulated tension of {tension:.1} N would take {expected:.3} A: \
         has {}? Samples since the last look at home are not to be trusted",
        if pull < expected {
            "its tendon snapped, jammed, or left its spool, or does the robot lean on something"
        } else {
            "its tendon jammed, or one that it pulls against, or does the robot lean on something"
        }
    )]
    Pull {
        /// Which command.
        index: u64,
        /// Address of the servo.
        id: u8,
        /// Its current (A).
        pull: f64,
        /// What the tension takes, by what the servo took at home (A).
        expected: f64,
        /// The simulated tension (N).
        tension: f64,
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
