//! What a robot moves among, as derivatives of its steps take it.

use std::fmt::Debug;

use nalgebra::Vector3;

use super::pushes::Push;
use super::{DynamicsError, State, Stepper};
use crate::robot::{Command, Loads};

/// What a robot moves among, as derivatives of its steps take it.
pub(crate) trait Surroundings: Debug + Send + Sync {
    /// Takes the step from `before`; returns the accelerations of the joints' coordinates (rad/s²), and sets the pushes in it.
    fn step(
        &mut self,
        before: &State,
        command: &Command,
        loads: &Loads,
        pushes: &mut Vec<Push>,
    ) -> Result<&[f64], DynamicsError>;

    fn boxed(&self) -> Box<dyn Surroundings>;

    /// The stepper of the robot.
    fn stepper(&mut self) -> &mut Stepper;

    /// Where the origin of each obstacle is (m).
    fn obstacles(&self) -> Vec<Vector3<f64>> {
        Vec::new()
    }
}

impl Clone for Box<dyn Surroundings> {
    fn clone(&self) -> Self {
        self.as_ref().boxed()
    }
}

impl Surroundings for Stepper {
    fn step(
        &mut self,
        before: &State,
        command: &Command,
        loads: &Loads,
        pushes: &mut Vec<Push>,
    ) -> Result<&[f64], DynamicsError> {
        Self::step(self, &mut before.clone(), command, loads)?;
        self.add_pushes(before, pushes);
        Ok(&self.accelerations)
    }

    fn boxed(&self) -> Box<dyn Surroundings> {
        Box::new(self.clone())
    }

    fn stepper(&mut self) -> &mut Stepper {
        self
    }
}
