//! One way to drive a robot, whatever its physics: quasi-static, with friction of the tendons, or in motion.
//!
//! A [`Simulation`] is made from a robot, [`reset`](Simulation::reset) to the equilibrium of a command,
//! [`advance`](Simulation::advance)d by commands and loads, and shows its [`pose`](Simulation::pose) without a copy. Who
//! drives one (an environment, a rig of servos and cameras, a study) need not know which it is:
//!
//! | | one advance | history |
//! |---|---|---|
//! | [`Settler`] | to the equilibrium of the command, followed from the last one | the branch of equilibria |
//! | [`ContactSettler`] | the same among obstacles | the branch of equilibria |
//! | [`FrictionPath`] | along the straight line of commands, with friction in the holes | slip at every hole |
//! | [`MovingRobot`] | by a fixed number of time steps, also among obstacles | velocities |
//!
//! ```
//! use tdcr_sim::dynamics::Integrator;
//! use tdcr_sim::robot::{Loads, Robot};
//! use tdcr_sim::simulation::{MovingRobot, Simulation};
//! use tdcr_sim::statics::Settler;
//!
//! let robot = Robot::load("2m")?;
//! let simulations: [Box<dyn Simulation>; 2] = [
//!     Box::new(Settler::new(&robot)),
//!     Box::new(MovingRobot::new(&robot, 0.002, Integrator::default(), 10)?),
//! ];
//! for mut simulation in simulations {
//!     simulation.reset(&robot.mean_command(), &Loads::default())?;
//!     for step in 0..5 {
//!         let pull = 0.02 - 1e-3 * f64::from(step);
//!         let command = robot.command(&[pull, 0.02, 0.02, 0.02, 0.02, 0.02])?;
//!         simulation.advance(&command, &Loads::default())?;
//!     }
//!     println!("tip at {:?}", simulation.pose().tip().translation);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod moving;
mod physics;

pub use moving::MovingRobot;
pub use physics::Physics;

use thiserror::Error;

use crate::contact::{ContactError, ContactSettler};
use crate::dynamics::DynamicsError;
use crate::pose::Pose;
use crate::robot::{Command, CommandError, Loads, LoadsError, Robot};
use crate::scene::Scene;
use crate::statics::{Equilibrium, NotSettled, Settler};
use crate::tendon_friction::{ContactPath, FrictionPath};

/// A simulated robot that is driven by commands.
pub trait Simulation: Send {
    /// The robot.
    fn robot(&self) -> &Robot;

    /// Starts anew where the robot settles under `command` and `loads` from the straight pose: at rest, no hole slipping.
    ///
    /// # Errors
    /// [`SimulationError`] where they are not of this robot, or it does not settle.
    fn reset(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError>;

    /// Goes on under `command` and `loads` from where the robot is. Before a first [`reset`](Self::reset), the same as that.
    ///
    /// # Errors
    /// As [`reset`](Self::reset); [`SimulationError::Dynamics`] where a motion diverges. The pose is then the last one
    /// that was computed; a reset leads out of any error.
    fn advance(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError>;

    /// Where the robot is.
    fn pose(&self) -> Pose<'_>;

    /// What is around the robot, objects where they are now; `None` for a robot that touches nothing.
    fn scene(&self) -> Option<&Scene> {
        None
    }
}

/// Why a simulation cannot go on.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SimulationError {
    /// A command of another robot.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// Loads of another robot.
    #[error(transparent)]
    Loads(#[from] LoadsError),
    /// There is no equilibrium where one was sought.
    #[error(transparent)]
    NotSettled(#[from] NotSettled),
    /// Among obstacles the problem cannot be solved.
    #[error(transparent)]
    Contact(#[from] ContactError),
    /// The motion cannot be computed.
    #[error(transparent)]
    Dynamics(#[from] DynamicsError),
}

/// Refuses commands and loads of another robot.
fn check(robot: &Robot, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
    robot.check_command(command.as_slice())?;
    Ok(loads.check(robot)?)
}

fn settled(
    robot: &Robot,
    command: &Command,
    equilibrium: &Equilibrium,
) -> Result<(), SimulationError> {
    match equilibrium.failure(robot, command) {
        None => Ok(()),
        Some(failure) => Err(failure.into()),
    }
}

impl Simulation for Settler {
    fn robot(&self) -> &Robot {
        self.robot()
    }

    fn reset(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        check(self.robot(), command, loads)?;
        self.settle(command, loads);
        settled(self.robot(), command, self.equilibrium())
    }

    fn advance(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        check(self.robot(), command, loads)?;
        self.follow(command, loads);
        settled(self.robot(), command, self.equilibrium())
    }

    fn pose(&self) -> Pose<'_> {
        self.equilibrium().pose()
    }
}

impl Simulation for ContactSettler {
    fn robot(&self) -> &Robot {
        self.robot()
    }

    fn reset(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        check(self.robot(), command, loads)?;
        self.settle(command, loads)?;
        settled(self.robot(), command, &self.found().equilibrium)
    }

    fn advance(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        check(self.robot(), command, loads)?;
        self.follow(command, loads)?;
        settled(self.robot(), command, &self.found().equilibrium)
    }

    fn pose(&self) -> Pose<'_> {
        self.found().equilibrium.pose()
    }

    fn scene(&self) -> Option<&Scene> {
        Some(self.scene())
    }
}

impl Simulation for ContactPath {
    fn robot(&self) -> &Robot {
        self.robot()
    }

    fn reset(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        check(self.robot(), command, loads)?;
        self.start(command, loads)?;
        settled(self.robot(), command, &self.state().equilibrium)
    }

    fn advance(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        check(self.robot(), command, loads)?;
        ContactPath::advance(self, command, loads)?;
        settled(self.robot(), command, &self.state().equilibrium)
    }

    fn pose(&self) -> Pose<'_> {
        self.state().equilibrium.pose()
    }

    fn scene(&self) -> Option<&Scene> {
        Some(self.scene())
    }
}

impl Simulation for FrictionPath {
    fn robot(&self) -> &Robot {
        self.robot()
    }

    fn reset(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        check(self.robot(), command, loads)?;
        self.start(command, loads);
        settled(self.robot(), command, &self.state().equilibrium)
    }

    fn advance(&mut self, command: &Command, loads: &Loads) -> Result<(), SimulationError> {
        check(self.robot(), command, loads)?;
        FrictionPath::advance(self, command, loads);
        settled(self.robot(), command, &self.state().equilibrium)
    }

    fn pose(&self) -> Pose<'_> {
        self.state().equilibrium.pose()
    }
}
