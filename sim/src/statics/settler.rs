//! From command to equilibrium: where a solve starts, and what it does when a descent stalls.

use super::Equilibrium;
use super::descent::{Descent, End};
use super::following::apply_following;
use crate::chain::Configuration;
use crate::dynamics::SmallMotionRates;
use crate::energy::following::follows;
use crate::energy::{DeadForces, Potential};
use crate::robot::{Command, Drive, Loads, Robot, Tendon};
use crate::solve::{Continuation, MAX_CORRECTIONS, length_errors};

/// Share of the way that continuation first goes in one solve, and the smallest one.
const FIRST_STRIDE: f64 = 0.25;
const MIN_STRIDE: f64 = 1e-4;

/// Settles commands of one robot one after another. Reuses its memory: after the first, a solve
/// allocates nothing.
///
/// ```
/// use tdcr_sim::robot::{Loads, Robot};
/// use tdcr_sim::statics::Settler;
///
/// let robot = Robot::load("3m")?;
/// let mut settler = Settler::new(&robot);
/// // Along a path of commands each solve starts from the last one.
/// let mut command = [0.03, 0.01, 0.0, 0.02, 0.04, 0.01, 0.0, 0.035, 0.02];
/// for _ in 0..50 {
///     command[0] -= 2e-4;
///     let settled = settler.follow(&robot.command(&command)?, &Loads::default());
///     assert!(settled.converged);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Settler {
    pub(super) robot: Robot,
    pub(super) descent: Descent,
    pub(super) dead: DeadForces,
    /// The command, with the rest lengths of tendons whose length is commanded corrected.
    pub(super) command: Vec<f64>,
    /// Largest residual (N m), and largest error of a commanded length (m), of a robot
    /// without loads.
    moment_tolerance: f64,
    length_tolerance: f64,
    /// Under loads without a potential, of a robot that can move.
    motion: Option<Box<SmallMotionRates>>,
    pub(super) equilibrium: Equilibrium,
}

impl Settler {
    /// Prepares to settle `robot`.
    pub fn new(robot: &Robot) -> Self {
        let descent = Descent::new(robot);
        Self {
            robot: robot.clone(),
            moment_tolerance: descent.tolerance,
            length_tolerance: robot.length_tolerance(),
            descent,
            dead: DeadForces::new(robot),
            command: vec![0.0; robot.tendons().len()],
            motion: None,
            equilibrium: Equilibrium::unsettled(robot),
        }
    }

    /// Settles the robot under `command` and `loads` from the straight pose, as [`Robot::settle`].
    ///
    /// # Panics
    /// If the command or the loads are of another robot, with fewer tendons or more discs.
    pub fn settle(&mut self, command: &Command, loads: &Loads) -> &Equilibrium {
        self.descent.start_straight();
        self.solve(command, loads)
    }

    /// Settles the robot from the configuration `start`: fast when that is near the equilibrium, and
    /// the way to follow one equilibrium along a path.
    ///
    /// # Panics
    /// As [`Settler::settle`]; also if `start` has another number of joints than the robot.
    pub fn settle_from(
        &mut self,
        start: &Configuration,
        command: &Command,
        loads: &Loads,
    ) -> &Equilibrium {
        self.descent.start_at(start);
        self.solve(command, loads)
    }

    /// Settles the robot from its last equilibrium: the way to follow one equilibrium along a path of
    /// commands. Its first step is a prediction that costs next to nothing: to first order, and to second
    /// where the command goes on in the direction in which it last went.
    /// Before anything has settled, the same as [`Settler::settle`].
    ///
    /// # Panics
    /// As [`Settler::settle`].
    pub fn follow(&mut self, command: &Command, loads: &Loads) -> &Equilibrium {
        if !self.equilibrium.converged {
            return self.settle(command, loads);
        }
        // With moments, following forces or commanded lengths the factor is of another problem.
        let predictable = !loads.wrenches().iter().any(follows)
            && !self.robot.tendons().iter().any(Tendon::holds_length);
        if predictable {
            self.descent.predict(&self.command, command.as_slice());
        }
        self.solve(command, loads)
    }

    /// The robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Where the robot last settled; before that, the straight pose, not converged.
    pub fn equilibrium(&self) -> &Equilibrium {
        &self.equilibrium
    }

    /// The last equilibrium.
    pub(super) fn into_equilibrium(self) -> Equilibrium {
        self.equilibrium
    }

    /// Settles `command` from wherever the descent stands.
    fn solve(&mut self, command: &Command, loads: &Loads) -> &Equilibrium {
        self.dead.set(&self.robot, loads);
        self.command.copy_from_slice(command.as_slice());
        self.descent.tolerance = self.moment_tolerance.max(self.robot.load_rounding(loads));
        let (mut end, mut iterations) = self.descend();
        if !end.is_settled() {
            let steps;
            (end, steps) = self.continue_from_mean(command);
            iterations += steps;
        }
        if end.is_settled() && loads.wrenches().iter().any(follows) {
            let steps;
            (end, steps) = self.rest(loads);
            iterations += steps;
        }
        if end.is_settled() && self.robot.tendons().iter().any(Tendon::holds_length) {
            let steps;
            (end, steps) = self.hold_lengths(end, command, loads);
            iterations += steps;
        }
        self.report(end, iterations)
    }

    fn descend(&mut self) -> (End, usize) {
        self.descent.run(&Potential {
            robot: &self.robot,
            command: &self.command,
            dead: &self.dead,
        })
    }

    /// Settles from the present configuration under all loads, those without a potential included.
    fn rest(&mut self, loads: &Loads) -> (End, usize) {
        if !loads.wrenches().iter().any(follows) {
            return self.descend();
        }
        self.dead.set(&self.robot, loads);
        if self.motion.is_none() {
            self.motion = SmallMotionRates::new(&self.robot).ok().map(Box::new);
        }
        let (descent, dead) = (&mut self.descent, &mut self.dead);
        let motion = self.motion.as_deref_mut();
        apply_following(descent, &self.robot, &self.command, dead, loads, motion)
    }

    /// Corrects the rest lengths of the tendons whose length is commanded until they have it, by Newton's
    /// steps on the dual problem. `end` is how the last descent ended.
    fn hold_lengths(&mut self, mut end: End, command: &Command, loads: &Loads) -> (End, usize) {
        let goal = command.as_slice();
        let mut iterations = 0;
        for _ in 0..MAX_CORRECTIONS {
            if !end.is_settled() {
                return (end, iterations);
            }
            let (descent, rest) = (&mut self.descent, &mut self.command);
            let lengths = &descent.iterate.posture.lengths;
            let state = |t: usize| (lengths[t], descent.expansion.tensions[t]);
            let errors = length_errors(&self.robot, goal, self.length_tolerance, rest, state);
            let Some(errors) = errors else {
                return (end, iterations);
            };
            descent.correct_rest_lengths(&errors, rest);
            let steps;
            (end, steps) = self.rest(loads);
            iterations += steps;
        }
        (End::Stalled, iterations)
    }

    /// Leads the command from one under which the robot stands straight, or nearly so, to its goal.
    fn continue_from_mean(&mut self, command: &Command) -> (End, usize) {
        let goal = command.as_slice();
        let start = self.group_means(goal);
        self.descent.start_straight();
        let mut settled = self.descent.iterate.configuration.clone();
        let mut continuation = Continuation::new(FIRST_STRIDE, MIN_STRIDE);
        let (mut end, mut iterations) = (End::Stalled, 0);
        while let Some(part) = continuation.target() {
            for (between, (from, to)) in self.command.iter_mut().zip(start.iter().zip(goal)) {
                *between = from + part * (to - from);
            }
            if part == 1.0 {
                self.command.copy_from_slice(goal);
            }
            let steps;
            (end, steps) = self.descend();
            iterations += steps;
            if end.is_settled() {
                continuation.succeed(2.0);
                settled.clone_from(&self.descent.iterate.configuration);
            } else if continuation.fail(0.25) {
                self.descent.start_at(&settled);
            } else {
                if part < 1.0 {
                    self.command.copy_from_slice(goal);
                    self.expand();
                    end = End::Stalled;
                }
                break;
            }
        }
        (end, iterations)
    }

    /// For each tendon the mean command of those that end at the same body and are driven alike.
    fn group_means(&self, goal: &[f64]) -> Vec<f64> {
        let tendons = self.robot.tendons();
        let group = |t: usize| {
            let kind = std::mem::discriminant::<Drive>(&tendons[t].drive);
            (tendons[t].route.last().map(|waypoint| waypoint.0), kind)
        };
        (0..goal.len())
            .map(|t| {
                let alike = (0..goal.len()).filter(|&other| group(other) == group(t));
                let (sum, count) =
                    alike.fold((0.0, 0.0), |(s, c), other| (s + goal[other], c + 1.0));
                sum / count
            })
            .collect()
    }

    /// The expansion at the current configuration, under the current command.
    pub(super) fn expand(&mut self) {
        let potential = Potential {
            robot: &self.robot,
            command: &self.command,
            dead: &self.dead,
        };
        let Descent {
            iterate, expansion, ..
        } = &mut self.descent;
        potential.expand(&iterate.configuration, &iterate.posture, expansion);
    }

    fn report(&mut self, end: End, iterations: usize) -> &Equilibrium {
        let (descent, out) = (&self.descent, &mut self.equilibrium);
        out.take_over(&descent.iterate.configuration, &descent.iterate.posture);
        out.tendon_tensions
            .copy_from_slice(&descent.expansion.tensions);
        out.residual = descent.expansion.residual();
        out.iterations = iterations;
        let verdict = match end {
            End::AtRest(verdict) if out.is_finite() => Some(verdict),
            _ => None,
        };
        out.stability = verdict.map(|verdict| verdict.stability);
        out.examined = verdict.map(|verdict| verdict.examined);
        out.growth = verdict.and_then(|verdict| verdict.growth);
        out.converged = end.is_settled() && out.stability.is_some();
        &self.equilibrium
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statics::{Stability, TOLERANCE};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// No standard robot needs continuation, so it is asked for here.
    #[test]
    fn continuation_settles_too_and_comes_to_the_same_place() {
        let robot = Robot::load("3m").expect("a standard robot");
        let mut settler = Settler::new(&robot);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut elsewhere = 0;
        for _ in 0..200 {
            let command = robot.random_command(&mut rng);
            let direct = settler.settle(&command, &Loads::default()).positions[14];
            let (end, _) = settler.continue_from_mean(&command);
            assert!(matches!(end, End::AtRest(verdict) if verdict.stability == Stability::Stable));
            assert!(settler.descent.expansion.residual() <= TOLERANCE);
            let apart = (settler.descent.iterate.posture.chain.positions[14] - direct).norm();
            elsewhere += usize::from(apart > 1e-7);
        }
        // Some commands have two equilibria, and another way may lead to the other one.
        assert!(elsewhere <= 10, "{elsewhere} of 200 came to rest elsewhere");
    }

    /// Where a path goes straight on, what the last prediction missed makes most second Newton steps
    /// needless; where it turns, nothing is added.
    #[test]
    fn a_straight_path_takes_little_more_than_a_newton_step() {
        let robot = Robot::load("3m").expect("a standard robot");
        let mut settler = Settler::new(&robot);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut steps = [0, 0];
        for _ in 0..20 {
            let ends = [0, 1].map(|_| robot.random_command(&mut rng));
            for (count, turning) in steps.iter_mut().zip([false, true]) {
                settler.settle(&ends[0], &Loads::default());
                for part in 1..=50 {
                    // To and fro, two steps on and one back, or straight on, equally far.
                    let place = if turning && part % 2 == 0 {
                        part - 2
                    } else {
                        part
                    };
                    let along = f64::from(place) / 100.0;
                    let pairs = ends[0].as_slice().iter().zip(ends[1].as_slice());
                    let values: Vec<f64> = pairs.map(|(a, b)| a + along * (b - a)).collect();
                    let command = robot.command(&values).expect("between two commands");
                    let settled = settler.follow(&command, &Loads::default());
                    assert!(settled.converged);
                    *count += settled.iterations;
                }
            }
        }
        let [straight, turning] = steps.map(|count| count as f64 / 1000.0);
        assert!(straight < 1.7 && turning > 1.8, "{straight} {turning}");
    }
}
