//! Why a rig did not do what was asked of it.

use std::fmt::Display;
use std::io;
use std::path::{Path, PathBuf};

use tdcr_sim::formats::RobotFileError;
use tdcr_sim::robot::{CommandError, SpecError};
use tdcr_sim::scene::SceneError;
use thiserror::Error;

use super::stop::EmergencyStop;
use crate::camera::CameraError;
use crate::log::LogError;
use crate::servo::{ServoError, ServoId, Ticks};

/// Why a rig did not do what was asked of it.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RigError {
    /// A file could not be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// A file could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// A file is not what it should be.
    #[error("{}: {reason}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Where in the file, and what was expected there.
        reason: String,
    },
    /// A value makes no sense.
    #[error("{}{field} is {found}; expected {expected}", place.as_deref().unwrap_or_default())]
    Field {
        /// File and line.
        place: Option<String>,
        /// The field.
        field: String,
        /// Its value.
        found: String,
        /// What would make sense.
        expected: String,
    },
    /// The robot cannot be read.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// The scene cannot be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The robot makes no sense with the rig's cameras.
    #[error("{}{source}", place.as_deref().unwrap_or_default())]
    Spec {
        /// File and line.
        place: Option<String>,
        /// What is wrong.
        source: SpecError,
    },
    /// The command is of another robot, or out of its range.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// A goal lies beyond a servo's limits.
    #[error(
        "servo {id} would go to {} ticks from home; its limits are {low} to {high}",
        goal.0
    )]
    Limit {
        /// Which servo.
        id: ServoId,
        /// The goal, from home.
        goal: Ticks,
        /// Smallest goal (ticks).
        low: i32,
        /// Largest goal (ticks).
        high: i32,
    },
    /// A servo would be told to go faster than the rig's file allows.
    #[error(
        "servo {id} would go {way} ticks from its last goal at once; motion.slew, {slew} m/s, allows {most}: go there in steps"
    )]
    TooFar {
        /// Which servo.
        id: ServoId,
        /// How far (ticks).
        way: u32,
        /// How far it may (ticks).
        most: u32,
        /// The rig's slew (m/s).
        slew: f64,
    },
    /// A servo did not do what it was told.
    #[error(transparent)]
    Servo(#[from] ServoError),
    /// A camera gave no picture.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// Where servos stand is not known.
    #[error("{}", .0.join("; "))]
    NotHomed(
        /// A line for each servo.
        Vec<String>,
    ),
    /// Where servos stand does not tell where their homes are.
    #[error("{}", .0.join("; "))]
    NotRecalled(
        /// A line for each servo.
        Vec<String>,
    ),
    /// A tendon cannot be tensioned.
    #[error(
        "servo {id} wound by {wound} ticks and pulls with {pull:.3} A, expected {current} A: is its tendon on the spool, and \
         servos.directions right?"
    )]
    Pretension {
        /// Which servo.
        id: ServoId,
        /// How far it wound (ticks).
        wound: i32,
        /// What it pulls with (A).
        pull: f64,
        /// What it should pull with (A).
        current: f64,
    },
    /// A servo winds and lets out in turn, and never pulls as it should.
    #[error(
        "servo {id} wound and let out {reversals} times and did not pull with {current} A within {} %; expected a current above what \
         its gear's friction takes, and steps short enough for it", 100.0 * .tolerance
    )]
    Unsteady {
        /// Which servo.
        id: ServoId,
        /// How often it turned back.
        reversals: usize,
        /// What it should pull with (A).
        current: f64,
        /// Share of that it may be off by.
        tolerance: f64,
    },
    /// Tendons were not tensioned in time.
    #[error("not all tendons were tensioned in time: {}", .0.join("; "))]
    Untensioned(
        /// A line for each servo that is off.
        Vec<String>,
    ),
    /// Goals were given before the motors were switched on.
    #[error("the motors are off: engage the rig first")]
    Released,
    /// Something went wrong in motion, and the tension was released.
    #[error(transparent)]
    Stopped(Box<EmergencyStop>),
    /// The caller asked to stop, and the tension was released.
    #[error("interrupted; the tension was released")]
    Interrupted,
    /// The file names something that cannot be had.
    #[error("{}{field}: {reason}", place.as_deref().unwrap_or_default())]
    Unavailable {
        /// File and line.
        place: Option<String>,
        /// The field that names it.
        field: String,
        /// Why it cannot.
        reason: String,
    },
    /// A log could not be written.
    #[error(transparent)]
    Log(#[from] LogError),
}

impl RigError {
    /// A value that makes no sense.
    pub(super) fn field(
        field: impl Into<String>,
        found: impl Display,
        expected: impl Into<String>,
    ) -> Self {
        Self::Field {
            place: None,
            field: field.into(),
            found: found.to_string(),
            expected: expected.into(),
        }
    }

    /// Something that a field names and that cannot be had.
    pub(super) fn unavailable(field: impl Into<String>, reason: impl Display) -> Self {
        Self::Unavailable {
            place: None,
            field: field.into(),
            reason: reason.to_string(),
        }
    }

    /// The same error of a value in the file `path`, where `line` knows the lines of fields.
    pub(super) fn in_file(self, path: &Path, line: impl Fn(&str) -> Option<usize>) -> Self {
        let at = |field: &str| {
            let line = line(field).map_or(String::new(), |line| format!(":{line}"));
            Some(format!("{}{line}: ", path.display()))
        };
        match self {
            Self::Field {
                field,
                found,
                expected,
                ..
            } => Self::Field {
                place: at(&field),
                field,
                found,
                expected,
            },
            Self::Unavailable { field, reason, .. } => Self::Unavailable {
                place: at(&field),
                field,
                reason,
            },
            Self::Spec { source, .. } => Self::Spec {
                place: match &source {
                    SpecError::Field { field, .. } => at(field),
                    _ => at(""),
                },
                source,
            },
            other => other,
        }
    }
}

impl From<SpecError> for RigError {
    fn from(source: SpecError) -> Self {
        Self::Spec {
            place: None,
            source,
        }
    }
}
