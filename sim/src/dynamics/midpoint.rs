//! The implicit midpoint rule on the rotation group.
//!
//! The unknown of a step by `h` from `(q, v)` is the acceleration `a`, `v+ = v + h a`. With `u = v + h a / 2` and
//! `q_m = q exp(h u / 2)` it makes the residual `M(q_m) a + bias(q_m, u) + D u - tau(q_m)` vanish. Newton's method takes
//! `M + h/2 D + h²/4 K` for the derivative: what is left out, of the bias and of the mass matrix, is of higher order in `h`.

use nalgebra::Vector3;

use super::acceleration::EquationsOfMotion;
use super::implicit::ImplicitMatrix;
use super::integrator::LARGEST_TURN;

use super::symmetric::transpose_times;
use super::{DynamicsError, State};
use crate::chain::Configuration;
use crate::robot::{Loads, Robot};

/// Change of a joint's turn in the step (rad) from which Newton's method has converged.
const TOLERANCE: f64 = 1e-11;
const MAX_ITERATIONS: usize = 30;
/// Newton steps with a matrix of their own; the others take the last.
const FACTORISATIONS: usize = 3;
/// Halvings of a step that cannot be solved.
const MAX_HALVINGS: u32 = 6;

/// Workspace of the method.
#[derive(Clone, Debug)]
pub(super) struct ImplicitMidpoint {
    matrix: ImplicitMatrix,
    /// Where the step has come to, in parts.
    reached: State,
    q: Configuration,
    u: Vec<f64>,
    acceleration: Vec<f64>,
    /// The acceleration in world axes, the residual, and Newton's step.
    world: Vec<Vector3<f64>>,
    residual: Vec<Vector3<f64>>,
    step: Vec<Vector3<f64>>,
}

impl ImplicitMidpoint {
    pub fn new(robot: &Robot) -> Box<Self> {
        let zeros = vec![Vector3::zeros(); robot.discs().len()];
        Box::new(Self {
            matrix: ImplicitMatrix::new(robot),
            reached: State::straight(robot),
            q: Configuration::straight(robot),
            u: vec![0.0; robot.dof()],
            acceleration: vec![0.0; robot.dof()],
            world: zeros.clone(),
            residual: zeros.clone(),
            step: zeros,
        })
    }

    /// Moves `state` by `h` (s), in parts where the whole cannot be solved; returns whether that was so.
    pub fn step(
        &mut self,
        equations: &mut EquationsOfMotion,
        loads: &Loads,
        state: &mut State,
        command: &[f64],
        h: f64,
    ) -> Result<bool, DynamicsError> {
        for halvings in 0..=MAX_HALVINGS {
            let parts = 1 << halvings;
            (self.reached.configuration.0).copy_from_slice(&state.configuration.0);
            self.reached.velocity.copy_from_slice(&state.velocity);
            let part = h / f64::from(parts);
            if (0..parts).all(|_| self.advance(equations, loads, command, part)) {
                std::mem::swap(state, &mut self.reached);
                return Ok(halvings > 0);
            }
        }
        Err(DynamicsError::NotSolved {
            timestep: h,
            smallest: h / f64::from(1 << MAX_HALVINGS),
        })
    }

    /// Moves what was reached by `h`, if the step can be solved.
    fn advance(
        &mut self,
        equations: &mut EquationsOfMotion,
        loads: &Loads,
        command: &[f64],
        h: f64,
    ) -> bool {
        self.acceleration.fill(0.0);
        let solved = (0..MAX_ITERATIONS)
            .map_while(|iteration| self.newton_step(equations, loads, command, h, iteration))
            .any(|size| size <= TOLERANCE);
        if !solved || !self.go_half_way(&equations.robot, h) {
            return false;
        }
        // q+ = q exp(h u), v+ = v + h a.
        let rates = self.u.as_chunks::<3>().0;
        let joints = self
            .reached
            .configuration
            .0
            .iter_mut()
            .zip(equations.robot.discs());
        for ((q, disc), rate) in joints.zip(rates) {
            *q = disc.moved(q, &(Vector3::from(*rate) * h));
        }
        for (v, a) in self.reached.velocity.iter_mut().zip(&self.acceleration) {
            *v += h * a;
        }
        true
    }

    /// Sets the mean rates and the configuration half-way; whether no joint turns too far.
    fn go_half_way(&mut self, robot: &Robot, h: f64) -> bool {
        let pairs = self.reached.velocity.iter().zip(&self.acceleration);
        for (u, (v, a)) in self.u.iter_mut().zip(pairs) {
            *u = v + 0.5 * h * a;
        }
        let mut resolved = true;
        let joints = self.reached.configuration.0.iter().zip(&mut self.q.0);
        let joints = joints.zip(self.u.as_chunks::<3>().0).zip(robot.discs());
        for (((q, half_way), rate), disc) in joints {
            let turn = Vector3::from(*rate) * h;
            resolved &= turn.norm() <= LARGEST_TURN;
            *half_way = disc.moved(q, &(turn * 0.5));
        }
        resolved
    }

    /// One step of Newton's method: the largest change of a joint's turn half-way (rad), `None` where there is none.
    fn newton_step(
        &mut self,
        equations: &mut EquationsOfMotion,
        loads: &Loads,
        command: &[f64],
        h: f64,
        iteration: usize,
    ) -> Option<f64> {
        if !self.go_half_way(&equations.robot, h) {
            return None;
        }
        equations.enter(&self.q, &self.u, command);
        let accelerations = self.acceleration.as_chunks::<3>().0;
        let chain = &equations.posture.chain;
        for (joint, (world, own)) in self.world.iter_mut().zip(accelerations).enumerate() {
            *world = chain.axes(joint) * Vector3::from(*own);
        }
        equations.residual(&self.world, &mut self.residual);
        if iteration < FACTORISATIONS {
            let weights = [0.5 * h, 0.25 * h * h];
            (self.matrix).factorise(equations, loads, &self.q, command, weights)?;
        }
        self.matrix.solve(&self.residual, &mut self.step);
        let mut largest: f64 = 0.0;
        let chain = &equations.posture.chain;
        let joints = self.acceleration.as_chunks_mut::<3>().0.iter_mut();
        for (joint, (own, step)) in joints.zip(&self.step).enumerate() {
            let change = transpose_times(chain.dual(joint), step);
            *own = (Vector3::from(*own) - change).into();
            largest = largest.max(change.norm());
        }
        let size = 0.25 * h * h * largest;
        self.acceleration
            .iter()
            .all(|a| a.is_finite())
            .then_some(size)
    }
}
