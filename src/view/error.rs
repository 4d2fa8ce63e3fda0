//! Why a page's request changes nothing.

use tdcr_learn::data::DataError;
use tdcr_sim::contact::ContactError;
use tdcr_sim::formats::RobotFileError;
use tdcr_sim::robot::{CommandError, LoadsError, SpecError};
use tdcr_sim::simulation::SimulationError;
use thiserror::Error;

use super::twin::TwinError;
use crate::study::RowError;

/// Why a request changes nothing.
#[derive(Debug, Error)]
pub enum RequestError {
    /// A command that the robot cannot take.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// Loads that it cannot take.
    #[error(transparent)]
    Loads(#[from] LoadsError),
    /// Nothing to settle among the obstacles.
    #[error(transparent)]
    Contact(#[from] ContactError),
    /// A motion that cannot be computed.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// There is none of what is asked for.
    #[error("there is no {0} to show here")]
    Nothing(&'static str),
    /// The robot is where a rig's servos are.
    #[error("the robot that is shown is the rig's: arm the rig, and bend it by its modules")]
    OfRig,
    /// A split that a data set does not have.
    #[error("split is {0:?}; expected train, val or test")]
    Split(String),
    /// A sample that cannot be read.
    #[error(transparent)]
    Sample(#[from] DataError),
    /// A row that cannot be shown.
    #[error(transparent)]
    Row(#[from] RowError),
    /// A robot that the network is not of.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// A text that is no robot.
    #[error(transparent)]
    File(#[from] RobotFileError),
    /// A robot that is not valid.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// A disc that the robot does not have.
    #[error("the robot has {discs} discs, from 0; disc {disc} is asked for")]
    Disc {
        /// The disc.
        disc: usize,
        /// Number of discs.
        discs: usize,
    },
    /// A place that is none.
    #[error("the place is {0:?}; expected finite numbers (m)")]
    Place([f64; 3]),
}
