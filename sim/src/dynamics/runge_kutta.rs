//! The classical Runge-Kutta method on the rotation group (Munthe-Kaas, Applied Numerical Mathematics 29, 1999).
//!
//! A joint's rotation over a step is `q exp(theta)`; `theta` follows `dtheta/dt = J^-1(theta) v` with the rates `v` and the right
//! Jacobian `J` of the exponential map, and the method integrates `theta` and `v`. Of hinges, `theta` are steps of the angles.

use nalgebra::Vector3;

use super::State;
use super::acceleration::EquationsOfMotion;
use crate::chain::Configuration;
use crate::robot::Robot;

/// Workspace of the method.
#[derive(Clone, Debug)]
pub(super) struct RungeKutta {
    q: Configuration,
    v: Vec<f64>,
    /// Rate of the turn since the step's start, and the acceleration, at the last stage.
    rate: Vec<f64>,
    acceleration: Vec<f64>,
    /// Their weighted sums over the stages.
    turn_sum: Vec<f64>,
    acceleration_sum: Vec<f64>,
}

impl RungeKutta {
    pub fn new(robot: &Robot) -> Box<Self> {
        let zeros = || vec![0.0; robot.dof()];
        Box::new(Self {
            q: Configuration::straight(robot),
            v: zeros(),
            rate: zeros(),
            acceleration: zeros(),
            turn_sum: zeros(),
            acceleration_sum: zeros(),
        })
    }

    /// The joints' turns in the last step (rad), three entries each.
    pub fn turns(&self) -> &[f64] {
        &self.turn_sum
    }

    pub fn step(
        &mut self,
        equations: &mut EquationsOfMotion,
        state: &mut State,
        command: &[f64],
        armatures: &[Vector3<f64>],
        h: f64,
    ) {
        self.rate.fill(0.0);
        self.acceleration.fill(0.0);
        self.turn_sum.fill(0.0);
        self.acceleration_sum.fill(0.0);
        for (ahead, weight) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
            self.stage(equations, state, command, armatures, ahead * h);
            add(&mut self.turn_sum, weight * h / 6.0, &self.rate);
            add(
                &mut self.acceleration_sum,
                weight * h / 6.0,
                &self.acceleration,
            );
        }
        // q+ = q exp(theta), v+ = v plus the weighted accelerations.
        let turns = self.turn_sum.as_chunks::<3>().0;
        let joints = state
            .configuration
            .0
            .iter_mut()
            .zip(equations.robot.discs());
        for ((q, disc), turn) in joints.zip(turns) {
            *q = disc.moved(q, &Vector3::from(*turn));
        }
        add(&mut state.velocity, 1.0, &self.acceleration_sum);
    }

    /// Rates at the stage that lies `ahead` of the start along the last stage's rates.
    fn stage(
        &mut self,
        equations: &mut EquationsOfMotion,
        start: &State,
        command: &[f64],
        armatures: &[Vector3<f64>],
        ahead: f64,
    ) {
        // v and q of the stage, and dtheta/dt there.
        self.v.copy_from_slice(&start.velocity);
        add(&mut self.v, ahead, &self.acceleration);
        let stage = self.q.0.iter_mut().zip(self.v.as_chunks::<3>().0);
        let joints = start
            .configuration
            .0
            .iter()
            .zip(self.rate.as_chunks_mut::<3>().0);
        let joints = joints.zip(stage).zip(equations.robot.discs());
        for (((start, rate), (q, v)), disc) in joints {
            let (turn, v) = (Vector3::from(*rate) * ahead, Vector3::from(*v));
            *q = disc.moved(start, &turn);
            if disc.hinges.is_some() {
                *rate = v.into();
                continue;
            }
            // The inverse right Jacobian of the exponential map, to the order that the method needs.
            let commutator = turn.cross(&v);
            *rate = (v + commutator * 0.5 + turn.cross(&commutator) / 12.0).into();
        }
        equations.accelerate(&self.q, &self.v, command, armatures, &mut self.acceleration);
    }
}

fn add(sum: &mut [f64], factor: f64, terms: &[f64]) {
    for (sum, term) in sum.iter_mut().zip(terms) {
        *sum += factor * term;
    }
}
