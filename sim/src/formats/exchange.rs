//! What the formats of other tools have in common: what an import returns, and why one is refused.

use std::fmt;
use std::path::PathBuf;

use thiserror::Error;

use crate::contact::ContactError;
use crate::dynamics::DynamicsError;
use crate::robot::{CommandError, LoadsError, Payload, RobotSpec, SpecError};

/// A robot read from a file of another tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// The robot.
    pub spec: RobotSpec,
    /// What hangs from its distal disc.
    pub payload: Payload,
    /// What the file says besides, and was passed over.
    pub notes: Vec<Note>,
}

/// Something in a file that a robot's specification has no place for, and that changes neither how
/// the robot moves nor where it rests.
#[derive(Clone, Debug, PartialEq)]
pub struct Note {
    /// Where it stands.
    pub place: Place,
    /// What was passed over, or done instead.
    pub text: String,
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place, self.text)
    }
}

/// An element of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file; `None` for a text that came from none.
    pub file: Option<PathBuf>,
    /// Line, counted from 1; `None` where the reader of the format does not tell it.
    pub line: Option<u32>,
    /// The element's tag and, where it has one, its name.
    pub element: String,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}, ", file.display())?;
        }
        if let Some(line) = self.line {
            write!(f, "line {line}, ")?;
        }
        f.write_str(&self.element)
    }
}

/// The first number below zero.
pub(crate) fn negative(numbers: &[f64]) -> Option<f64> {
    numbers.iter().copied().find(|number| *number < 0.0)
}

/// Share of a moment of inertia that is rounding.
const ROUNDING: f64 = 1e-9;

/// Refuses moments of inertia about principal axes (kg m²) that no body has: each is 0 or above, and at most the sum of the
/// others (Goldstein, Classical Mechanics, ch. 5).
pub(crate) fn is_inertia(moments: [f64; 3]) -> Result<(), String> {
    if let Some(moment) = negative(&moments) {
        return Err(format!(
            "a moment of inertia is {moment}; expected 0 or above"
        ));
    }
    let (sum, largest) = (
        moments.iter().sum::<f64>(),
        moments.into_iter().fold(0.0, f64::max),
    );
    if largest > (sum - largest) * (1.0 + ROUNDING) {
        let [a, b, c] = moments;
        return Err(format!(
            "the moments of inertia are {a}, {b}, {c}; expected none above the sum of the others"
        ));
    }
    Ok(())
}

/// Why a file of another tool was not read as a robot.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum ImportError {
    /// The file, or one that it includes, could not be read.
    #[error("cannot read robot file {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The text is not well-formed, or not of this format.
    #[error("{what} is not {format}: {reason}")]
    Syntax {
        /// The file, or "the text".
        what: String,
        /// The format.
        format: &'static str,
        /// Where, and what was expected there.
        reason: String,
    },
    /// Something that a robot of this library cannot have.
    #[error("{place}: {reason}")]
    Unsupported {
        /// Where it stands.
        place: Place,
        /// What is not possible, and what would be.
        reason: String,
    },
    /// The robot as read is not valid.
    #[error(transparent)]
    Robot(#[from] Box<SpecError>),
}

/// Why a robot cannot be written in a format of another tool.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum ExportError {
    /// A field that the format cannot represent with the same meaning.
    #[error("robot field `{field}` is {value}; {format} takes {expected}")]
    Unsupported {
        /// The format.
        format: &'static str,
        /// The field's path, e.g. `modules[1].limit`.
        field: String,
        /// Its value.
        value: String,
        /// What the format can represent.
        expected: &'static str,
    },
    /// A time step that is not stable.
    #[error(
        "a time step of {timestep} s is not stable: with MuJoCo's {integrator}, errors grow about the \
         settled pose unless it is below {longest:.2e} s; expected a shorter step, softer springs and \
         tendons, or more armature"
    )]
    Unstable {
        /// MuJoCo's name of the integrator.
        integrator: &'static str,
        /// The time step (s).
        timestep: f64,
        /// The longest that is stable (s).
        longest: f64,
    },
    /// A prefix that names cannot have.
    #[error(
        "the prefix {prefix:?} has the character {character:?}; expected no spaces, and characters that XML can hold"
    )]
    Prefix {
        /// The prefix.
        prefix: String,
        /// What it may not have.
        character: char,
    },
    /// The robot does not come to rest under the keyframe's command.
    #[error(
        "the robot does not settle under the keyframe's command: residual {residual:.1e} N m; expected \
         another command, or none"
    )]
    NotSettled {
        /// Largest moment left on a joint (N m).
        residual: f64,
    },
    /// The keyframe's command is not of this robot.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// The robot cannot move, or the time step is no positive number.
    #[error(transparent)]
    Motion(#[from] DynamicsError),
    /// The robot cannot settle among the obstacles.
    #[error(transparent)]
    Contact(#[from] ContactError),
    /// The payload is not valid.
    #[error(transparent)]
    Payload(#[from] LoadsError),
    /// The specification is not valid.
    #[error(transparent)]
    Robot(#[from] SpecError),
}
