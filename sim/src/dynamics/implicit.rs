//! Linearly implicit Euler steps: one Newton step on the implicit Euler equations (as of Baraff and Witkin, Large Steps in
//! Cloth Simulation, SIGGRAPH 1998).

use faer::Mat;
use faer::Side;
use faer::linalg::solvers::{Llt, Solve};
use nalgebra::Matrix3;

use super::State;
use super::acceleration::EquationsOfMotion;
use super::composite::{Composite, compose};
use crate::energy::Expansion;
use crate::robot::Robot;

/// Workspace of the method.
#[derive(Clone, Debug)]
pub(super) struct ImplicitEuler {
    expansion: Expansion,
    composites: Vec<Composite>,
    torques: Vec<f64>,
    still: Vec<f64>,
}

impl ImplicitEuler {
    pub fn new(robot: &Robot) -> Box<Self> {
        Box::new(Self {
            expansion: Expansion::new(robot),
            composites: Vec::with_capacity(robot.discs().len()),
            torques: vec![0.0; robot.dof()],
            still: vec![0.0; robot.dof()],
        })
    }

    /// Writes the accelerations to `out` (rad/s²): the solution `a` of
    /// `(M + h D + h² K) a = tau - D v - bias - h K v`; `false` if the matrix is not positive
    /// definite. `armatures` hold `h D`.
    pub fn accelerate(
        &mut self,
        equations: &mut EquationsOfMotion,
        state: &State,
        command: &[f64],
        armatures: &[f64],
        h: f64,
        out: &mut [f64],
    ) -> bool {
        // tau - D v, and the composite bodies for M and the bias torques.
        equations.torques(
            &state.configuration,
            &state.velocity,
            command,
            &mut self.torques,
        );
        compose(
            equations,
            &state.velocity,
            &self.still,
            &mut self.composites,
        );
        // K: the Hessian of the potential, in the discs' frames.
        let potential = equations.forces.potential(command);
        potential.expand(
            &state.configuration,
            &equations.posture,
            &mut self.expansion,
        );
        let stiffness = in_discs(&self.expansion.dense(), equations.orientations());
        let matrix = mass_matrix(&self.composites, armatures) + &stiffness * faer::Scale(h * h);
        let Ok(factor) = Llt::new(matrix.as_ref(), Side::Lower) else {
            return false;
        };
        // tau - D v - bias - h K v.
        let dof = self.torques.len();
        let velocity = Mat::from_fn(dof, 1, |i, _| state.velocity[i]);
        let mut forces = stiffness * velocity * faer::Scale(-h);
        for (joint, composite) in self.composites.iter().enumerate() {
            let bias = composite.axes.tr_mul(&composite.force);
            for axis in 0..3 {
                forces[(3 * joint + axis, 0)] += self.torques[3 * joint + axis] - bias[axis];
            }
        }
        factor.solve_in_place(forces.as_mut());
        out.copy_from_slice(forces.col_as_slice(0));
        true
    }
}

/// The mass matrix with `armatures` (kg m²), in the discs' frames.
pub(super) fn mass_matrix(composites: &[Composite], armatures: &[f64]) -> Mat<f64> {
    let dof = 3 * composites.len();
    let mut mass = Mat::zeros(dof, dof);
    for (i, upper) in composites.iter().enumerate() {
        let rows = upper.axes.tr_mul(&upper.inertia);
        for (j, lower) in composites[..=i].iter().enumerate() {
            let block: Matrix3<f64> = rows * lower.axes;
            for (r, c) in (0..9).map(|k| (k / 3, k % 3)) {
                mass[(3 * i + r, 3 * j + c)] = block[(r, c)];
                mass[(3 * j + c, 3 * i + r)] = block[(r, c)];
            }
        }
        for axis in 3 * i..3 * i + 3 {
            mass[(axis, axis)] += armatures[i];
        }
    }
    mass
}

/// A matrix of turns in world axes, in the discs' frames.
pub(super) fn in_discs(world: &Mat<f64>, orientations: &[Matrix3<f64>]) -> Mat<f64> {
    let mut out = Mat::zeros(world.nrows(), world.ncols());
    for (i, upper) in orientations.iter().enumerate() {
        for (j, lower) in orientations.iter().enumerate() {
            let block = Matrix3::from_fn(|r, c| world[(3 * i + r, 3 * j + c)]);
            let turned = upper.tr_mul(&block) * lower;
            for (r, c) in (0..9).map(|k| (k / 3, k % 3)) {
                out[(3 * i + r, 3 * j + c)] = turned[(r, c)];
            }
        }
    }
    out
}
