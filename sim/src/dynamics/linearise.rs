//! The derivative of a step.

use faer::Side;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, MatMut};
use nalgebra::{DMatrix, Matrix3, Matrix6x3, Vector3};

use super::acceleration::EquationsOfMotion;
use super::composite::{Composite, compose, cross_motion, cross_with_force};
use super::implicit::{in_discs, mass_matrix};
use super::{DynamicsError, State};
use crate::chain::Configuration;
use crate::energy::following::{add_forces, add_moments, jacobian};
use crate::energy::{Expansion, Potential};
use crate::robot::{Command, Drive, Loads, Robot};

/// A step to first order: `x+ + dx+`, `dx+ = A dx + B du`.
///
/// The coordinates of a state are those of MuJoCo's `mjd_transitionFD`: turns of the joints in their
/// discs' frames, `q exp(dq)` (rad), three per joint, then their rates (rad/s).
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
    timestep: f64,
    equations: EquationsOfMotion,
    armatures: Vec<f64>,
    accelerations: Vec<f64>,
    composites: Vec<Composite>,
    expansion: Expansion,
}

impl Lineariser {
    /// A lineariser of [`Integrator::SemiImplicitEuler`](super::Integrator) steps of `robot` by
    /// `timestep` (s).
    ///
    /// # Errors
    /// [`DynamicsError`] as [`Stepper::new`](super::Stepper::new).
    pub fn new(robot: &Robot, timestep: f64) -> Result<Self, DynamicsError> {
        if !(timestep.is_finite() && timestep > 0.0) {
            return Err(DynamicsError::Timestep(timestep));
        }
        let armatures: Vec<f64> = (robot.discs().iter())
            .map(|disc| disc.armature + timestep * disc.damping)
            .collect();
        Ok(Self {
            timestep,
            equations: EquationsOfMotion::new(robot, &armatures)?,
            armatures,
            accelerations: vec![0.0; robot.dof()],
            composites: Vec::with_capacity(robot.discs().len()),
            expansion: Expansion::new(robot),
        })
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
        self.equations.accept(state, command, loads)?;
        let command = command.as_slice();
        let (q, v) = (&state.configuration, &state.velocity);
        let accelerations = &mut self.accelerations;
        // Accelerations of the step, at which the inverse dynamics are differentiated.
        self.equations
            .accelerate(q, v, command, &self.armatures, accelerations);
        // Implicit damping acts on the change of the rates, as an armature would.
        compose(&self.equations, v, accelerations, &mut self.composites);
        // Derivatives of the forces by turns, rates and commands, at these accelerations.
        let dof = self.equations.robot.dof();
        let mut forces = Mat::zeros(dof, 2 * dof + command.len());
        self.add_loads(q, command, loads, &mut forces);
        self.add_commands(&mut forces);
        self.subtract_inertia(&mut forces);
        // Derivatives of the accelerations: M da = df.
        let mass = mass_matrix(&self.composites, &self.armatures);
        let Ok(factor) = Llt::new(mass.as_ref(), Side::Lower) else {
            return Err(DynamicsError::NotDifferentiable);
        };
        factor.solve_in_place(forces.as_mut());
        let step = self.through_step(v, &forces);
        let finite = |matrix: &DMatrix<f64>| matrix.iter().all(|x| x.is_finite());
        if finite(&step.a) && finite(&step.b) {
            Ok(step)
        } else {
            Err(DynamicsError::NotDifferentiable)
        }
    }

    /// Minus the derivative of the residual moments on the joints, `g`, in the discs' frames: along
    /// `q exp(dq)` that is their Jacobian by turns and, since turns do not commute, `1/2 [g]x`.
    fn add_loads(
        &mut self,
        q: &Configuration,
        command: &[f64],
        loads: &Loads,
        forces: &mut Mat<f64>,
    ) {
        let posture = &self.equations.posture;
        let mut dead = self.equations.forces.dead.clone();
        add_forces(loads, 1.0, posture, &mut dead);
        let potential = Potential {
            robot: &self.equations.robot,
            command,
            dead: &dead,
        };
        potential.expand(q, posture, &mut self.expansion);
        add_moments(loads, 1.0, posture, &mut self.expansion);
        let jacobian = jacobian(loads, 1.0, posture, &self.expansion);
        let orientations = self.equations.orientations();
        let by_turns = in_discs(&jacobian, orientations);
        let dof = by_turns.nrows();
        let mut by_turn: MatMut<'_, f64> = forces.as_mut().subcols_mut(0, dof);
        by_turn -= &by_turns;
        let mut gradient = vec![Vector3::zeros(); orientations.len()];
        self.expansion.gradient(&mut gradient);
        for (joint, (gradient, orientation)) in gradient.iter().zip(orientations).enumerate() {
            let twist = orientation.tr_mul(gradient).cross_matrix() * -0.5;
            add_block(forces, 3 * joint, 3 * joint, &twist);
        }
    }

    fn add_commands(&self, forces: &mut Mat<f64>) {
        let orientations = self.equations.orientations();
        let first = 2 * self.equations.robot.dof();
        let columns = self.expansion.dense_columns();
        for (t, tendon) in self.equations.robot.tendons().iter().enumerate() {
            let (weight, slopes) = &columns[t];
            let tension = match tendon.drive {
                Drive::Tension => 1.0,
                Drive::Gain(_) | Drive::Length => -weight,
            };
            for (joint, (slope, orientation)) in slopes.iter().zip(orientations).enumerate() {
                let torque = orientation.tr_mul(slope) * -tension;
                for axis in 0..3 {
                    forces[(3 * joint + axis, first + t)] = torque[axis];
                }
            }
        }
    }

    /// Minus the derivatives of the inverse dynamics at the step's accelerations, and of damping.
    fn subtract_inertia(&self, forces: &mut Mat<f64>) {
        let dof = self.equations.robot.dof();
        for (j, turned) in self.composites.iter().enumerate() {
            let by_turn = Moved::by_turn(turned);
            let by_rate = Moved::by_rate(turned);
            let below =
                turned.force_change(&by_turn) + cross_with_force(&turned.force) * turned.axes;
            let below_rate = turned.force_change(&by_rate);
            for (i, joint) in self.composites.iter().enumerate() {
                let (turn, rate) = if i < j {
                    (joint.axes.tr_mul(&below), joint.axes.tr_mul(&below_rate))
                } else {
                    (
                        joint.axes.tr_mul(&joint.force_change(&by_turn)),
                        joint.axes.tr_mul(&joint.force_change(&by_rate)),
                    )
                };
                add_block(forces, 3 * i, 3 * j, &-turn);
                add_block(forces, 3 * i, dof + 3 * j, &-rate);
            }
            let damping = Matrix3::identity() * -self.equations.links[j].damping;
            add_block(forces, 3 * j, dof + 3 * j, &damping);
        }
    }

    /// From the derivatives of the accelerations to those of `v+ = v + h a`, `q+ = q exp(h v+)`.
    fn through_step(&self, velocity: &[f64], accelerations: &Mat<f64>) -> Linearisation {
        let (h, dof) = (self.timestep, velocity.len());
        let columns = accelerations.ncols();
        // v+ = v + h a.
        let mut step = DMatrix::zeros(2 * dof, columns);
        for column in 0..columns {
            for row in 0..dof {
                step[(dof + row, column)] = h * accelerations[(row, column)];
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
            let (back, jacobian) = turn_jacobians(&(next * h));
            let rates = jacobian * h * step.fixed_rows::<3>(dof + rows);
            step.fixed_rows_mut::<3>(rows).copy_from(&rates);
            let mut own = step.fixed_view_mut::<3, 3>(rows, rows);
            own += back;
        }
        Linearisation {
            a: step.columns(0, 2 * dof).into_owned(),
            b: step.columns(2 * dof, columns - 2 * dof).into_owned(),
        }
    }
}

/// How the motion of all bodies above a joint changes with it: in axes that move along, velocities
/// by a constant `velocity`, accelerations by `rest` and what follows from `velocity`.
struct Moved {
    velocity: Matrix6x3<f64>,
    rest: Matrix6x3<f64>,
}

impl Moved {
    fn by_turn(joint: &Composite) -> Self {
        let below = cross_motion(&joint.velocity_below);
        let velocity = below * joint.axes;
        Self {
            velocity,
            rest: cross_motion(&joint.acceleration_below) * joint.axes + below * velocity,
        }
    }

    fn by_rate(joint: &Composite) -> Self {
        Self {
            velocity: joint.axes,
            rest: cross_motion(&(joint.velocity_below + joint.velocity)) * joint.axes,
        }
    }
}

impl Composite {
    fn force_change(&self, moved: &Moved) -> Matrix6x3<f64> {
        self.inertia * moved.rest + self.coriolis * moved.velocity
    }
}

/// `exp(-turn)`, and the right Jacobian of the exponential map at `turn`: what a change of the
/// start, and of the turn, are in the frame at the end (Sola et al., A micro Lie theory, eq. 143).
fn turn_jacobians(turn: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
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
