//! The derivative of a step.

use faer::Side;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, MatMut};
use nalgebra::{DMatrix, Matrix3, Vector3};

use super::composite::{Composite, Moved, cross_with_force};
use super::expansion::StepExpansion;
use super::implicit::{in_coordinates, mass_matrix};
use super::{DynamicsError, State};
use crate::energy::following::jacobian;
use crate::robot::{Command, Drive, Hinges, Loads, Robot};

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
}

impl Lineariser {
    /// A lineariser of [`Integrator::SemiImplicitEuler`](super::Integrator) steps of `robot` by
    /// `timestep` (s).
    ///
    /// # Errors
    /// [`DynamicsError`] as [`Stepper::new`](super::Stepper::new).
    pub fn new(robot: &Robot, timestep: f64) -> Result<Self, DynamicsError> {
        let step = StepExpansion::new(robot, timestep)?;
        Ok(Self { step })
    }

    /// The derivative of the step from `state` under `command` and `loads`, exact but for rounding,
    /// in O(n³) time. Where a tendon goes slack or a joint meets its limit it is one-sided.
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
        let step = self.through_step(&state.velocity, &forces);
        let finite = |matrix: &DMatrix<f64>| matrix.iter().all(|x| x.is_finite());
        if finite(&step.a) && finite(&step.b) {
            Ok(step)
        } else {
            Err(DynamicsError::NotDifferentiable)
        }
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
            let below =
                turned.force_change(&by_turn) + cross_with_force(&turned.force) * turned.axes;
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

    /// From the derivatives of the accelerations to those of `v+ = v + h a`, `q+ = q exp(h v+)`.
    fn through_step(&self, velocity: &[f64], accelerations: &Mat<f64>) -> Linearisation {
        let (h, dof) = (self.step.timestep, velocity.len());
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
                velocity[rows + axis] + h * self.step.accelerations[rows + axis]
            });
            let hinges = self.step.equations.links[joint].hinges.as_deref();
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
        let b = step.columns(2 * dof, columns - 2 * dof).into_owned();
        Linearisation {
            a: step.resize_horizontally(2 * dof, 0.0),
            b,
        }
    }
}

/// What a change of a joint's coordinates at the start of a `step` (rad) of them, and one of the step, are at its end: for a ball joint
/// [`turn_jacobians`].
pub(super) fn step_jacobians(
    hinges: Option<&Hinges>,
    step: &Vector3<f64>,
) -> (Matrix3<f64>, Matrix3<f64>) {
    match hinges {
        None => turn_jacobians(step),
        Some(hinges) => {
            let present = Matrix3::from_diagonal(&hinges.present());
            (present, present)
        }
    }
}

/// `exp(-turn)`, and the right Jacobian of the exponential map at `turn`: what a change of the
/// start, and of the turn, are in the frame at the end (Sola et al., A micro Lie theory, eq. 143).
pub(super) fn turn_jacobians(turn: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
    let squared = turn.norm_squared();
    // sin(t)/t, (1 - cos(t))/t², (t - sin(t))/t³.
    let [sine, versine, rest] = if squared < 1e-3 {
        [
            1.0 - squared / 6.0 * (1.0 - squared / 20.0 * (1.0 - squared / 42.0)),
            0.5 - squared / 24.0 * (1.0 - squared / 30.0 * (1.0 - squared / 56.0)),
            1.0 / 6.0 - squared / 120.0 * (1.0 - squared / 42.0 * (1.0 - squared / 72.0)),
        ]
    } else {
        let angle = squared.sqrt();
        let (sin, cos) = angle.sin_cos();
        [
            sin / angle,
            (1.0 - cos) / squared,
            (angle - sin) / (squared * angle),
        ]
    };
    let cross = turn.cross_matrix();
    let square = cross * cross;
    (
        Matrix3::identity() - cross * sine + square * versine,
        Matrix3::identity() - cross * versine + square * rest,
    )
}

fn add_block(matrix: &mut Mat<f64>, row: usize, column: usize, block: &Matrix3<f64>) {
    for (r, c) in (0..9).map(|k| (k / 3, k % 3)) {
        matrix[(row + r, column + c)] += block[(r, c)];
    }
}
