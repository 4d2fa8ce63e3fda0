//! Why there is no search.

use thiserror::Error;

use super::{Press, Target};
use crate::contact::ContactError;
use crate::robot::{CommandError, LoadsError};

/// Why there is nothing to search for, or nothing to start from.
#[non_exhaustive]
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ShapeControlError {
    /// Neither a target nor a force.
    #[error("no target is given; expected at least one")]
    NoTarget,
    /// A target that makes no sense.
    #[error("target {index} is {target:?}: {reason}")]
    Target {
        /// Its place in the list, from 0.
        index: usize,
        /// The target.
        target: Target,
        /// What would be right.
        reason: &'static str,
    },
    /// A force that makes no sense.
    #[error("press {index}, {} N on obstacle {}: {reason}", press.force, press.obstacle)]
    Press {
        /// Its place in the list, from 0.
        index: usize,
        /// The force asked for.
        press: Press,
        /// What would be right.
        reason: &'static str,
    },
    /// A clearance that is no distance.
    #[error("the clearance is {0} m; expected a finite distance of at least 0")]
    Clearance(f64),
    /// A clearance without obstacles.
    #[error("a clearance is asked for, but there are no obstacles; expected a scene that has some")]
    NoObstacle,
    /// A tolerance that is no length.
    #[error("the tolerance is {0} m; expected a finite length above 0")]
    Tolerance(f64),
    /// Loads of another robot.
    #[error(transparent)]
    Loads(#[from] LoadsError),
    /// A command of another robot.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// Among the obstacles there is nothing to settle.
    #[error(transparent)]
    Contact(#[from] ContactError),
    /// No equilibrium to start from.
    #[error("the robot settles stably under none of the {0} commands tried")]
    Unsettled(usize),
}
