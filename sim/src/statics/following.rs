//! Equilibria under loads without a potential: moments, and forces that turn with their disc.
//!
//! The Jacobian of the moments on the joints is not symmetric ([`LoadedFactor`]): Newton's method with a line search on the
//! residual, the loads applied by continuation from the equilibrium without them.

use nalgebra::Vector3;

use super::descent::{Descent, End};
use super::verdict::Verdict;
use crate::dynamics::SmallMotionRates;
use crate::energy::following::{add_forces, add_moments};
use crate::energy::{DeadForces, Expansion, Potential};
use crate::factor::{LoadedFactor, LoadedMatrix, Side};
use crate::robot::{Loads, Robot};
use crate::solve::{Continuation, Iterate, System, newton};

/// Smallest share of the loads added at once.
const MIN_SHARE: f64 = 1e-4;
/// Largest turn of a joint in one step (rad).
const MAX_TURN: f64 = 0.3;
/// Share of the decrease by the linear model that a step must bring.
const ENOUGH: f64 = 1e-4;

/// Applies the loads without a potential by continuation, from the equilibrium without them where
/// `descent` stands. `dead` holds the dead forces, and on return also the following ones; `motion` is of a robot that can move.
/// Returns how that ended, and the Newton steps taken.
pub(super) fn apply_following(
    descent: &mut Descent,
    robot: &Robot,
    command: &[f64],
    dead: &mut DeadForces,
    loads: &Loads,
    motion: Option<&mut SmallMotionRates>,
) -> (End, usize) {
    let weight = dead.clone();
    let mut settled = descent.iterate.configuration.clone();
    let mut continuation = Continuation::new(1.0, MIN_SHARE);
    let mut iterations = 0;
    while let Some(share) = continuation.target() {
        let mut balance = FollowingLoads {
            robot,
            command,
            weight: &weight,
            dead: &mut *dead,
            loads,
            share,
            merit: 0.0,
            descent: &mut *descent,
        };
        let (rests, steps) = balance.solve();
        iterations += steps;
        if rests {
            continuation.succeed(2.0);
            settled.clone_from(&descent.iterate.configuration);
        } else if continuation.fail(0.25) {
            descent.start_at(&settled);
        } else {
            // The residual reported is that of the loads asked for, where the robot last rested.
            balance.share = 1.0;
            balance.descent.start_at(&settled);
            balance.expand();
            return (End::Stalled, iterations);
        }
    }
    let verdict = Verdict::under_loads(descent, command, loads, motion);
    (End::AtRest(verdict), iterations)
}

/// The moments on the joints under a share of the loads.
struct FollowingLoads<'a> {
    robot: &'a Robot,
    command: &'a [f64],
    /// The dead forces alone.
    weight: &'a DeadForces,
    dead: &'a mut DeadForces,
    loads: &'a Loads,
    share: f64,
    /// Squared residual (N² m²) at the start of the step.
    merit: f64,
    descent: &'a mut Descent,
}

impl FollowingLoads<'_> {
    /// Settles under the share of the loads, from where the descent stands. A share that takes all of the
    /// steps counts as too large.
    fn solve(&mut self) -> (bool, usize) {
        self.expand();
        self.merit = squared_norm(&self.descent.expansion);
        let (rests, steps) = newton(self);
        (rests && steps < Self::MAX_STEPS, steps)
    }

    fn expand(&mut self) {
        let Iterate {
            configuration,
            posture,
            ..
        } = &self.descent.iterate;
        let expansion = &mut self.descent.expansion;
        self.dead.clone_from(self.weight);
        add_forces(self.loads, self.share, posture, self.dead);
        let potential = Potential {
            robot: self.robot,
            command: self.command,
            dead: self.dead,
        };
        potential.expand(configuration, posture, expansion);
        add_moments(self.loads, self.share, posture, expansion);
    }
}

impl System for FollowingLoads<'_> {
    type Model = ();
    const MAX_STEPS: usize = 40;
    const MAX_TRIALS: usize = 20;

    fn iterate(&mut self) -> &mut Iterate {
        &mut self.descent.iterate
    }

    /// Of the expansion, which is already that at the iterate.
    fn is_solved(&mut self) -> bool {
        self.descent.expansion.residual() <= self.descent.tolerance
    }

    fn newton_step(&mut self) {
        let Descent {
            iterate, expansion, ..
        } = &mut *self.descent;
        let factor = LoadedFactor::new(&LoadedMatrix {
            loads: self.loads,
            share: self.share,
            posture: &iterate.posture,
            expansion,
        });
        let (joint, disc) = (&expansion.joint_gradient, &expansion.disc_gradient);
        factor.solve(joint, disc, Side::Matrix, &mut iterate.step);
        iterate.step.iter_mut().for_each(|turn| *turn = -*turn);
        iterate.limit_step(MAX_TURN);
    }

    fn accepts(&mut self, (): &(), share: f64) -> bool {
        self.expand();
        let merit = squared_norm(&self.descent.expansion);
        let accepted =
            merit < self.merit * (1.0 - ENOUGH * share) || merit.sqrt() <= self.descent.tolerance;
        if accepted {
            self.merit = merit;
        }
        accepted
    }
}

fn squared_norm(expansion: &Expansion) -> f64 {
    let mut gradient = vec![Vector3::zeros(); expansion.joint_blocks.len()];
    expansion.gradient(&mut gradient);
    gradient.iter().map(Vector3::norm_squared).sum()
}
