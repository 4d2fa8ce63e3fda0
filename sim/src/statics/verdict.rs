//! The kinds of equilibria, and why one counts as not converged.

use serde::Serialize;
use thiserror::Error;

use super::Equilibrium;
use crate::dynamics::Growth;
use crate::robot::{Command, Pull, Robot, Tendon};

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
    pub(super) fn is_slack(&self, tendon: usize, model: &Tendon) -> bool {
        model.pull == Pull::TensionOnly && self.tendon_tensions[tendon] <= 0.0
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
}
