//! One substep: Newton's method on the balance of moments with contacts that stick or slip.
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

mod linear;
mod pressed;

use super::snap::Drag;
use super::{SlipState, TendonProfile};
use crate::capstan::Line;
use crate::chain::Configuration;
use crate::energy::{DeadForces, Expansion, Potential, Pressing, following};
use crate::robot::{Loads, Robot};
use crate::solve::{
    Correction, Iterate, MAX_CORRECTIONS, System, largest_turn, length_errors, newton,
};
use linear::Linear;

/// Largest turn of a joint in one Newton step (rad).
const MAX_TURN: f64 = 0.2;
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
    pub(super) robot: Robot,
    /// Largest residual (N m); of the robot without loads, `own_tolerance`.
    pub tolerance: f64,
    own_tolerance: f64,
    /// Largest error of a commanded length (m).
    length_tolerance: f64,
    pub(super) loads: Loads,
    /// The dead forces among the loads.
    weight: DeadForces,
    /// Besides those, the following forces as they are in this configuration.
    dead: DeadForces,
    /// The command, with the rest lengths of tendons whose length is commanded corrected.
    pub(super) rest: Vec<f64>,
    /// What holds the joints back while the robot snaps.
    pub drag: Option<Drag>,
    /// Forces of contacts with obstacles and itself, where there are any.
    pub pressing: Pressing,
    pub iterate: Iterate,
    pub lines: Vec<Line>,
    pub profiles: Vec<TendonProfile>,
    pub(super) expansion: Expansion,
    pub(super) assumed: Vec<Vec<SlipState>>,
    pub(super) linear: Linear,
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
            pressing: Pressing::none(robot.discs().len()),
            iterate: Iterate::new(robot),
            expansion: Expansion::new(robot),
            assumed: profiles.iter().map(|p| p.slip_states.clone()).collect(),
            linear: Linear::new(robot),
            lines,
            profiles,
        }
    }

    /// Moves to `q`.
    pub fn start_at(&mut self, q: &Configuration) {
        self.iterate.set(q);
        self.lay();
    }

    /// Sets the command (m or N) and the loads of the step from `before`.
    pub fn load(&mut self, command: &[f64], loads: &Loads, before: &[TendonProfile]) {
        self.guess_rest(command, before);
        self.tolerance = self.own_tolerance.max(self.robot.load_rounding(loads));
        self.loads.clone_from(loads);
        self.weight.set(&self.robot, loads);
    }

    /// Rest lengths of the tendons for the step from `before`.
    pub fn guess_rest(&mut self, command: &[f64], before: &[TendonProfile]) {
        for (t, tendon) in self.robot.tendons().iter().enumerate() {
            // The tension that holds a length is best guessed to stay.
            let correction = if tendon.holds_length() {
                before[t].tensions[0] / tendon.spring()
            } else {
                0.0
            };
            self.rest[t] = command[t] - correction;
        }
    }

    /// The residual (N m): [`Expansion::residual`].
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
        self.assume(before);
        self.correcting(command, |balance| newton(&mut Substep { balance, before }))
    }

    /// Assumes that contacts at the holes do what they do in these profiles.
    fn assume(&mut self, profiles: &[TendonProfile]) {
        for (assumed, profile) in self.assumed.iter_mut().zip(profiles) {
            assumed.copy_from_slice(&profile.slip_states);
        }
    }

    /// Revises what is assumed, by the present profiles.
    fn revise(&mut self) {
        for (assumed, profile) in self.assumed.iter_mut().zip(&self.profiles) {
            assumed.copy_from_slice(&profile.slip_states);
        }
    }

    /// Repeats a solve until the tendons whose length is commanded have it.
    fn correcting(
        &mut self,
        command: &[f64],
        mut solve: impl FnMut(&mut Self) -> (bool, usize),
    ) -> (bool, usize) {
        let mut iterations = 0;
        for _ in 0..MAX_CORRECTIONS {
            let (solved, steps) = solve(self);
            iterations += steps;
            if !solved || self.correct_rest_lengths(command) {
                return (solved, iterations);
            }
        }
        (false, iterations)
    }

    /// Corrects the rest lengths of the tendons whose length is commanded by first-order steps of the
    /// multipliers: the tension grows by the penalty's stiffness times the error. Returns whether they
    /// have the lengths commanded already.
    pub fn correct_rest_lengths(&mut self, command: &[f64]) -> bool {
        let state = |t: usize| (self.lines[t].length(), self.profiles[t].tensions[0]);
        let (tolerance, rest) = (self.length_tolerance, &mut self.rest);
        let Some(errors) = length_errors(&self.robot, command, tolerance, rest, state) else {
            return true;
        };
        for (tendon, error) in errors {
            if error.abs() > tolerance {
                rest[tendon] -= error;
            }
        }
        false
    }

    /// Lays the tendons through their holes.
    fn lay(&mut self) {
        for line in &mut self.lines {
            line.lay(&self.robot, &self.iterate.posture.chain);
        }
    }

    fn evaluate(&mut self, before: &[TendonProfile], rule: SlipRule) {
        // Tensions along each tendon.
        for (t, (line, profile)) in self.lines.iter().zip(&mut self.profiles).enumerate() {
            let state = self.robot.tendons()[t].state(line.length(), self.rest[t]);
            match rule {
                SlipRule::Capstan => profile.follow(line, &before[t], state.tension),
                SlipRule::Assumed => {
                    profile.assume(line, &before[t], state.tension, &self.assumed[t]);
                }
            }
        }
        self.expand();
    }

    /// Takes these tensions along the tendons, and evaluates the balance with them.
    pub fn take(&mut self, profiles: &[TendonProfile]) {
        self.profiles.clone_from_slice(profiles);
        self.expand();
    }

    /// Residual and second derivatives under the tensions of the profiles.
    fn expand(&mut self) {
        // Following forces as they are here.
        self.dead.clone_from(&self.weight);
        let (q, posture) = (&self.iterate.configuration, &self.iterate.posture);
        following::add_forces(&self.loads, 1.0, posture, &mut self.dead);
        self.pressing.add_to(&mut self.dead);
        let potential = Potential {
            robot: &self.robot,
            command: &self.rest,
            dead: &self.dead,
        };
        let tension = |tendon: usize, place: usize| self.profiles[tendon].tensions[place];
        potential.expand_pulled(q, posture, tension, &mut self.expansion);
        following::add_moments(&self.loads, 1.0, posture, &mut self.expansion);
        if let Some(drag) = &self.drag {
            drag.add_moments(q, posture, &mut self.expansion);
        }
    }
}

/// The solve of one substep of a path.
struct Substep<'a> {
    balance: &'a mut Balance,
    before: &'a [TendonProfile],
}

impl System for Substep<'_> {
    type Model = Correction;
    const MAX_STEPS: usize = 40;
    const MAX_TRIALS: usize = 12;

    fn iterate(&mut self) -> &mut Iterate {
        &mut self.balance.iterate
    }

    fn is_solved(&mut self) -> bool {
        self.balance.follow(self.before);
        self.balance.residual() <= self.balance.tolerance
    }

    fn newton_step(&mut self) -> Correction {
        let balance = &mut *self.balance;
        balance.evaluate(self.before, SlipRule::Assumed);
        balance.linearise();
        balance.newton_step();
        balance
            .iterate
            .step
            .copy_from_slice(&balance.linear.solution);
        balance.iterate.limit_step(MAX_TURN);
        let size = largest_turn(&balance.linear.solution);
        Correction::new(size, largest_turn(&balance.iterate.step))
    }

    /// Where the simplified correction, by the Jacobian at the start of the step, is smaller than the step.
    /// Then revises the assumptions on the contacts.
    fn accepts(&mut self, model: &Correction, share: f64) -> bool {
        let balance = &mut *self.balance;
        balance.lay();
        balance.evaluate(self.before, SlipRule::Assumed);
        balance.newton_step();
        let next = largest_turn(&balance.linear.solution);
        let accepted = model.improves(share, next);
        if accepted {
            balance.revise();
        }
        accepted
    }
}
