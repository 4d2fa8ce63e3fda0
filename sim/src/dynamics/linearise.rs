//! The derivative of a step.

use faer::Side;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, MatMut};
use nalgebra::{DMatrix, Matrix3, Vector3};

use super::composite::{Composite, Moved};
use super::expansion::StepExpansion;
use super::implicit::{in_coordinates, mass_matrix};
use super::jacobians::step_jacobians;
use super::rubbing::first_rubbing;
use super::spatial::cross_forces;
use super::step_adjoint::StepAdjoint;
use super::{DynamicsError, State};
use crate::energy::following::jacobian;
use crate::model_tangent::ModelTangent;
use crate::robot::{Command, Drive, Loads, Robot, Tendon};

/// A step to first order: `x+ + dx+`, `dx+ = A dx + B du`.
///
/// The coordinates of a state are those of MuJoCo's `mjd_transitionFD`: turns of the joints in their
/// discs' frames, `q exp(dq)`, or their hinges' angles (rad), three per joint, then their rates (rad/s).
#[derive(Clone, Debug, PartialEq)]
pub struct Linearisation {
    /// By the state: `6 n x 6 n`.
    pub a: DMatrix<f64>,
    /// By the command: `6 n` rows, a column per tendon.
    pub b: DMatrix<f64>,
}

/// Linearises semi-implicit Euler steps of one robot, reusing most of its memory.
#[derive(Clone, Debug)]
pub struct Lineariser {
    step: StepExpansion,
    /// Of a robot among surroundings, which gives the derivative row by row.
    adjoint: Option<StepAdjoint>,
}

impl Lineariser {
    /// A lineariser of [`Integrator::SemiImplicitEuler`](super::Integrator) steps of `robot` by
    /// `timestep` (s).
    ///
    /// # Errors
    /// [`DynamicsError`] as [`Stepper::new`](super::Stepper::new), and [`DynamicsError::LateServo`] where what acts is no command.
    pub fn new(robot: &Robot, timestep: f64) -> Result<Self, DynamicsError> {
        Self::by(StepAdjoint::new(robot, timestep)?)
    }

    /// By the `adjoint` of steps.
    pub(crate) fn by(adjoint: StepAdjoint) -> Result<Self, DynamicsError> {
        if first_rubbing(adjoint.robot()).is_some() {
            return Err(DynamicsError::Underivable {
                what: "single steps with friction of tendons in their holes",
                expected: "tendons without `friction`, or derivatives of a whole motion, which have it",
            });
        }
        let late = |tendon: &Tendon| tendon.servo.follows();
        if let Some(tendon) = adjoint.robot().tendons().iter().position(late) {
            return Err(DynamicsError::LateServo { tendon });
        }
        Ok(Self {
            step: adjoint.step.clone(),
            adjoint: adjoint.has_surroundings().then_some(adjoint),
        })
    }

    /// The derivative of the step from `state` under `command` and `loads`, exact but for rounding,
    /// in O(n³) time, among surroundings in O(n²). Where a tendon goes slack or a joint meets its limit it is one-sided.
    ///
    /// # Errors
    /// [`DynamicsError`] when state, command or loads are not of this robot;
    /// [`DynamicsError::NotDifferentiable`] when a derivative is not a finite number.
    pub fn linearise(
        &mut self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<Linearisation, DynamicsError> {
        if self.adjoint.is_some() {
            return self.linearise_by_rows(state, command, loads);
        }
        self.step.expand(state, command, loads)?;
        // Derivatives of the forces by turns, rates and commands, at the step's accelerations.
        let dof = self.step.equations.robot.dof();
        let mut forces = Mat::zeros(dof, 2 * dof + command.as_slice().len());
        self.add_loads(loads, &mut forces);
        self.add_commands(&mut forces);
        self.subtract_inertia(&mut forces);
        // Derivatives of the accelerations: M da = df.
        let mass = mass_matrix(&self.step.composites, &self.step.armatures);
        let Ok(factor) = Llt::new(mass.as_ref(), Side::Lower) else {
            return Err(DynamicsError::NotDifferentiable);
        };
        factor.solve_in_place(forces.as_mut());
        self.step.through(&state.velocity, &forces)
    }

    /// The same with the adjoint of the step, which gives the derivatives of one rate at its end after another.
    fn linearise_by_rows(
        &mut self,
        state: &State,
        command: &Command,
        loads: &Loads,
    ) -> Result<Linearisation, DynamicsError> {
        let Some(adjoint) = &mut self.adjoint else {
            return Err(DynamicsError::NotDifferentiable);
        };
        adjoint.expand(state, command, loads)?;
        let (dof, h) = (state.velocity.len(), adjoint.timestep());
        let mut accelerations = Mat::zeros(dof, 2 * dof + command.as_slice().len());
        let mut model = ModelTangent::zero(adjoint.robot());
        for row in 0..dof {
            let mut gradient = vec![0.0; 2 * dof];
            gradient[dof + row] = 1.0;
            let by_command = adjoint.pull_back(state, command, loads, &mut gradient, &mut model)?;
            // v+ = v + h a.
            gradient[dof + row] -= 1.0;
            for (column, by) in gradient.iter().chain(&by_command).enumerate() {
                accelerations[(row, column)] = by / h;
            }
        }
        adjoint.step.through(&state.velocity, &accelerations)
    }

    /// Minus the derivative of the residual moments on the joints, `g`, by their coordinates: along
    /// `q exp(dq)` that is their Jacobian by turns and, since turns do not commute, `1/2 [g]x`. Along hinges' angles the Jacobian has
    /// what turns about several axes do to second order.
    fn add_loads(&self, loads: &Loads, forces: &mut Mat<f64>) {
        let StepExpansion {
            equations,
            expansion,
            ..
        } = &self.step;
        let jacobian = jacobian(loads, 1.0, &equations.posture, expansion);
        let orientations = equations.orientations();
        let by_turns = in_coordinates(&jacobian, &equations.posture.chain);
        let dof = by_turns.nrows();
        let mut by_turn: MatMut<'_, f64> = forces.as_mut().subcols_mut(0, dof);
        by_turn -= &by_turns;
        let mut gradient = vec![Vector3::zeros(); orientations.len()];
        expansion.gradient(&mut gradient);
        for (joint, (gradient, orientation)) in gradient.iter().zip(orientations).enumerate() {
            if equations.posture.chain.hinges(joint).is_some() {
                continue;
            }
            let twist = orientation.tr_mul(gradient).cross_matrix() * -0.5;
            add_block(forces, 3 * joint, 3 * joint, &twist);
        }
    }

    fn add_commands(&self, forces: &mut Mat<f64>) {
        let equations = &self.step.equations;
        let chain = &equations.posture.chain;
        let first = 2 * equations.robot.dof();
        let columns = self.step.expansion.dense_columns();
        for (t, tendon) in equations.robot.tendons().iter().enumerate() {
            let (weight, slopes) = &columns[t];
            let tension = match tendon.drive {
                Drive::Tension => 1.0,
                Drive::Gain(_) | Drive::Length => -weight,
            };
            for (joint, slope) in slopes.iter().enumerate() {
                let torque = chain.axes(joint).tr_mul(slope) * -tension;
                for axis in 0..3 {
                    forces[(3 * joint + axis, first + t)] = torque[axis];
                }
            }
        }
    }

    /// Minus the derivatives of the inverse dynamics at the step's accelerations, and of damping.
    fn subtract_inertia(&self, forces: &mut Mat<f64>) {
        let dof = self.step.equations.robot.dof();
        let composites = &self.step.composites;
        let forces_along: Vec<_> = composites.iter().map(Composite::force_along).collect();
        for (j, turned) in composites.iter().enumerate() {
            let by_turn = Moved::by_turn(turned);
            let by_rate = Moved::by_rate(turned);
            let below = turned.force_change(&by_turn) + cross_forces(&turned.axes, &turned.force);
            let below_rate = turned.force_change(&by_rate);
            let [by_turn, by_rate] = [by_turn.stacked(), by_rate.stacked()];
            for (i, joint) in composites.iter().enumerate() {
                let (turn, rate) = if i < j {
                    (joint.axes.tr_mul(&below), joint.axes.tr_mul(&below_rate))
                } else {
                    let along = &forces_along[i];
                    (along.tr_mul(&by_turn), along.tr_mul(&by_rate))
                };
                let (row, column) = (3 * joint.joint, 3 * turned.joint);
                add_block(forces, row, column, &-turn);
                add_block(forces, row, dof + column, &-rate);
            }
            let damping = turned.own(self.step.equations.links[turned.joint].damping());
            let (row, damping) = (3 * turned.joint, Matrix3::from_diagonal(&damping));
            add_block(forces, row, dof + row, &-damping);
        }
    }
}

impl StepExpansion {
    /// From the derivatives of the accelerations to those of `v+ = v + h a`, `q+ = q exp(h v+)`.
    fn through(
        &self,
        velocity: &[f64],
        accelerations: &Mat<f64>,
    ) -> Result<Linearisation, DynamicsError> {
        let (h, dof) = (self.timestep, velocity.len());
        let columns = accelerations.ncols();
        // v+ = v + h a.
        let mut step = DMatrix::zeros(2 * dof, columns);
        for (mut column, accelerations) in step.column_iter_mut().zip(accelerations.col_iter()) {
            for (rate, acceleration) in column
                .rows_mut(dof, dof)
                .iter_mut()
                .zip(accelerations.iter())
            {
                *rate = h * acceleration;
            }
        }
        for row in 0..dof {
            step[(dof + row, dof + row)] += 1.0;
        }
        // q+ = q exp(h v+): a change of q is turned back by the step, one of v+ goes through its Jacobian.
        for joint in 0..dof / 3 {
            let rows = 3 * joint;
            let next = Vector3::from_fn(|axis, _| {
                velocity[rows + axis] + h * self.accelerations[rows + axis]
            });
            let hinges = self.equations.links[joint].hinges.as_deref();
            let (back, jacobian) = step_jacobians(hinges, &(next * h));
            let by_rates = jacobian * h;
            // Column by column, as products of a small and a wide matrix are slow.
            for mut column in step.column_iter_mut() {
                let rates = by_rates * column.fixed_rows::<3>(dof + rows);
                column.fixed_rows_mut::<3>(rows).copy_from(&rates);
            }
            let mut own = step.fixed_view_mut::<3, 3>(rows, rows);
            own += back;
        }
        if step.iter().any(|x| !x.is_finite()) {
            return Err(DynamicsError::NotDifferentiable);
        }
        let b = step.columns(2 * dof, columns - 2 * dof).into_owned();
        Ok(Linearisation {
            a: step.resize_horizontally(2 * dof, 0.0),
            b,
        })
    }
}

fn add_block(matrix: &mut Mat<f64>, row: usize, column: usize, block: &Matrix3<f64>) {
    for (r, c) in (0..9).map(|k| (k / 3, k % 3)) {
        matrix[(row + r, column + c)] += block[(r, c)];
    }
}
