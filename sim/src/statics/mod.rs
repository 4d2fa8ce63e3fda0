//! From command to equilibrium: Newton's method on the potential energy over SO(3)^n.
//!
//! A solve starts from the straight pose and descends: a Newton step where the Hessian is positive
//! definite, otherwise one with all joints stiffened until it is; steps are limited in angle and
//! halved until the energy falls. An equilibrium whose Hessian has a negative
//! pivot is a saddle, and is left downhill. A solve that stalls is repeated by continuation: the
//! command is led from the mean over each group of tendons, under which the robot stands straight, to
//! its goal. So the reported equilibrium is a function of the command and the loads alone; where
//! there are several, it is the one that this descent from the straight pose finds.
//! [`Settler::settle_from`] starts elsewhere.
//!
//! Moments, and forces that turn with their disc, have no potential: they are brought on from the
//! equilibrium without them, by Newton's method on the moments left.

mod descent;
pub(crate) mod follower;
mod settler;
mod sweep;

pub use settler::Settler;
pub use sweep::Sweep;

use faer::Side;
use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use crate::chain::Configuration;
use crate::energy::{DeadForces, Expansion, Potential};
use crate::robot::{Command, Loads, Robot};
use crate::tendon::Posture;

/// Largest moment left on a joint (N m) at which a configuration counts as settled.
pub const TOLERANCE: f64 = 1e-10;
/// Largest error (m) of a tendon whose length is commanded.
pub const LENGTH_TOLERANCE: f64 = 1e-11;

/// Where a robot comes to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Equilibrium {
    /// Rotation of each disc relative to the body below.
    pub configuration: Configuration,
    /// Origin of each disc, world frame (m).
    pub positions: Vec<Vector3<f64>>,
    /// Orientation of each disc, world frame.
    pub orientations: Vec<UnitQuaternion<f64>>,
    /// Length of each tendon (m).
    pub tendon_lengths: Vec<f64>,
    /// Tension of each tendon (N), positive when it pulls.
    pub tendon_tensions: Vec<f64>,
    /// Largest moment that is left on a joint (N m): the energy gradient's largest Euclidean norm.
    pub residual: f64,
    /// Newton steps taken, those of continuation included.
    pub iterations: usize,
    /// Whether the residual is within [`TOLERANCE`] and the equilibrium stable: no eigenvalue of the
    /// Hessian (with moments and following forces: no real part of one of the Jacobian) below zero.
    pub converged: bool,
}

impl Equilibrium {
    /// Pose of disc `index`'s frame in the world (m).
    ///
    /// # Panics
    /// For a disc that the robot does not have.
    pub fn disc_pose(&self, index: usize) -> Isometry3<f64> {
        Isometry3::from_parts(self.positions[index].into(), self.orientations[index])
    }

    /// Room for an equilibrium of `robot`: the straight pose, not converged.
    pub(crate) fn unsettled(robot: &Robot) -> Self {
        let n = robot.discs.len();
        Self {
            configuration: Configuration::straight(robot),
            positions: vec![Vector3::zeros(); n],
            orientations: vec![UnitQuaternion::identity(); n],
            tendon_lengths: vec![0.0; robot.tendons.len()],
            tendon_tensions: vec![0.0; robot.tendons.len()],
            residual: f64::INFINITY,
            iterations: 0,
            converged: false,
        }
    }

    /// Takes over a configuration, and the poses and lengths of its posture.
    pub(crate) fn pose(&mut self, q: &Configuration, posture: &Posture) {
        let chain = &posture.chain;
        self.configuration.0.copy_from_slice(&q.0);
        self.positions.copy_from_slice(&chain.positions);
        for (to, orientation) in self.orientations.iter_mut().zip(&chain.orientations[1..]) {
            let rotation = Rotation3::from_matrix_unchecked(*orientation);
            *to = UnitQuaternion::from_rotation_matrix(&rotation);
        }
        self.tendon_lengths.copy_from_slice(&posture.lengths);
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

    /// The smallest eigenvalue (N m/rad) of the energy's Hessian at `configuration`: the stiffness
    /// of the softest mode, positive at a stable equilibrium. `NaN` if it cannot be computed.
    ///
    /// # Panics
    /// As [`Robot::settle`].
    pub fn smallest_stiffness(
        &self,
        command: &Command,
        loads: &Loads,
        configuration: &Configuration,
    ) -> f64 {
        let mut dead = DeadForces::new(self);
        dead.set(self, loads);
        let mut posture = Posture::new(self);
        posture.place(self, configuration);
        let mut expansion = Expansion::new(self);
        let command = command.as_slice();
        let potential = Potential {
            robot: self,
            command,
            dead: &dead,
        };
        potential.expand(configuration, &posture, &mut expansion);
        let eigenvalues = expansion.dense().self_adjoint_eigenvalues(Side::Lower);
        eigenvalues.map_or(f64::NAN, |values| values[0])
    }
}
