//! Motions under sequences of commands.

use rayon::prelude::*;

use super::{DynamicsError, Integrator, Servos, State, Stepper};
use crate::robot::{Command, Loads, Robot};

/// A motion to compute: where it starts, and what is commanded at each step.
#[derive(Clone, Debug, PartialEq)]
pub struct Rollout {
    /// The state before the first step.
    pub start: State,
    /// One command per step.
    pub commands: Vec<Command>,
    /// Loads, the same at every step.
    pub loads: Loads,
}

impl Stepper {
    /// The states after each step of `rollout`, at the start of which the servos have come to the first command.
    ///
    /// # Errors
    /// [`DynamicsError`] of the first step that fails.
    pub fn rollout(&mut self, rollout: &Rollout) -> Result<Vec<State>, DynamicsError> {
        let mut state = rollout.start.clone();
        let Some(first) = rollout.commands.first() else {
            return Ok(Vec::new());
        };
        let mut servos = Servos::at(self.robot(), first);
        (rollout.commands.iter())
            .map(|command| {
                let acting = servos.follow(command, self.timestep);
                self.step(&mut state, acting, &rollout.loads)?;
                Ok(state.clone())
            })
            .collect()
    }
}

/// The states after each step of many rollouts, on all cores; the result does not depend on the
/// number of threads.
///
/// # Errors
/// [`DynamicsError`] when no stepper can be made ([`Stepper::new`]), or a step fails.
pub fn rollout_batch(
    robot: &Robot,
    timestep: f64,
    integrator: Integrator,
    rollouts: &[Rollout],
) -> Result<Vec<Vec<State>>, DynamicsError> {
    let stepper = Stepper::new(robot, timestep, integrator)?;
    (rollouts.par_iter())
        .map_init(
            || stepper.clone(),
            |stepper, rollout| stepper.rollout(rollout),
        )
        .collect()
}
