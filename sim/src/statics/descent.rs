//! Newton's method on the potential, from one configuration down to an equilibrium.
//!
//! Where the Hessian is indefinite, all joints are stiffened in proportion to the residual moments until it is not (a
//! multiple of the identity added to the Hessian: Nocedal and Wright, Numerical Optimization, section 3.4). That takes 5.5 to
//! 6.6 steps on average, and reflecting the negative eigenvalues 9 to 10: bends then spread evenly over the joints.

use faer::Mat;
use faer::linalg::solvers::Solve;
use nalgebra::{UnitQuaternion, Vector3};

use super::Stability;
use super::tolerance::moment_tolerance;
use crate::chain::{Configuration, turned};
use crate::energy::{Expansion, Potential};
use crate::factor::{Curvature, Factor};
use crate::robot::{Robot, joints_along};
use crate::tendon::Posture;

/// Newton steps before a descent counts as stalled.
const MAX_ITERATIONS: usize = 100;
/// Largest turn of a joint in one step (rad).
const MAX_TURN: f64 = 0.5;
/// Turn of the joint that turns most when a saddle is left (rad).
const SADDLE_TURN: f64 = 0.1;
/// Stiffness first given to the joints where the Hessian is indefinite, for each N m left (1/rad).
const STIFFENING: f64 = 0.1;
/// Attempts at making the Hessian positive definite, each four times as stiff as the one before.
const MAX_STIFFENINGS: usize = 10;
/// Cosine of the angle between changes of the command that count as of one direction.
const PARALLEL: f64 = 0.99;
/// Halvings of a step before it counts as failed.
const MAX_HALVINGS: usize = 30;
/// Share of the energy that is rounding.
const ENERGY_ROUNDING: f64 = 1e-13;
/// Energy (J) that terms of both signs may have before they cancel, for each N m of the tolerance.
const CANCELLING: f64 = 1e7;

/// State and workspace of a Newton descent on the potential energy.
#[derive(Clone, Debug)]
pub(super) struct Descent {
    robot: Robot,
    pub configuration: Configuration,
    pub posture: Posture,
    pub expansion: Expansion,
    pub factor: Factor,
    /// Largest moment left on a joint (N m) at which the robot counts as at rest.
    pub tolerance: f64,
    trial: Configuration,
    trial_posture: Posture,
    gradient: Vec<Vector3<f64>>,
    /// No terms of discs.
    none: Vec<Vector3<f64>>,
    step: Vec<Vector3<f64>>,
    /// What the last prediction was made for, and came to.
    prediction: Prediction,
}

/// A prediction to first order, and what it missed.
#[derive(Clone, Debug)]
struct Prediction {
    /// How the command changed (m or N).
    change: Vec<f64>,
    configuration: Configuration,
}

/// How a descent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// In an equilibrium of this kind.
    AtRest(Stability),
    /// Where moments are left.
    Stalled,
}

impl End {
    /// Whether the end is an equilibrium that is not unstable.
    pub fn is_settled(self) -> bool {
        matches!(self, Self::AtRest(Stability::Stable | Stability::Neutral))
    }
}

impl Descent {
    pub fn new(robot: &Robot) -> Self {
        let configuration = Configuration::straight(robot);
        let mut posture = Posture::new(robot);
        posture.place(robot, &configuration);
        let expansion = Expansion::new(robot);
        let tolerance = moment_tolerance(robot, &posture.lengths);
        let zero = vec![Vector3::zeros(); robot.discs().len()];
        Self {
            robot: robot.clone(),
            trial: configuration.clone(),
            configuration,
            trial_posture: posture.clone(),
            posture,
            factor: Factor::new(&expansion),
            expansion,
            tolerance,
            gradient: zero.clone(),
            none: zero.clone(),
            step: zero,
            prediction: Prediction {
                change: vec![0.0; robot.tendons().len()],
                configuration: Configuration::straight(robot),
            },
        }
    }

    /// Starts from the straight pose.
    pub fn start_straight(&mut self) {
        self.prediction.change.fill(0.0);
        self.configuration.0.fill(UnitQuaternion::identity());
        self.posture.place(&self.robot, &self.configuration);
    }

    /// Starts from `q`.
    pub fn start_at(&mut self, q: &Configuration) {
        self.prediction.change.fill(0.0);
        self.configuration.0.copy_from_slice(&q.0);
        self.posture.place(&self.robot, &self.configuration);
    }

    /// Moves from the equilibrium under the command `from`, where the last descent ended, to where that
    /// under `to` is to first order: a step with the factor that is there already. Where the command
    /// goes on as it last did, what the last prediction missed is added, so the error is of third order.
    pub fn predict(&mut self, from: &[f64], to: &[f64]) {
        let slots = self.expansion.columns.slots;
        self.gradient.fill(Vector3::zeros());
        for (t, tendon) in self.robot.tendons().iter().enumerate() {
            let state = tendon.state(self.posture.lengths[t], to[t]);
            let change = state.tension - self.expansion.tensions[t];
            if change == 0.0 {
                continue;
            }
            let slot = self.expansion.columns.slot[t];
            for joint in joints_along(&tendon.route) {
                self.gradient[joint] += self.expansion.slopes[joint * slots + slot] * change;
            }
        }
        self.factor
            .descend(&self.gradient, &self.none, &mut self.step);
        self.limit_step();
        let again = self.prediction.again(from, to);
        let joints = self.configuration.0.iter_mut().enumerate();
        for ((i, q), predicted) in joints.zip(&mut self.prediction.configuration.0) {
            let missed = (predicted.inverse() * *q).imag() * (2.0 * again);
            *predicted = turned(q, &self.posture.chain.disc(i).tr_mul(&self.step[i]));
            *q = turned(predicted, &missed);
        }
        self.posture.place(&self.robot, &self.configuration);
    }

    /// Descends to an equilibrium that is not unstable; also returns the Newton steps taken. The
    /// expansion is that of the last configuration.
    pub fn run(&mut self, potential: &Potential) -> (End, usize) {
        let mut energy = potential.energy(&self.configuration, &self.posture);
        let mut iteration = 0;
        loop {
            potential.expand(&self.configuration, &self.posture, &mut self.expansion);
            let curvature = self.factor.factorise(&self.expansion, 0.0);
            let end = if self.expansion.residual() <= self.tolerance {
                let stability = self.stability(potential, curvature);
                if stability != Stability::Unstable {
                    return (End::AtRest(stability), iteration);
                }
                self.factor.negative_curvature(&mut self.step);
                self.scale_saddle_step();
                End::AtRest(Stability::Unstable)
            } else {
                self.stiffen(curvature);
                let (joint, disc) = (
                    &self.expansion.joint_gradient,
                    &self.expansion.disc_gradient,
                );
                self.factor.descend(joint, disc, &mut self.step);
                self.limit_step();
                End::Stalled
            };
            if iteration == MAX_ITERATIONS {
                return (end, iteration);
            }
            match self.advance(potential, energy) {
                Some(lower) => energy = lower,
                None => return (end, iteration),
            }
            iteration += 1;
        }
    }

    /// Moves the rest lengths of tendons that are longer than they should be by `errors` (tendon, m),
    /// such that to first order the errors vanish at the equilibrium that follows.
    pub fn correct_rest_lengths(&mut self, errors: &[(usize, f64)], rest: &mut [f64]) {
        self.factor.factorise(&self.expansion, 0.0);
        let columns = self.expansion.dense_columns();
        // How much each length grows for each tendon's pull (m/N).
        let mut compliance = Mat::zeros(errors.len(), errors.len());
        for (j, (pulled, _)) in errors.iter().enumerate() {
            self.factor
                .descend(&columns[*pulled].1, &self.none, &mut self.step);
            for (i, (tendon, _)) in errors.iter().enumerate() {
                let growth = columns[*tendon].1.iter().zip(&self.step);
                compliance[(i, j)] = growth.map(|(a, w)| -a.dot(w)).sum::<f64>();
            }
        }
        let wanted = Mat::from_fn(errors.len(), 1, |i, _| errors[i].1);
        let pulls = compliance.partial_piv_lu().solve(&wanted);
        for (i, (tendon, _)) in errors.iter().enumerate() {
            rest[*tendon] -= pulls[(i, 0)] / self.expansion.weights[*tendon];
        }
    }

    /// Where the Hessian is not positive definite, factorises it with the joints stiffened alike, in
    /// proportion to the moments left (Levenberg and Marquardt): the step then spreads bends evenly
    /// over the joints, as constant curvature would.
    fn stiffen(&mut self, mut curvature: Curvature) {
        let mut stiffness = STIFFENING * self.expansion.residual();
        for _ in 0..MAX_STIFFENINGS {
            if curvature == Curvature::Positive {
                break;
            }
            curvature = self.factor.factorise(&self.expansion, stiffness);
            stiffness *= 4.0;
        }
    }

    /// A direction of negative curvature has no preferred sense; the one in which its largest
    /// component, in the discs' axes, is positive is taken.
    fn scale_saddle_step(&mut self) {
        let mut largest: f64 = 0.0;
        for (i, turn) in self.step.iter().enumerate() {
            for component in self.posture.chain.disc(i).tr_mul(turn).iter() {
                if component.abs() > largest.abs() {
                    largest = *component;
                }
            }
        }
        let scale = SADDLE_TURN / largest;
        self.step.iter_mut().for_each(|turn| *turn *= scale);
    }

    fn limit_step(&mut self) {
        let squared = self.step.iter().map(Vector3::norm_squared);
        let largest = squared.fold(0.0, f64::max).sqrt();
        if largest > MAX_TURN {
            let scale = MAX_TURN / largest;
            self.step.iter_mut().for_each(|turn| *turn *= scale);
        }
    }

    /// Takes the step, halved until the energy falls enough (Armijo); returns the energy there, or
    /// `None` if it never falls.
    fn advance(&mut self, potential: &Potential, energy: f64) -> Option<f64> {
        self.expansion.gradient(&mut self.gradient);
        let slope: f64 = (self.step.iter().zip(&self.gradient))
            .map(|(step, gradient)| step.dot(gradient))
            .sum();
        // Energy differences below this are rounding; there a Newton step is right as it is.
        let rounding = ENERGY_ROUNDING * energy.abs().max(CANCELLING * self.tolerance);
        let mut share = 1.0;
        for _ in 0..MAX_HALVINGS {
            for (i, (to, from)) in self
                .trial
                .0
                .iter_mut()
                .zip(&self.configuration.0)
                .enumerate()
            {
                let own_axes = self.posture.chain.disc(i).tr_mul(&self.step[i]);
                *to = turned(from, &(own_axes * share));
            }
            self.trial_posture.place(&self.robot, &self.trial);
            let lower = potential.energy(&self.trial, &self.trial_posture);
            if lower <= energy + 1e-4 * share * slope.min(0.0) + rounding {
                std::mem::swap(&mut self.configuration, &mut self.trial);
                std::mem::swap(&mut self.posture, &mut self.trial_posture);
                return Some(lower);
            }
            share *= 0.5;
        }
        None
    }
}

impl Prediction {
    /// Notes the change of the command; returns by how much more than the last prediction one for this
    /// change misses: the square of the ratio of the changes, 0 where they differ in direction.
    fn again(&mut self, from: &[f64], to: &[f64]) -> f64 {
        let (mut along, mut last, mut now) = (0.0, 0.0, 0.0);
        for (before, (from, to)) in self.change.iter_mut().zip(from.iter().zip(to)) {
            let change = to - from;
            along += change * *before;
            last += *before * *before;
            now += change * change;
            *before = change;
        }
        if along > PARALLEL * (last * now).sqrt() {
            now / last
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::DeadForces;
    use crate::robot::Loads;

    #[test]
    fn a_descent_that_cannot_settle_says_so() {
        let robot = Robot::load("2m").expect("a standard robot");
        let command = robot.mean_command();
        let mut dead = DeadForces::new(&robot);
        dead.set(&robot, &Loads::default());
        dead.at_origin[3].x = f64::NAN;
        let potential = Potential {
            robot: &robot,
            command: command.as_slice(),
            dead: &dead,
        };
        assert_eq!(Descent::new(&robot).run(&potential).0, End::Stalled);
    }
}
