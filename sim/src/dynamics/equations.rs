//! The terms of the equations of motion, for those who write their own.

use nalgebra::{DMatrix, Vector3};

use super::acceleration::EquationsOfMotion;
use super::composite::{compose, compose_on};
use super::implicit::mass_matrix;
use super::links::Link;
use super::{DynamicsError, State};
use crate::robot::{Loads, Robot};

/// The terms of `M(q) dv/dt + bias(q, v) = torques` by the joints' coordinates ([`State`]).
#[derive(Clone, Debug, PartialEq)]
pub struct MotionTerms {
    /// Mass matrix, armatures and payload included, `3 n x 3 n` (kg m²); 1 on the diagonal for what a joint of fewer than three hinges
    /// does not have.
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
        let armatures = Link::armatures(self, 0.0);
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
        let mut bias = vec![0.0; self.dof()];
        for composite in &composites {
            let torque: Vector3<f64> = composite.axes.transpose() * composite.force;
            for (bias, torque) in bias[3 * composite.joint..].iter_mut().zip(torque.iter()) {
                *bias += torque;
            }
        }
        Ok(MotionTerms {
            mass: DMatrix::from_fn(self.dof(), self.dof(), |i, j| mass[(i, j)]),
            bias,
        })
    }
}
