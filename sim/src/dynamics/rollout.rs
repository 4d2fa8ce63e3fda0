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
        let (robot, timestep) = (self.robot().clone(), self.timestep);
        rollout.states(&robot, timestep, |state, command| {
            self.step(state, command, &rollout.loads)
        })
    }
}

impl Rollout {
    /// The states after each step by `timestep` (s), of which `step` takes one under the command that acts.
    pub(crate) fn states(
        &self,
        robot: &Robot,
        timestep: f64,
        mut step: impl FnMut(&mut State, &Command) -> Result<(), DynamicsError>,
    ) -> Result<Vec<State>, DynamicsError> {
        let mut state = self.start.clone();
        let Some(first) = self.commands.first() else {
            return Ok(Vec::new());
        };
        let mut servos = Servos::at(robot, first);
        (self.commands.iter())
            .map(|command| {
                step(&mut state, servos.follow(command, timestep))?;
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
