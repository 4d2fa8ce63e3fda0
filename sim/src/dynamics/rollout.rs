//! Motions under sequences of commands.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::{DynamicsError, Integrator, Servos, State, Stepper};
use crate::robot::{Command, Frame, Loads, Robot, Wrench};

/// A motion to compute: where it starts, and what is commanded at each step.
#[derive(Clone, Debug, PartialEq)]
pub struct Rollout {
    /// The state before the first step.
    pub start: State,
    /// One command per step.
    pub commands: Vec<Command>,
    /// Loads, the same at every step.
    pub loads: Loads,
    /// Of each step, a force on the origin of each disc (N) and a moment (N m), world frame, besides the loads; empty where there are none.
    pub wrenches: Vec<Vec<[Vector3<f64>; 2]>>,
}

/// The loads in the steps of a motion.
pub(crate) struct StepLoads<'a> {
    rollout: &'a Rollout,
    /// With the wrenches of the step at hand.
    varying: Loads,
}

impl<'a> StepLoads<'a> {
    /// Those of a motion of `robot`.
    ///
    /// # Errors
    /// [`DynamicsError::Size`] where wrenches are given, but not one for each step and disc; [`DynamicsError::Load`] for numbers that are
    /// not finite.
    pub fn new(robot: &Robot, rollout: &'a Rollout) -> Result<Self, DynamicsError> {
        let (steps, discs) = (rollout.commands.len(), robot.discs().len());
        let wrenches = &rollout.wrenches;
        let size =
            |what, expected, found| DynamicsError::check_size(robot, what, [expected, found]);
        if !wrenches.is_empty() {
            size("list of wrenches", steps, wrenches.len())?;
        }
        for step in wrenches {
            size("wrenches of a step", discs, step.len())?;
        }
        Ok(Self {
            rollout,
            varying: rollout.loads.clone(),
        })
    }

    /// Those in a step.
    pub fn at(&mut self, step: usize) -> Result<&Loads, DynamicsError> {
        let Some(wrenches) = self.rollout.wrenches.get(step) else {
            return Ok(&self.rollout.loads);
        };
        self.varying = self.rollout.loads.clone();
        for (disc, [force, moment]) in wrenches.iter().enumerate() {
            if *force != Vector3::zeros() || *moment != Vector3::zeros() {
                let wrench = Wrench {
                    force: (*force).into(),
                    moment: (*moment).into(),
                    ..Wrench::none(disc, Frame::World)
                };
                self.varying = std::mem::take(&mut self.varying).with_wrench(wrench)?;
            }
        }
        Ok(&self.varying)
    }
}

impl Stepper {
    /// The states after each step of `rollout`, at the start of which the servos have come to the first command, and no contact of
    /// the tendons in their holes is loaded.
    ///
    /// # Errors
    /// [`DynamicsError`] of the first step that fails.
    pub fn rollout(&mut self, rollout: &Rollout) -> Result<Vec<State>, DynamicsError> {
        let (robot, timestep) = (self.robot().clone(), self.timestep);
        if let Some(first) = rollout.commands.first() {
            self.set_deflections(&rollout.start.configuration, first, &[])?;
        }
        rollout.states(&robot, timestep, |state, command, loads| {
            self.step(state, command, loads)
        })
    }
}

impl Rollout {
    /// The states after each step by `timestep` (s), of which `step` takes one under the command and the loads that act.
    pub(crate) fn states(
        &self,
        robot: &Robot,
        timestep: f64,
        mut step: impl FnMut(&mut State, &Command, &Loads) -> Result<(), DynamicsError>,
    ) -> Result<Vec<State>, DynamicsError> {
        let mut state = self.start.clone();
        let Some(first) = self.commands.first() else {
            return Ok(Vec::new());
        };
        let mut servos = Servos::at(robot, first);
        let mut loads = StepLoads::new(robot, self)?;
        (self.commands.iter().enumerate())
            .map(|(number, command)| {
                let acting = servos.follow(command, timestep);
                step(&mut state, acting, loads.at(number)?)?;
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
