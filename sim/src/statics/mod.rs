//! From command to equilibrium: Newton's method on the potential energy over SO(3)^n.
//!
//! A solve starts from the straight pose and descends: a Newton step where the Hessian is positive
//! definite, otherwise one with all joints stiffened until it is; steps are limited in angle and
//! halved until the energy falls. An equilibrium whose Hessian has a negative eigenvalue is a saddle,
//! and is left along a direction of negative curvature ([`Stability`]). A solve that stalls is repeated by continuation: the
//! command is led from the mean over each group of tendons, under which the robot stands straight, to
//! its goal. So the reported equilibrium is a function of the command and the loads alone; where
//! there are several, it is the one that this descent from the straight pose finds.
//! [`Settler::settle_from`] starts elsewhere.
//!
//! Bends that keep the tendon lengths have almost no stiffness, so upright straight poses are unstable. Results say whether
//! they converged, with which residual, and whether the equilibrium is stable, neutral or unstable, or flutters.
//!
//! A commanded length is a spring whose rest length is corrected by Newton's method on the tensions, so that gains, lengths
//! and tensions share one potential. Moments, and forces that turn with their disc, have none: they are applied by
//! continuation from the equilibrium without them, by Newton's method on the residual moments.

mod descent;
mod following;
mod memory;
mod potential;
mod settler;
mod stability;
mod sweep;
mod tolerance;
mod verdict;

pub use crate::dynamics::Growth;
pub use memory::Memory;
pub use settler::Settler;
pub use sweep::Sweep;
pub use verdict::{Examined, NotSettled, Stability};

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::chain::Configuration;
use crate::pose::Pose;
use crate::robot::{Command, Loads, Robot};
use crate::tendon::Posture;

/// Largest residual (N m) at which a configuration of a robot of usual size counts as settled; of small
/// robots [`Robot::moment_tolerance`].
pub const TOLERANCE: f64 = 1e-10;
/// Largest error (m) of a tendon whose length is commanded; of small robots
/// [`Robot::length_tolerance`].
pub const LENGTH_TOLERANCE: f64 = 1e-11;

/// An equilibrium of a robot under a command and loads.
#[derive(Clone, Debug, PartialEq)]
pub struct Equilibrium {
    /// Rotation of each disc relative to the body below.
    pub configuration: Configuration,
    /// Origin of each disc, world frame (m).
    pub positions: Vec<Vector3<f64>>,
    /// Orientation of each disc, world frame. Of the two quaternions of an orientation the one nearer
    /// to that of the body below is given (their dot product is not negative), counted from the
    /// base's with `w >= 0`: so they change continuously along the robot.
    pub orientations: Vec<UnitQuaternion<f64>>,
    /// Length of each tendon (m).
    pub tendon_lengths: Vec<f64>,
    /// Tension of each tendon (N), positive when it pulls.
    pub tendon_tensions: Vec<f64>,
    /// The residual (N m): largest Euclidean norm of the energy's gradient by a joint's turn.
    pub residual: f64,
    /// Newton steps taken, those of continuation included.
    pub iterations: usize,
    /// Whether this is an equilibrium that a robot stays in: the residual is within
    /// [`Robot::moment_tolerance`], commanded lengths within [`Robot::length_tolerance`], and the equilibrium is
    /// stable or neutral. A flutter of a robot without any damping counts, too: any moment may feed one.
    pub converged: bool,
    /// What kind of equilibrium this is; `None` where the residual is above the tolerance, and on paths with
    /// friction.
    pub stability: Option<Stability>,
    /// What that was told from; `None` where nothing is said of it.
    pub examined: Option<Examined>,
    /// The small motion that grows fastest, where the motion was examined and one grows.
    pub growth: Option<Growth>,
}

impl Equilibrium {
    /// Pose of disc `index`'s frame in the world (m).
    ///
    /// # Panics
    /// For a disc that the robot does not have.
    pub fn disc_pose(&self, index: usize) -> Isometry3<f64> {
        self.pose().disc(index)
    }

    /// Where everything is.
    pub fn pose(&self) -> Pose<'_> {
        Pose {
            configuration: &self.configuration,
            positions: &self.positions,
            orientations: &self.orientations,
            tendon_lengths: &self.tendon_lengths,
            tendon_tensions: &self.tendon_tensions,
        }
    }

    /// Storage for an equilibrium of `robot`: the straight pose, not converged.
    pub(crate) fn unsettled(robot: &Robot) -> Self {
        let n = robot.discs().len();
        Self {
            configuration: Configuration::straight(robot),
            positions: vec![Vector3::zeros(); n],
            orientations: vec![UnitQuaternion::identity(); n],
            tendon_lengths: vec![0.0; robot.tendons().len()],
            tendon_tensions: vec![0.0; robot.tendons().len()],
            residual: f64::INFINITY,
            iterations: 0,
            converged: false,
            stability: None,
            examined: None,
            growth: None,
        }
    }

    /// Whether all places and lengths are finite numbers.
    pub(crate) fn is_finite(&self) -> bool {
        let places = self.positions.iter().flatten();
        places.chain(&self.tendon_lengths).all(|x| x.is_finite())
    }

    /// Takes over a configuration, and the poses and lengths of its posture.
    pub(crate) fn take_over(&mut self, q: &Configuration, posture: &Posture) {
        let chain = &posture.chain;
        self.configuration.0.copy_from_slice(&q.0);
        self.positions.copy_from_slice(&chain.positions);
        chain.quaternions(&mut self.orientations);
        self.tendon_lengths.copy_from_slice(&posture.lengths);
    }
}

impl<'a> From<&'a Equilibrium> for Pose<'a> {
    fn from(equilibrium: &'a Equilibrium) -> Self {
        equilibrium.pose()
    }
}

impl Robot {
    /// Settles the robot under a command and loads.
    ///
    /// Never fails in silence: look at [`Equilibrium::converged`] and [`Equilibrium::residual`].
    /// [`Settler`] settles many commands faster, and [`Robot::settle_batch`] on all cores.
    ///
    /// # Panics
    /// If the command or the loads are of another robot, with fewer tendons or more discs.
    pub fn settle(&self, command: &Command, loads: &Loads) -> Equilibrium {
        Settler::new(self).settle(command, loads).clone()
    }

    /// Settles many commands, in parallel; the result does not depend on the number of threads.
    ///
    /// # Panics
    /// As [`Robot::settle`].
    pub fn settle_batch(&self, commands: &[Command], loads: &Loads) -> Vec<Equilibrium> {
        let settle = |settler: &mut Settler, command| settler.settle(command, loads).clone();
        commands
            .par_iter()
            .map_init(|| Settler::new(self), settle)
            .collect()
    }
}
