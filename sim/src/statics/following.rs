//! Equilibria under loads without a potential: moments, and forces that turn with their disc.
//!
//! The Jacobian of the moments on the joints is not symmetric, so these solves are dense: Newton's method with a line
//! search on the residual, the loads applied by continuation from the equilibrium without them.

use faer::Mat;
use faer::linalg::solvers::Solve;
use nalgebra::Vector3;

use super::descent::{Descent, End};
use super::stability::{Stability, of_jacobian};
use crate::energy::following::{add_forces, add_moments, jacobian};
use crate::energy::{DeadForces, Expansion, Potential};
use crate::robot::{Loads, Robot};

/// Newton steps before a share of the loads counts as too large a step.
const MAX_ITERATIONS: usize = 40;
/// Smallest share of the loads added at once.
const MIN_SHARE: f64 = 1e-4;
/// Largest turn of a joint in one step (rad).
const MAX_TURN: f64 = 0.3;

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
