//! One step: Newton's method on the balance of moments with contacts that stick or slip.
//!
//! The balance is `r(q) = sum_j T_j dl_j + dV_rest = 0`, with the tensions `T_j` of the segments of
//! all tendons following the capstan law. In the coordinates `q exp(xi)` its Jacobian is
//! `sum_j (T_j d2l_j + dl_j dT_j') + d2V_rest`: the second derivatives symmetric, as in
//! [`crate::energy`], the products not, nor what moments and following forces add. With every contact
//! assumed to stick or to slip in one sense, `r` is smooth; after each step the assumptions are revised (a primal-dual active set method:
//! Hintermueller, Ito and Kunisch, SIAM J. Optim. 13, 2002). Steps are shortened until the next
//! simplified correction is smaller (natural monotonicity test: Deuflhard, Newton Methods for
//! Nonlinear Problems, ch. 3), which does not mind that the robot's bends differ in stiffness by many
//! orders of magnitude, as a test of `|r|` would. Plain semismooth Newton steps jump between the two senses of slip, as
//! sticking is so much stiffer than slipping; the active set does not.

#[cfg(test)]
mod tests;

use faer::Mat;
use faer::linalg::solvers::{PartialPivLu, Solve};
use nalgebra::Vector3;

use super::line::Line;
use super::snap::Drag;
use super::{SlipState, TendonProfile};
use crate::chain::{Configuration, turned};
use crate::energy::{DeadForces, Expansion, Potential, following};
use crate::robot::{Loads, Robot};
use crate::tendon::Posture;

/// Newton steps before a solve counts as failed.
const MAX_ITERATIONS: usize = 40;
/// Largest turn of a joint in one Newton step (rad).
const MAX_TURN: f64 = 0.2;
/// Halvings of a Newton step before it counts as failed.
const MAX_HALVINGS: usize = 12;
/// A Newton step that turns no joint by more than this (rad) is taken as it is.
const ROUNDING: f64 = 1e-9;
/// Corrections of the rest lengths of tendons whose length is commanded.
const MAX_CORRECTIONS: usize = 60;

/// How the slip states are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SlipRule {
    /// By the capstan law: a tendon sticks where it can.
    Capstan,
    /// As assumed, so that the balance is smooth.
    Assumed,
}

/// The balance of one robot under one command and load, in one configuration.
#[derive(Clone, Debug)]
pub(super) struct Balance {
    robot: Robot,
    /// Largest moment left on a joint (N m); of the robot without loads, `own_tolerance`.
    pub tolerance: f64,
    own_tolerance: f64,
    /// Largest error of a commanded length (m).
    length_tolerance: f64,
    loads: Loads,
    /// The dead forces among the loads.
    weight: DeadForces,
    /// Besides those, the following forces as they are in this configuration.
    dead: DeadForces,
    /// The command, with the rest lengths of tendons whose length is commanded corrected.
    rest: Vec<f64>,
    /// What holds the joints back while the robot snaps.
    pub drag: Option<Drag>,
    pub configuration: Configuration,
    pub posture: Posture,
    pub lines: Vec<Line>,
    pub profiles: Vec<TendonProfile>,
    expansion: Expansion,
    assumed: Vec<Vec<SlipState>>,
}

impl Balance {
    pub fn new(robot: &Robot) -> Self {
        let lines: Vec<Line> = (robot.tendons().iter())
            .map(|tendon| Line::new(robot, tendon))
            .collect();
        let profiles: Vec<_> = lines.iter().map(TendonProfile::new).collect();
        Self {
            robot: robot.clone(),
            tolerance: robot.moment_tolerance(),
            own_tolerance: robot.moment_tolerance(),
            length_tolerance: robot.length_tolerance(),
            loads: Loads::default(),
            weight: DeadForces::new(robot),
            dead: DeadForces::new(robot),
            rest: vec![0.0; lines.len()],
            drag: None,
            configuration: Configuration::straight(robot),
            posture: Posture::new(robot),
            expansion: Expansion::new(robot),
            assumed: profiles.iter().map(|p| p.slip_states.clone()).collect(),
            lines,
            profiles,
        }
    }

    /// Moves to `q`.
    pub fn start_at(&mut self, q: &Configuration) {
        self.configuration.0.copy_from_slice(&q.0);
        self.place();
    }

    /// Sets the command (m or N) and the loads of the step from `before`.
    pub fn load(&mut self, command: &[f64], loads: &Loads, before: &[TendonProfile]) {
        for (t, tendon) in self.robot.tendons().iter().enumerate() {
            // The tension that holds a length is best guessed to stay.
            let correction = if tendon.holds_length() {
                before[t].tensions[0] / tendon.spring()
            } else {
                0.0
            };
            self.rest[t] = command[t] - correction;
        }
        self.tolerance = self.own_tolerance.max(self.robot.load_rounding(loads));
        self.loads.clone_from(loads);
        self.weight.set(&self.robot, loads);
    }

    /// Largest moment that is left on a joint (N m).
    pub fn residual(&self) -> f64 {
        self.expansion.residual()
    }

    /// Evaluates the balance where the robot stands, the contacts following from `before`.
    pub fn follow(&mut self, before: &[TendonProfile]) {
        self.evaluate(before, SlipRule::Capstan);
    }

    /// Solves the balance from where the robot stands, after the step from `before`; returns whether
    /// it is solved, and the Newton steps taken.
    pub fn solve(&mut self, command: &[f64], before: &[TendonProfile]) -> (bool, usize) {
        for (assumed, profile) in self.assumed.iter_mut().zip(before) {
            assumed.copy_from_slice(&profile.slip_states);
        }
        let mut iterations = 0;
        for _ in 0..MAX_CORRECTIONS {
            let (solved, steps) = self.newton(before);
            iterations += steps;
            if !solved {
                return (false, iterations);
            }
            if self.correct_rest_lengths(command) <= self.length_tolerance {
                return (true, iterations);
            }
        }
        (false, iterations)
    }

    /// Moves the rest lengths of the tendons whose length is commanded towards those that give it: the
    /// method of multipliers (Nocedal and Wright, Numerical Optimization, ch. 17). Returns the largest
    /// error (m).
    fn correct_rest_lengths(&mut self, command: &[f64]) -> f64 {
        let mut largest: f64 = 0.0;
        for (t, tendon) in self.robot.tendons().iter().enumerate() {
            if !tendon.holds_length() {
                continue;
            }
            let error = self.lines[t].length() - command[t];
            if error < 0.0 && self.profiles[t].tensions[0] == 0.0 {
                self.rest[t] = command[t];
            } else if error.abs() > self.length_tolerance {
                self.rest[t] -= error;
                largest = largest.max(error.abs());
            }
        }
        largest
    }

    fn newton(&mut self, before: &[TendonProfile]) -> (bool, usize) {
        for iteration in 0..MAX_ITERATIONS {
            self.follow(before);
            if self.residual() <= self.tolerance {
                return (true, iteration);
            }
            self.evaluate(before, SlipRule::Assumed);
            let jacobian = self.jacobian().partial_piv_lu();
            let mut step = self.correction(&jacobian);
            let size = largest_turn(&step);
            if !size.is_finite() {
                return (false, iteration);
            }
            let limit = f64::min(1.0, MAX_TURN / size);
            step.iter_mut().for_each(|turn| *turn *= limit);
            if !self.advance(&jacobian, &step, size, limit, before) {
                return (false, iteration);
            }
            for (assumed, profile) in self.assumed.iter_mut().zip(&self.profiles) {
                assumed.copy_from_slice(&profile.slip_states);
            }
        }
        self.follow(before);
        (self.residual() <= self.tolerance, MAX_ITERATIONS)
    }

    /// Takes the step, halved until the next simplified correction is smaller than `size`, that of
    /// the whole step, of which `step` is `part`. Returns whether it ever is.
    fn advance(
        &mut self,
        jacobian: &PartialPivLu<f64>,
        step: &[Vector3<f64>],
        size: f64,
        part: f64,
        before: &[TendonProfile],
    ) -> bool {
        let from = self.configuration.clone();
        let own_axes: Vec<_> = (step.iter().enumerate())
            .map(|(joint, turn)| self.posture.chain.disc(joint).tr_mul(turn))
            .collect();
        let mut share = 1.0;
        for _ in 0..MAX_HALVINGS {
            let joints = from.0.iter().zip(&own_axes);
            for (to, (from, turn)) in self.configuration.0.iter_mut().zip(joints) {
                *to = turned(from, &(turn * share));
            }
            self.place();
            self.evaluate(before, SlipRule::Assumed);
            let next = largest_turn(&self.correction(jacobian));
            if next <= (1.0 - 0.25 * share * part) * size || size * share < ROUNDING {
                return true;
            }
            share *= 0.5;
        }
        false
    }

    fn place(&mut self) {
        self.posture.place(&self.robot, &self.configuration);
        for line in &mut self.lines {
            line.lay(&self.robot, &self.posture.chain);
        }
    }

    fn evaluate(&mut self, before: &[TendonProfile], rule: SlipRule) {
        for (t, (line, profile)) in self.lines.iter().zip(&mut self.profiles).enumerate() {
            let state = self.robot.tendons()[t].state(line.length(), self.rest[t]);
            match rule {
                SlipRule::Capstan => profile.follow(line, &before[t], state.tension),
                SlipRule::Assumed => {
                    profile.assume(line, &before[t], state.tension, &self.assumed[t]);
                }
            }
        }
        self.dead.clone_from(&self.weight);
        following::add_forces(&self.loads, 1.0, &self.posture, &mut self.dead);
        let potential = Potential {
            robot: &self.robot,
            command: &self.rest,
            dead: &self.dead,
        };
        let tension = |tendon: usize, place: usize| self.profiles[tendon].tensions[place];
        let (q, posture) = (&self.configuration, &self.posture);
        potential.expand_pulled(q, posture, tension, &mut self.expansion);
        following::add_moments(&self.loads, 1.0, posture, &mut self.expansion);
        if let Some(drag) = &self.drag {
            drag.add_moments(q, posture, &mut self.expansion);
        }
    }

    /// `-J^-1 r`: the turn of each joint, world axes (rad).
    fn correction(&self, jacobian: &PartialPivLu<f64>) -> Vec<Vector3<f64>> {
        let n = self.posture.chain.centres.len();
        let mut gradient = vec![Vector3::zeros(); n];
        self.expansion.gradient(&mut gradient);
        let rhs = Mat::from_fn(3 * n, 1, |i, _| -gradient[i / 3][i % 3]);
        let solution = jacobian.solve(&rhs);
        (0..n)
            .map(|joint| Vector3::from_fn(|axis, _| solution[(3 * joint + axis, 0)]))
            .collect()
    }

    /// The Jacobian of the balance with the assumed contacts, where it was last evaluated with them.
    fn jacobian(&self) -> Mat<f64> {
        // The expansion's weights of the tendons are zero: it holds the second derivatives alone.
        let mut jacobian = following::jacobian(&self.loads, 1.0, &self.posture, &self.expansion);
        for tendon in 0..self.lines.len() {
            self.add_tension_slopes(tendon, &mut jacobian);
        }
        jacobian
    }

    /// Adds `sum_j dl_j dT_j'` of one tendon.
    fn add_tension_slopes(&self, tendon: usize, jacobian: &mut Mat<f64>) {
        let (line, profile) = (&self.lines[tendon], &self.profiles[tendon]);
        let chain = &self.posture.chain;
        let n = chain.centres.len();
        let segments = line.lengths.len();
        let by_length: Vec<Vec<Vector3<f64>>> = (0..segments)
            .map(|segment| {
                let mut slope = vec![Vector3::zeros(); n];
                line.add_length_slope(chain, segment, &mut slope);
                slope
            })
            .collect();
        // Of the tendon beyond each segment's first hole.
        let mut beyond = by_length.clone();
        for segment in (0..segments - 1).rev() {
            let (here, above) = beyond.split_at_mut(segment + 1);
            add_scaled(&mut here[segment], 1.0, &above[0]);
        }
        let state = self.robot.tendons()[tendon].state(line.length(), self.rest[tendon]);
        let mut tension: Vec<_> = beyond[0].iter().map(|b| b * state.stiffness).collect();
        for segment in 0..segments {
            if let Some(hole) = segment.checked_sub(1) {
                let contact = self.assumed[tendon][hole];
                let [by_tension, by_angle, by_beyond] = profile.slopes(line, hole, contact);
                tension.iter_mut().for_each(|t| *t *= 1.0 - by_tension);
                let mut angle = vec![Vector3::zeros(); n];
                line.add_wrap_slope(chain, hole, &mut angle);
                add_scaled(&mut tension, -by_angle, &angle);
                add_scaled(&mut tension, -by_beyond, &beyond[segment]);
            }
            for joint in line.joints(segment) {
                let row = &by_length[segment][joint];
                for (other, slope) in tension.iter().enumerate() {
                    for c in 0..3 {
                        for r in 0..3 {
                            jacobian[(3 * joint + r, 3 * other + c)] += row[r] * slope[c];
                        }
                    }
                }
            }
        }
    }
}

fn add_scaled(to: &mut [Vector3<f64>], factor: f64, from: &[Vector3<f64>]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += from * factor;
    }
}

fn largest_turn(step: &[Vector3<f64>]) -> f64 {
    step.iter().fold(0.0, |largest, turn| {
        let size = turn.norm();
        // Not `max`: a NaN must not get lost.
        if size <= largest { largest } else { size }
    })
}
