//! The terms of the equations of motion, for those who write their own.

use nalgebra::DMatrix;

use super::acceleration::EquationsOfMotion;
use super::composite::{compose, compose_on};
use super::implicit::mass_matrix;
use super::{DynamicsError, State};
use crate::robot::{Loads, Robot};

/// The terms of `M(q) dv/dt + bias(q, v) = torques`, joint coordinates in the discs' own frames.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionTerms {
    /// Mass matrix, armatures and payload included, `3 n x 3 n` (kg m²).
    pub mass: DMatrix<f64>,
    /// Coriolis, centrifugal and gravity torques, `3 n` (N m).
    pub bias: Vec<f64>,
}

impl Robot {
    /// The mass matrix and the bias torques in a state, with the payload of `loads`.
    ///
    /// # Errors
    /// [`DynamicsError`] when the state or the loads are not of this robot, or it cannot move.
    pub fn motion_terms(&self, state: &State, loads: &Loads) -> Result<MotionTerms, DynamicsError> {
        let armatures: Vec<f64> = self.discs().iter().map(|disc| disc.armature).collect();
        let mut equations = EquationsOfMotion::new(self, &armatures)?;
        equations.accept(state, &self.mean_command(), loads)?;
        equations.posture.place(self, &state.configuration);
        let still = vec![0.0; self.dof()];
        let mut composites = Vec::new();
        compose(&equations, &still, &still, &mut composites);
        let mass = mass_matrix(&composites, &armatures);
        let upwards = -self.gravity();
        compose_on(
            &equations,
            &upwards,
            &state.velocity,
            &still,
            &mut composites,
        );
        let bias = (composites.iter())
            .flat_map(|composite| {
                let torque = composite.axes.transpose() * composite.force;
                [torque.x, torque.y, torque.z]
            })
            .collect();
        Ok(MotionTerms {
            mass: DMatrix::from_fn(self.dof(), self.dof(), |i, j| mass[(i, j)]),
            bias,
        })
    }
}
