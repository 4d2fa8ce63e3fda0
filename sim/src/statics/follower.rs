//! Loads without a potential: moments, and forces that turn with their disc.
//!
//! They enter as the dead forces and moments that they are in the current configuration; what is
//! missing then in the Jacobian is how they turn with their disc, and that turns do not commute. The
//! Jacobian is no longer symmetric, so these solves are dense: Newton's method with a line search on
//! the moments left, the loads growing from nothing at the equilibrium without them.

use faer::Mat;
use faer::linalg::solvers::Solve;
use nalgebra::{Matrix3, Vector3};

use super::descent::{Descent, End};
use super::stability::{Stability, of_jacobian};
use crate::energy::{DeadForces, Expansion, Potential, add_block};
use crate::robot::{Frame, Loads, Robot, Wrench};
use crate::tendon::Posture;

/// Newton steps before a share of the loads counts as too large a step.
const MAX_ITERATIONS: usize = 40;
/// Smallest share of the loads added at once.
const MIN_SHARE: f64 = 1e-4;
/// Largest turn of a joint in one step (rad).
const MAX_TURN: f64 = 0.3;

/// Whether a wrench has a part without a potential.
pub(crate) fn follows(wrench: &Wrench) -> bool {
    let some = |vector: [f64; 3]| vector.iter().any(|x| *x != 0.0);
    some(wrench.moment) || (wrench.frame == Frame::Disc && some(wrench.force))
}

/// Force and moment of the part of a wrench without a potential, world axes.
pub(crate) fn follower(
    wrench: &Wrench,
    orientation: &Matrix3<f64>,
) -> (Vector3<f64>, Vector3<f64>) {
    let (force, moment) = (Vector3::from(wrench.force), Vector3::from(wrench.moment));
    match wrench.frame {
        Frame::World => (Vector3::zeros(), moment),
        Frame::Disc => (orientation * force, orientation * moment),
    }
}

/// Adds to the expansion's gradient what `share` of the moments is in this posture. The forces must be
/// in its dead forces: see [`add_forces`].
pub(crate) fn add_moments(loads: &Loads, share: f64, posture: &Posture, expansion: &mut Expansion) {
    for wrench in loads.wrenches().iter().filter(|wrench| follows(wrench)) {
        let (_, moment) = follower(wrench, posture.chain.disc(wrench.disc));
        expansion.disc_gradient[wrench.disc] -= moment * share;
    }
}

/// Adds to `dead` what `share` of the forces without a potential is in this posture.
pub(crate) fn add_forces(loads: &Loads, share: f64, posture: &Posture, dead: &mut DeadForces) {
    for wrench in loads.wrenches().iter().filter(|wrench| follows(wrench)) {
        let (force, _) = follower(wrench, posture.chain.disc(wrench.disc));
        dead.at_origin[wrench.disc] += force * share;
    }
}

/// The Jacobian `3 n x 3 n` of the moments left by the joints' turns, world axes (N m/rad): the
/// expansion's Hessian, and what `share` of the loads without a potential add to it.
///
/// With `M` a moment and `F` a force on disc `m`, `d_k` its origin from joint `k`, blocks `k, i <= m`
/// get `-1/2 [M]x` (world frame) or `1/2 [M]x` (disc frame), and `[d_k]x [F]x`.
pub(crate) fn jacobian(
    loads: &Loads,
    share: f64,
    posture: &Posture,
    expansion: &Expansion,
) -> Mat<f64> {
    let mut jacobian = expansion.dense();
    let chain = &posture.chain;
    for wrench in loads.wrenches().iter().filter(|wrench| follows(wrench)) {
        let (force, moment) = follower(wrench, chain.disc(wrench.disc));
        let half = match wrench.frame {
            Frame::World => -0.5,
            Frame::Disc => 0.5,
        };
        let twist = (moment * (half * share)).cross_matrix();
        let turning = (force * share).cross_matrix();
        for k in 0..=wrench.disc {
            let arm = chain.positions[wrench.disc] - chain.centres[k];
            let block = twist + arm.cross_matrix() * turning;
            for i in 0..=wrench.disc {
                add_block(&mut jacobian, k, i, &block);
            }
        }
    }
    jacobian
}

/// Brings the loads without a potential on, from the equilibrium without them where `descent` stands.
/// `dead` holds the dead forces, and on return also the following ones.
pub(super) fn bring_on(
    descent: &mut Descent,
    robot: &Robot,
    command: &[f64],
    dead: &mut DeadForces,
    loads: &Loads,
) -> (End, usize) {
    let weight = dead.clone();
    let mut settled = descent.configuration.clone();
    let (mut done, mut stride, mut iterations) = (0.0, 1.0, 0);
    while done < 1.0 {
        let share = f64::min(done + stride, 1.0);
        let mut balance = Balance {
            robot,
            command,
            weight: &weight,
            dead: &mut *dead,
            loads,
            share,
        };
        let (end, steps) = balance.solve(descent);
        iterations += steps;
        match end {
            End::AtRest(_) => {
                done = share;
                stride *= 2.0;
                settled.clone_from(&descent.configuration);
            }
            End::Stalled if stride < MIN_SHARE => {
                // What is left is reported of the loads asked for, where the robot last rested.
                balance.share = 1.0;
                descent.start_at(&settled);
                balance.expand(descent);
                return (End::Stalled, iterations);
            }
            End::Stalled => {
                stride /= 4.0;
                descent.start_at(&settled);
            }
        }
    }
    let jacobian = jacobian(loads, 1.0, &descent.posture, &descent.expansion);
    let stability = of_jacobian(&jacobian, descent.tolerance);
    (End::AtRest(stability), iterations)
}

/// The balance of moments under a share of the loads.
struct Balance<'a> {
    robot: &'a Robot,
    command: &'a [f64],
    /// The dead forces alone.
    weight: &'a DeadForces,
    dead: &'a mut DeadForces,
    loads: &'a Loads,
    share: f64,
}

impl Balance<'_> {
    fn solve(&mut self, descent: &mut Descent) -> (End, usize) {
        self.expand(descent);
        let mut left = squared_norm(&descent.expansion);
        for iteration in 0..MAX_ITERATIONS {
            if descent.expansion.residual() <= descent.tolerance {
                // What kind of equilibrium matters under all of the loads.
                return (End::AtRest(Stability::Neutral), iteration);
            }
            let step = self.newton_step(descent);
            let from = descent.configuration.clone();
            let axes: Vec<_> = (0..step.len())
                .map(|i| *descent.posture.chain.disc(i))
                .collect();
            let mut share = 1.0;
            loop {
                for (i, turn) in step.iter().enumerate() {
                    let own_axes = axes[i].tr_mul(turn) * share;
                    descent.configuration.0[i] = crate::chain::turned(&from.0[i], &own_axes);
                }
                descent.posture.place(self.robot, &descent.configuration);
                self.expand(descent);
                let now = squared_norm(&descent.expansion);
                if now < left * (1.0 - 1e-4 * share) || now.sqrt() <= descent.tolerance {
                    left = now;
                    break;
                }
                share *= 0.5;
                if share < 1e-6 {
                    return (End::Stalled, iteration);
                }
            }
        }
        (End::Stalled, MAX_ITERATIONS)
    }

    fn expand(&mut self, descent: &mut Descent) {
        self.dead.clone_from(self.weight);
        add_forces(self.loads, self.share, &descent.posture, self.dead);
        let potential = Potential {
            robot: self.robot,
            command: self.command,
            dead: self.dead,
        };
        potential.expand(
            &descent.configuration,
            &descent.posture,
            &mut descent.expansion,
        );
        add_moments(
            self.loads,
            self.share,
            &descent.posture,
            &mut descent.expansion,
        );
    }

    fn newton_step(&self, descent: &Descent) -> Vec<Vector3<f64>> {
        let n = descent.expansion.joint_blocks.len();
        let mut gradient = vec![Vector3::zeros(); n];
        descent.expansion.gradient(&mut gradient);
        let jacobian = jacobian(self.loads, self.share, &descent.posture, &descent.expansion);
        let rhs = Mat::from_fn(3 * n, 1, |i, _| -gradient[i / 3][i % 3]);
        let solution = jacobian.partial_piv_lu().solve(&rhs);
        let step = |i: usize| Vector3::from_fn(|axis, _| solution[(3 * i + axis, 0)]);
        let mut step: Vec<_> = (0..n).map(step).collect();
        let largest = step.iter().map(Vector3::norm).fold(0.0, f64::max);
        if largest > MAX_TURN {
            step.iter_mut().for_each(|turn| *turn *= MAX_TURN / largest);
        }
        step
    }
}

fn squared_norm(expansion: &Expansion) -> f64 {
    let mut gradient = vec![Vector3::zeros(); expansion.joint_blocks.len()];
    expansion.gradient(&mut gradient);
    gradient.iter().map(Vector3::norm_squared).sum()
}
