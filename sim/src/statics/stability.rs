//! What kind of equilibrium a robot is in.
//!
//! A descent decides by the inertia of the Hessian ([`Factor::definiteness`]), and the smallest stiffness is its smallest
//! eigenvalue ([`smallest_eigenvalue`]): both take O(n). Where lengths are commanded, what counts is
//! the Hessian on the turns that keep them: the second-order conditions of constrained minimisation
//! (Nocedal and Wright, Numerical Optimization, ch. 12.5), with the tensions as multipliers. The
//! descent asks more: its Hessian is that of the augmented Lagrangian, the same on these turns.
//!
//! Where loads have no potential, no energy decides: a column that a force follows stands until two of its modes meet in
//! one frequency, and then swings ever wider (Beck, Zeitschrift fuer angewandte Mathematik und Physik 3, 1952). There the
//! linearised motion is examined ([`SmallMotionRates`]), with the robot's own inertia and damping; where it cannot be, the
//! Jacobian alone.
//!
//! [`Factor::definiteness`]: crate::factor::Factor::definiteness

use nalgebra::Vector3;
use serde::Serialize;
use thiserror::Error;

use super::Equilibrium;
use super::descent::Descent;
use crate::dynamics::{Growth, SmallMotion, SmallMotionRates};
use crate::energy::following::{add_forces, add_moments, follows};
use crate::energy::{DeadForces, Expansion, Potential};
use crate::factor::{
    Definiteness, HeldLengths, LoadedMatrix, MARGIN, smallest_eigenvalue, smallest_real_part,
};
use crate::robot::{Command, Drive, Loads, Pull, Robot, Tendon};
use crate::tendon::Posture;

/// Stretch, as a share of a tendon's length, that is not told from none.
const SLACK_ROUNDING: f64 = 1e-12;
/// Stiffness (N m/rad) that the moments left on the joints may feign, for each N m of the largest and each joint: a robot that
/// turns freely about an axis has a mode without stiffness, whose eigenvalue is what the residual makes of it.
const OF_RESIDUAL: f64 = 10.0;

/// What kind of equilibrium a robot is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stability {
    /// The energy rises in every direction: its Hessian is positive definite. With moments or forces
    /// that turn with their disc: no small motion grows, and none goes without resistance.
    Stable,
    /// The energy falls in no direction to second order, but does not rise in every one: slack tendons
    /// leave discs without weight where they are put, joints without torsion turn freely, and so does a bent robot that is
    /// alike about its axis. Also where a tendon is just about to go slack and would have to stay taut for the robot to be
    /// stable. With loads without a potential: no small motion grows, but one meets no resistance.
    Neutral,
    /// The energy falls in some direction: a saddle, which the least push makes the robot leave. With loads without a
    /// potential: it leaves without swinging (divergence).
    Unstable,
    /// Under loads without a potential, small oscillations grow. Of a robot without any damping it counts as settled all the same.
    Flutter,
}

/// What the kind of an equilibrium was told from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Examined {
    /// The second derivative of the potential energy. It decides whatever inertia and damping the robot has.
    Energy,
    /// The linearised motion under loads without a potential, with the robot's own inertia and damping. Of robots of more
    /// than 20 discs the slowest rates, and those that a force could make grow; not all.
    Motion,
    /// The real parts of the eigenvalues of the moments' Jacobian under loads without a potential: whether the robot would stay
    /// there if it moved slowly. It has a joint without inertia, or a tendon whose length is imposed, so that its motion is not
    /// defined, or rates too far apart to be computed accurately; in motion it might flutter.
    Statics,
}

impl Stability {
    /// Its name in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stable => "stable",
            Self::Neutral => "neutral",
            Self::Unstable => "unstable",
            Self::Flutter => "flutter",
        }
    }
}

impl Examined {
    /// Its name in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Energy => "energy",
            Self::Motion => "motion",
            Self::Statics => "statics",
        }
    }
}

/// Why an equilibrium counts as not converged.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum NotSettled {
    /// An equilibrium, but one that no robot stays in.
    #[error(
        "the robot did not settle: it balances in an unstable equilibrium, which the least push makes it leave"
    )]
    Unstable,
    /// An equilibrium about which oscillations grow.
    #[error(
        "the robot did not settle: it flutters under loads that turn with it or are moments; small motions about the \
         equilibrium swing at {:.4} Hz and grow by {:.3e} 1/s{}", .0.angular_frequency / std::f64::consts::TAU, .0.rate,
        by_damping(.0)
    )]
    Flutter(Growth),
    /// A commanded length that the tendon does not reach.
    #[error(
        "the robot did not settle: tendon {} is {length} m long where {commanded} m are commanded",
        tendon + 1
    )]
    Length {
        /// The tendon, from 0.
        tendon: usize,
        /// Its length (m).
        length: f64,
        /// The length commanded (m).
        commanded: f64,
    },
    /// The residual is above the tolerance.
    #[error(
        "the robot did not settle: residual {residual:e} N m; expected {tolerance:e} N m at most"
    )]
    Moments {
        /// [`Equilibrium::residual`] (N m).
        residual: f64,
        /// [`Robot::moment_tolerance`] (N m).
        tolerance: f64,
    },
}

/// That flutter is one that damping brings about.
fn by_damping(growth: &Growth) -> &'static str {
    match growth.without_damping {
        true => "",
        false => "; they would not without the robot's damping",
    }
}

impl Equilibrium {
    /// Why the robot did not settle; `None` where it did.
    ///
    /// # Panics
    /// If the command or the equilibrium are of another robot, with fewer tendons.
    pub fn failure(&self, robot: &Robot, command: &Command) -> Option<NotSettled> {
        if self.converged {
            return None;
        }
        if self.stability == Some(Stability::Unstable) {
            return Some(NotSettled::Unstable);
        }
        if let (Some(Stability::Flutter), Some(growth)) = (self.stability, self.growth) {
            return Some(NotSettled::Flutter(growth));
        }
        let tolerance = robot.moment_tolerance();
        let off = |t: &usize| {
            let error = self.tendon_lengths[*t] - command.as_slice()[*t];
            let slack = self.is_slack(*t, &robot.tendons()[*t]);
            robot.tendons()[*t].holds_length() && !slack && error.abs() > robot.length_tolerance()
        };
        let missed = (0..robot.tendons().len()).find(off);
        Some(match missed.filter(|_| self.residual <= tolerance) {
            Some(tendon) => NotSettled::Length {
                tendon,
                length: self.tendon_lengths[tendon],
                commanded: command.as_slice()[tendon],
            },
            None => NotSettled::Moments {
                residual: self.residual,
                tolerance,
            },
        })
    }

    /// Whether a tendon hangs slack.
    fn is_slack(&self, tendon: usize, model: &Tendon) -> bool {
        model.pull == Pull::TensionOnly && self.tendon_tensions[tendon] <= 0.0
    }
}

impl Descent {
    /// What kind of equilibrium the robot is in, given the factor of its Hessian. The stiffness of a joint
    /// whose moment the tolerance lets pass is not told from zero. If unstable, the factor has a direction
    /// of negative curvature.
    pub fn stability(&mut self, potential: &Potential) -> Stability {
        let mut on_edge = false;
        for (t, tendon) in potential.robot.tendons().iter().enumerate() {
            on_edge |= self.is_on_edge(potential, t, tendon);
        }
        if on_edge {
            return self.stability_on_edge(potential);
        }
        match self.definiteness() {
            Definiteness::Positive => Stability::Stable,
            Definiteness::Semidefinite => Stability::Neutral,
            Definiteness::Indefinite => Stability::Unstable,
        }
    }

    fn definiteness(&mut self) -> Definiteness {
        let resolution = self.resolution();
        self.factor.definiteness(&self.expansion, resolution)
    }

    /// A stiffness (N m/rad) that is not told from zero.
    fn resolution(&self) -> f64 {
        let joints = self.expansion.joint_blocks.len() as f64;
        (self.tolerance).max(OF_RESIDUAL * joints * self.expansion.residual())
    }

    /// Whether a tendon is just about to go slack: it has stiffness on one side only.
    fn is_on_edge(&self, potential: &Potential, t: usize, tendon: &Tendon) -> bool {
        let length = self.iterate.posture.lengths[t];
        tendon.pull == Pull::TensionOnly
            && tendon.drive != Drive::Tension
            && (length - potential.command[t]).abs() <= SLACK_ROUNDING * length
    }

    /// The same where tendons are about to go slack: the energy's second derivative along a direction
    /// lies between that with all of them slack and that with all of them taut.
    fn stability_on_edge(&mut self, potential: &Potential) -> Stability {
        let bounds = [false, true].map(|taut| {
            for (t, tendon) in potential.robot.tendons().iter().enumerate() {
                if self.is_on_edge(potential, t, tendon) {
                    self.expansion.weights[t] = if taut { tendon.spring() } else { 0.0 };
                }
            }
            self.factor.factorise(&self.expansion, 0.0);
            self.definiteness()
        });
        for (t, tendon) in potential.robot.tendons().iter().enumerate() {
            let state = tendon.state(self.iterate.posture.lengths[t], potential.command[t]);
            self.expansion.weights[t] = state.stiffness;
        }
        match bounds {
            [Definiteness::Positive, _] => Stability::Stable,
            [_, Definiteness::Indefinite] => Stability::Unstable,
            _ => Stability::Neutral,
        }
    }
}

/// The kind of an equilibrium, and what it was told from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Verdict {
    pub stability: Stability,
    pub examined: Examined,
    pub growth: Option<Growth>,
    /// Whether what was examined is the motion of a robot without damping.
    pub undamped: bool,
}

impl Verdict {
    pub fn of_energy(stability: Stability) -> Self {
        Self {
            stability,
            examined: Examined::Energy,
            growth: None,
            undamped: false,
        }
    }

    /// That where a descent stands under loads without a potential, `motion` being of a robot that can move.
    pub fn under_loads(
        descent: &Descent,
        command: &[f64],
        loads: &Loads,
        motion: Option<&mut SmallMotionRates>,
    ) -> Self {
        let expansion = &descent.expansion;
        let margin = descent.resolution().max(MARGIN * expansion.scale());
        let q = &descent.iterate.configuration;
        let undamped = (motion.as_ref()).is_some_and(|motion| motion.without_damping());
        let found = motion.and_then(|motion| motion.examine(q, command, loads, margin));
        let (stability, growth) = match found {
            None => {
                let matrix = LoadedMatrix {
                    loads,
                    share: 1.0,
                    posture: &descent.iterate.posture,
                    expansion,
                };
                return Self {
                    stability: of_jacobian(&matrix, margin),
                    examined: Examined::Statics,
                    growth: None,
                    undamped: false,
                };
            }
            Some(SmallMotion::Bounded) => (Stability::Stable, None),
            Some(SmallMotion::Drifts) => (Stability::Neutral, None),
            Some(SmallMotion::Grows(growth)) if growth.angular_frequency == 0.0 => {
                (Stability::Unstable, Some(growth))
            }
            Some(SmallMotion::Grows(growth)) => (Stability::Flutter, Some(growth)),
        };
        Self {
            stability,
            examined: Examined::Motion,
            growth,
            undamped,
        }
    }
}

/// By the real parts of the Jacobian's eigenvalues, those up to `margin` (N m/rad) not told from zero. Takes O(n).
fn of_jacobian(matrix: &LoadedMatrix, margin: f64) -> Stability {
    if matrix.has_positive_part(margin) {
        return Stability::Stable;
    }
    match smallest_real_part(matrix, &HeldLengths::default()) {
        Some(smallest) if smallest > margin => Stability::Stable,
        Some(smallest) if smallest >= -margin => Stability::Neutral,
        _ => Stability::Unstable,
    }
}

impl Robot {
    /// The smallest stiffness (N m/rad) of the robot in an equilibrium of `command` and `loads`, that
    /// of its softest mode: the smallest eigenvalue of the energy's Hessian by the joints' turns, on
    /// those turns that keep the commanded lengths of taut inextensible tendons. With moments or forces
    /// that turn with their disc, the smallest real part of the Jacobian's eigenvalues. Positive at a
    /// stable equilibrium, infinite where commanded lengths leave the joints no freedom, `NaN` if it
    /// cannot be computed.
    ///
    /// The tensions of the tendons whose length is commanded are those of the equilibrium. Takes O(n) for each step of an iteration
    /// that takes 10 to 100. With moments or forces that turn with their disc its error is 1e-9 of the Jacobian's size, and up to
    /// a percent of the figure where such loads are so large that the eigenvalues are ill-conditioned: it says how stiff the robot is,
    /// and [`Equilibrium::stability`] whether it stays.
    ///
    /// # Panics
    /// As [`Robot::settle`], or if the equilibrium is of a robot with other numbers of discs or tendons.
    pub fn smallest_stiffness(
        &self,
        command: &Command,
        loads: &Loads,
        equilibrium: &Equilibrium,
    ) -> f64 {
        let held: Vec<bool> = (self.tendons().iter().enumerate())
            .map(|(t, tendon)| tendon.holds_length() && !equilibrium.is_slack(t, tendon))
            .collect();
        let (posture, mut expansion) = self.expanded(command, loads, equilibrium);
        let columns = match held.contains(&true) {
            true => expansion.dense_columns(),
            false => Vec::new(),
        };
        let gradients: Vec<&[_]> = (columns.iter().zip(&held))
            .filter_map(|((_, slopes), held)| held.then_some(slopes.as_slice()))
            .collect();
        let Some(lengths) = HeldLengths::new(&gradients) else {
            return f64::NAN;
        };
        // Springs along them, as stiff as the rest, resist no turn that keeps their lengths.
        let scale = expansion.scale();
        let columns_of = columns.iter().zip(&held).enumerate();
        for (t, ((_, slopes), _)) in columns_of.filter(|(_, (_, held))| **held) {
            let lever = slopes.iter().map(Vector3::norm_squared).fold(0.0, f64::max);
            expansion.weights[t] = if lever > 0.0 { scale / lever } else { 0.0 };
        }
        let smallest = if loads.wrenches().iter().any(follows) {
            let matrix = LoadedMatrix {
                loads,
                share: 1.0,
                posture: &posture,
                expansion: &expansion,
            };
            smallest_real_part(&matrix, &lengths)
        } else {
            smallest_eigenvalue(&expansion, &lengths)
        };
        smallest.unwrap_or(f64::NAN)
    }

    /// The potential's expansion in an equilibrium, with the tensions of held tendons.
    fn expanded(
        &self,
        command: &Command,
        loads: &Loads,
        equilibrium: &Equilibrium,
    ) -> (Posture, Expansion) {
        let mut posture = Posture::new(self);
        posture.place(self, &equilibrium.configuration);
        let mut dead = DeadForces::new(self);
        dead.set(self, loads);
        add_forces(loads, 1.0, &posture, &mut dead);
        let potential = Potential {
            robot: self,
            command: command.as_slice(),
            dead: &dead,
        };
        let mut expansion = Expansion::new(self);
        let mut tensions = vec![0.0; self.tendons().len()];
        for (t, tendon) in self.tendons().iter().enumerate() {
            if tendon.holds_length() {
                tensions[t] = equilibrium.tendon_tensions[t];
            } else {
                let state = tendon.state(posture.lengths[t], command.as_slice()[t]);
                (tensions[t], expansion.weights[t]) = (state.tension, state.stiffness);
            }
        }
        let tension = |tendon: usize, _| tensions[tendon];
        potential.expand_pulled(
            &equilibrium.configuration,
            &posture,
            tension,
            &mut expansion,
        );
        add_moments(loads, 1.0, &posture, &mut expansion);
        (posture, expansion)
    }
}

#[cfg(test)]
mod tests;
