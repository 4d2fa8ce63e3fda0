//! Newton's method on the potential, from one configuration down to an equilibrium.
//!
//! Where the Hessian is indefinite, all joints are stiffened in proportion to the residual moments until it is not (a
//! multiple of the identity added to the Hessian: Nocedal and Wright, Numerical Optimization, section 3.4). That takes 5.5 to
//! 6.6 steps on average, and reflecting the negative eigenvalues 9 to 10: bends then spread evenly over the joints.

use nalgebra::Vector3;

use super::tolerance::moment_tolerance;
use super::verdict::{Stability, Verdict};
use crate::chain::Configuration;
use crate::energy::{Expansion, Potential};
use crate::factor::{Curvature, Factor};
use crate::robot::{Robot, joints_along};
use crate::solve::{Iterate, System, correct_rest_lengths, newton};

/// Largest turn of a joint in one step (rad).
const MAX_TURN: f64 = 0.5;
/// Turn of the joint that turns most when a saddle is left (rad).
const SADDLE_TURN: f64 = 0.1;
/// Stiffness first given to the joints where the Hessian is indefinite, for each N m of the residual (1/rad).
const STIFFENING: f64 = 0.1;
/// Attempts at making the Hessian positive definite, each four times as stiff as the one before.
const MAX_STIFFENINGS: usize = 10;
/// Cosine of the angle between changes of the command that count as of one direction.
const PARALLEL: f64 = 0.99;
/// Share of the decrease by the linear model that a step must bring (Armijo's condition).
const ENOUGH: f64 = 1e-4;
/// Share of the energy that is rounding.
const ENERGY_ROUNDING: f64 = 1e-13;
/// Energy (J) that terms of both signs may have before they cancel, for each N m of the tolerance.
const CANCELLING: f64 = 1e7;

/// State and workspace of a Newton descent on the potential energy.
#[derive(Clone, Debug)]
pub(super) struct Descent {
    robot: Robot,
    pub iterate: Iterate,
    pub expansion: Expansion,
    pub factor: Factor,
    /// Largest residual (N m) at which the robot counts as at rest.
    pub tolerance: f64,
    gradient: Vec<Vector3<f64>>,
    /// No terms of discs.
    none: Vec<Vector3<f64>>,
    /// What the last prediction was made for, and came to.
    pub prediction: Prediction,
}

/// A prediction to first order, and what it missed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Prediction {
    /// How the command changed (m or N).
    pub change: Vec<f64>,
    pub configuration: Configuration,
}

/// How a descent ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum End {
    /// In an equilibrium of this kind.
    AtRest(Verdict),
    /// At a residual above the tolerance.
    Stalled,
}

impl End {
    /// Whether the end is an equilibrium that the robot stays in. One without damping is not asked not to swing: nothing would
    /// take what any moment feeds.
    pub fn is_settled(self) -> bool {
        match self {
            Self::AtRest(verdict) => match verdict.stability {
                Stability::Stable | Stability::Neutral => true,
                Stability::Flutter => verdict.undamped,
                Stability::Unstable => false,
            },
            Self::Stalled => false,
        }
    }
}

impl Descent {
    pub fn new(robot: &Robot) -> Self {
        let iterate = Iterate::new(robot);
        let expansion = Expansion::new(robot);
        let zero = vec![Vector3::zeros(); robot.discs().len()];
        Self {
            robot: robot.clone(),
            tolerance: moment_tolerance(robot, &iterate.posture.lengths),
            factor: Factor::new(&expansion),
            expansion,
            gradient: zero.clone(),
            none: zero,
            prediction: Prediction {
                change: vec![0.0; robot.tendons().len()],
                configuration: iterate.configuration.clone(),
            },
            iterate,
        }
    }

    /// Starts from the straight pose.
    pub fn start_straight(&mut self) {
        self.prediction.change.fill(0.0);
        self.iterate.set_straight();
    }

    /// Starts from `q`.
    pub fn start_at(&mut self, q: &Configuration) {
        self.prediction.change.fill(0.0);
        self.iterate.set(q);
    }

    /// Moves from the equilibrium under the command `from`, where the last descent ended, to where that
    /// under `to` is to first order: a step with the factor that is there already. Where the command
    /// goes on as it last did, what the last prediction missed is added, so the error is of third order.
    pub fn predict(&mut self, from: &[f64], to: &[f64]) {
        // Change of the gradient by that of the tensions.
        let slots = self.expansion.columns.slots;
        self.gradient.fill(Vector3::zeros());
        for (t, tendon) in self.robot.tendons().iter().enumerate() {
            let state = tendon.state(self.iterate.posture.lengths[t], to[t]);
            let change = state.tension - self.expansion.tensions[t];
            if change == 0.0 {
                continue;
            }
            let slot = self.expansion.columns.slot[t];
            for joint in joints_along(&tendon.route) {
                self.gradient[joint] += self.expansion.slopes[joint * slots + slot] * change;
            }
        }
        // Newton's step for it.
        let iterate = &mut self.iterate;
        self.factor
            .descend(&self.gradient, &self.none, &mut iterate.step);
        iterate.limit_step(MAX_TURN);
        // What the last prediction missed, where the command goes on as it last did.
        let again = self.prediction.again(from, to);
        let joints = iterate.configuration.0.iter_mut().enumerate();
        for ((i, q), predicted) in joints.zip(&mut self.prediction.configuration.0) {
            let disc = &self.robot.discs()[i];
            let missed = disc.step_between(predicted, q) * again;
            *predicted = disc.moved(q, &iterate.posture.chain.dual(i).tr_mul(&iterate.step[i]));
            *q = disc.moved(predicted, &missed);
        }
        iterate.place();
    }

    /// Descends to an equilibrium that is not unstable; also returns the Newton steps taken. The
    /// expansion is that of the last configuration.
    pub fn run(&mut self, potential: &Potential) -> (End, usize) {
        let mut minimisation = Minimisation {
            energy: potential.energy(&self.iterate.configuration, &self.iterate.posture),
            potential,
            descent: self,
            end: End::Stalled,
        };
        let (_, steps) = newton(&mut minimisation);
        (minimisation.end, steps)
    }

    /// Moves the rest lengths of tendons that are longer than they should be by `errors` (tendon, m): see [`correct_rest_lengths`].
    pub fn correct_rest_lengths(&mut self, errors: &[(usize, f64)], rest: &mut [f64]) {
        self.factor.factorise(&self.expansion, 0.0);
        let (factor, none) = (&self.factor, &self.none);
        correct_rest_lengths(&self.expansion, errors, rest, |moments, turns| {
            factor.solve(moments, none, turns);
        });
    }

    /// Where the Hessian is not positive definite, factorises it with the joints stiffened alike, in
    /// proportion to the residual (Levenberg and Marquardt): the step then spreads bends evenly
    /// over the joints, as constant curvature would.
    fn stiffen(&mut self) {
        let mut stiffness = STIFFENING * self.expansion.residual();
        for _ in 0..MAX_STIFFENINGS {
            if self.factor.curvature() == Curvature::Positive {
                break;
            }
            self.factor.factorise(&self.expansion, stiffness);
            stiffness *= 4.0;
        }
    }

    /// Writes the step that leaves a saddle, along the direction of negative curvature. That has no
    /// preferred sense; the one in which its largest component, in the joints' coordinates, is positive is taken.
    fn saddle_step(&mut self) {
        let Iterate { posture, step, .. } = &mut self.iterate;
        self.factor.negative_curvature(step);
        let mut largest: f64 = 0.0;
        for (i, turn) in step.iter().enumerate() {
            for component in posture.chain.dual(i).tr_mul(turn).iter() {
                if component.abs() > largest.abs() {
                    largest = *component;
                }
            }
        }
        let scale = SADDLE_TURN / largest;
        step.iter_mut().for_each(|turn| *turn *= scale);
    }
}

/// A descent under one potential.
struct Minimisation<'a> {
    descent: &'a mut Descent,
    potential: &'a Potential<'a>,
    /// Energy (J) at the start of the step.
    energy: f64,
    /// How the descent ends if it does not go on.
    end: End,
}

/// The energy to first order along a step.
struct Slope {
    /// Derivative of the energy (J) by the share of the step.
    slope: f64,
    /// Differences of the energy (J) below this are rounding; there a Newton step is right as it is.
    rounding: f64,
}

impl System for Minimisation<'_> {
    type Model = Slope;
    const MAX_STEPS: usize = 100;
    const MAX_TRIALS: usize = 30;

    fn iterate(&mut self) -> &mut Iterate {
        &mut self.descent.iterate
    }

    fn is_solved(&mut self) -> bool {
        let descent = &mut *self.descent;
        let Iterate {
            configuration,
            posture,
            ..
        } = &descent.iterate;
        (self.potential).expand(configuration, posture, &mut descent.expansion);
        descent.factor.factorise(&descent.expansion, 0.0);
        self.end = if descent.expansion.residual() <= descent.tolerance {
            End::AtRest(Verdict::of_energy(descent.stability(self.potential)))
        } else {
            End::Stalled
        };
        self.end.is_settled()
    }

    fn newton_step(&mut self) -> Slope {
        let descent = &mut *self.descent;
        match self.end {
            End::AtRest(_) => descent.saddle_step(),
            End::Stalled => {
                descent.stiffen();
                let (expansion, step) = (&descent.expansion, &mut descent.iterate.step);
                let (joint, disc) = (&expansion.joint_gradient, &expansion.disc_gradient);
                descent.factor.descend(joint, disc, step);
                descent.iterate.limit_step(MAX_TURN);
            }
        }
        descent.expansion.gradient(&mut descent.gradient);
        let turns = descent.iterate.step.iter().zip(&descent.gradient);
        let cancelling = CANCELLING * descent.tolerance;
        Slope {
            slope: turns.map(|(step, gradient)| step.dot(gradient)).sum(),
            rounding: ENERGY_ROUNDING * self.energy.abs().max(cancelling),
        }
    }

    fn accepts(&mut self, model: &Slope, share: f64) -> bool {
        let iterate = &self.descent.iterate;
        let energy = (self.potential).energy(&iterate.configuration, &iterate.posture);
        let most = self.energy + ENOUGH * share * model.slope.min(0.0) + model.rounding;
        let accepted = energy <= most;
        if accepted {
            self.energy = energy;
        }
        accepted
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
