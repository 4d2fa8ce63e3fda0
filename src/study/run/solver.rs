//! What configurations settle by: the solver with contacts where there is something to touch.

use tdcr_sim::chain::Configuration;
use tdcr_sim::contact::{ContactEquilibrium, ContactError, ContactSettler};
use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::Scene;
use tdcr_sim::sensitivity::Sensitivity;
use tdcr_sim::statics::{Equilibrium, Settler};

/// A solver of one robot.
pub(super) enum Solver {
    /// Where nothing is touched.
    Free(Box<Settler>),
    /// Among obstacles.
    Among(Box<ContactSettler>),
}

impl Solver {
    pub fn new(robot: &Robot, scene: &Scene) -> Self {
        match scene.is_empty() {
            true => Self::Free(Box::new(Settler::new(robot))),
            false => Self::Among(Box::new(ContactSettler::new(robot, scene))),
        }
    }

    /// Settles from the straight pose.
    ///
    /// # Errors
    /// As [`ContactSettler::settle`].
    pub fn settle(
        &mut self,
        command: &Command,
        loads: &Loads,
    ) -> Result<&Equilibrium, ContactError> {
        match self {
            Self::Free(settler) => Ok(settler.settle(command, loads)),
            Self::Among(settler) => Ok(&settler.settle(command, loads)?.equilibrium),
        }
    }

    /// Settles from a configuration.
    ///
    /// # Errors
    /// As [`ContactSettler::settle_from`].
    pub fn settle_from(
        &mut self,
        start: &Configuration,
        command: &Command,
        loads: &Loads,
    ) -> Result<&Equilibrium, ContactError> {
        match self {
            Self::Free(settler) => Ok(settler.settle_from(start, command, loads)),
            Self::Among(settler) => Ok(&settler.settle_from(start, command, loads)?.equilibrium),
        }
    }

    /// The last equilibrium.
    pub fn found(&self) -> ContactEquilibrium {
        match self {
            Self::Free(settler) => ContactEquilibrium {
                equilibrium: settler.equilibrium().clone(),
                contacts: Vec::new(),
                complementarity: 0.0,
                penetration: 0.0,
                barrier: 0.0,
            },
            Self::Among(settler) => settler.found().clone(),
        }
    }

    /// Smallest stiffness at the last equilibrium, of `command` and `loads` (N m/rad).
    pub fn smallest_stiffness(&mut self, command: &Command, loads: &Loads) -> f64 {
        match self {
            Self::Free(settler) => {
                (settler.robot()).smallest_stiffness(command, loads, settler.equilibrium())
            }
            Self::Among(settler) => settler.smallest_stiffness(command, loads),
        }
    }

    /// Derivatives of the last equilibrium, of `command` and `loads`, if it has any.
    pub fn sensitivity(&self, command: &Command, loads: &Loads) -> Option<Sensitivity> {
        match self {
            Self::Free(settler) => {
                let found = settler.equilibrium();
                settler.robot().sensitivity(command, loads, found).ok()
            }
            Self::Among(settler) => {
                let derivatives = settler.sensitivity(command, loads).ok()?;
                Some(derivatives.parameters().clone())
            }
        }
    }

    /// Smallest gap to obstacles at the last equilibrium (m).
    pub fn clearance(&self) -> f64 {
        match self {
            Self::Free(_) => f64::INFINITY,
            Self::Among(settler) => settler.clearance(),
        }
    }
}
