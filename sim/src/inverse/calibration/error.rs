//! Why there is no calibration.

use thiserror::Error;

use crate::inverse::PriorError;
use crate::robot::{CommandError, LoadsError, ParameterError, SpecError};

/// Why there is no calibration.
#[non_exhaustive]
#[derive(Debug, Error)]
pub enum CalibrationError {
    /// Not as many measured coordinates and priors as unknowns and one.
    #[error("{}; {unknowns} unknowns take {} at least", known(*coordinates, *priors), unknowns + 1)]
    TooFew {
        /// Measured coordinates.
        coordinates: usize,
        /// Priors that have a spread.
        priors: usize,
        /// Unknowns.
        unknowns: usize,
    },
    /// No unknown, or one without parameters.
    #[error(
        "there is nothing to find: expected one unknown or more, each of one parameter or more"
    )]
    NoUnknown,
    /// Unknowns that are not independent.
    #[error("the unknowns `{0}` and `{1}` set the same thing; give it once")]
    Overlap(String, String),
    /// A prior of no unknown, or one that its unknown cannot have.
    #[error(transparent)]
    Prior(#[from] PriorError),
    /// Errors of measurement of no size.
    #[error(
        "error is {0}; expected a finite number above 0, the standard deviation of a measured coordinate (m)"
    )]
    Error(f64),
    /// A parameter that the robot does not have.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// A robot to start from that is not valid.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// A command of another robot.
    #[error("observation {index}: {source}")]
    Command {
        /// The observation, from 0.
        index: usize,
        /// What is wrong.
        source: CommandError,
    },
    /// Loads of another robot.
    #[error("observation {index}: {source}")]
    Loads {
        /// The observation, from 0.
        index: usize,
        /// What is wrong.
        source: LoadsError,
    },
    /// A measurement of no disc, or not of finite numbers.
    #[error(
        "observation {index} measures disc {disc} at {position:?} m; expected a disc below {discs} and finite numbers"
    )]
    Measurement {
        /// The observation, from 0.
        index: usize,
        /// The disc.
        disc: usize,
        /// Number of discs.
        discs: usize,
        /// Where it was measured (m).
        position: [f64; 3],
    },
    /// The robot does not settle stably with the first values.
    #[error(
        "the robot that the calibration starts from does not settle stably under observation {0}"
    )]
    Unsettled(usize),
}

fn known(coordinates: usize, priors: usize) -> String {
    match priors {
        0 => format!("{coordinates} coordinates are measured"),
        _ => format!("{coordinates} coordinates are measured (priors with a spread: {priors})"),
    }
}
