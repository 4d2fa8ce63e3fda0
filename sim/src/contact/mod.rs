//! Robots that touch obstacles, at rest and in motion.
//!
//! [`ContactSettler`] settles a robot in a [`Scene`](crate::scene::Scene): where its discs come to rest, what they touch, and with which
//! forces. [`BranchPath`] leads it along a sequence of commands. [`ContactSensitivity`] differentiates an equilibrium by the command, the
//! loads, the robot, and by the motion of its base, of obstacles, and their compliance. [`ContactStepper`] moves the robot through time.
//!
//! The robot touches with its [`Beads`](crate::geometry::Beads). A contact has a normal force without friction that keeps the
//! distance of the surfaces above 0 after they have given way by the obstacle's compliance; that is a potential, so an equilibrium
//! is a minimum of the energy, and its stability is told with the contacts in it. Steps of the solve are bounded by the clearance, so
//! that no bead passes through an obstacle on the way from the straight pose. Contacts are soft at first, and harden to what they are.

mod active;
mod branch;
mod clear;
mod clearance;
mod dense;
mod descent;
mod equations;
mod friction;
mod law;
mod mixed;
mod motion;
mod near;
mod near_pairs;
mod report;
mod rubbing;
mod sensitivity;
mod settler;
mod soften;
mod stability;
mod surfaces;
mod touching;

pub use branch::BranchPath;
pub use motion::ContactStepper;
pub use sensitivity::{ContactSensitivity, ObstacleGradient, SceneGradient};
pub use settler::ContactSettler;
pub(crate) use touching::Touching;

use nalgebra::Vector3;
use thiserror::Error;

use crate::robot::Robot;
use crate::statics::Equilibrium;

/// A place where a robot touches an obstacle, or itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// The disc, from 0.
    pub disc: usize,
    /// What it touches.
    pub partner: Partner,
    /// Where on the partner's surface, world frame (m).
    pub point: Vector3<f64>,
    /// The partner's outward normal there, world axes.
    pub normal: Vector3<f64>,
    /// Distance of the undeformed surfaces (m), below 0 where they are pressed into each other.
    pub gap: f64,
    /// Force on the disc, world axes (N).
    pub force: Vector3<f64>,
    /// Whether it bears force.
    pub activity: Activity,
    /// Whether it slides.
    pub sliding: Sliding,
}

/// What a disc touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Partner {
    /// An obstacle, by its number in the scene.
    Obstacle(usize),
    /// Another disc of the robot, from 0, farther from the base; the opposite force acts on it.
    Disc(usize),
}

impl Partner {
    /// The number of the obstacle, if it is one.
    pub fn obstacle(self) -> Option<usize> {
        match self {
            Self::Obstacle(obstacle) => Some(obstacle),
            Self::Disc(_) => None,
        }
    }

    /// The number of the disc, if it is one.
    pub fn disc(self) -> Option<usize> {
        match self {
            Self::Disc(disc) => Some(disc),
            Self::Obstacle(_) => None,
        }
    }
}

/// Whether a contact slides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sliding {
    /// Nothing resists that: there is no friction, or none is known ([`ContactSettler::follow`]).
    Free,
    /// Friction holds it where it is.
    Sticks,
    /// It slides along the surface against friction.
    Slips,
}

/// Whether a contact bears force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// It bears force, and goes on to under any small change.
    Strict,
    /// Neither its force nor its gap is clearly above 0: after a small change it may bear more, or none, so that derivatives are
    /// one-sided.
    Weak,
}

/// An equilibrium among obstacles.
#[derive(Clone, Debug, PartialEq)]
pub struct ContactEquilibrium {
    /// Where the robot is, and whether it rests there.
    pub equilibrium: Equilibrium,
    /// What it touches: by obstacles and discs, then itself.
    pub contacts: Vec<Contact>,
    /// Largest product of a contact's force and the distance of its surfaces after they have given way (J), 0 of exact contact.
    pub complementarity: f64,
    /// Deepest overlap of the undeformed shapes (m).
    pub penetration: f64,
    /// What those products should be (J): the barrier of the interior-point method.
    pub barrier: f64,
}

impl ContactEquilibrium {
    /// Normal force (N) with which the robot presses on an obstacle, by its number: the sum over the contacts of one disc, from 0, or of
    /// all.
    pub fn normal_force(&self, obstacle: usize, disc: Option<usize>) -> f64 {
        normal_force(&self.contacts, obstacle, disc)
    }

    fn unsettled(robot: &Robot) -> Self {
        Self {
            equilibrium: Equilibrium::unsettled(robot),
            contacts: Vec::new(),
            complementarity: 0.0,
            penetration: 0.0,
            barrier: 0.0,
        }
    }
}

/// The same of a list of contacts.
pub(crate) fn normal_force(contacts: &[Contact], obstacle: usize, disc: Option<usize>) -> f64 {
    let own = contacts.iter().filter(|contact| {
        contact.partner == Partner::Obstacle(obstacle) && disc.is_none_or(|d| d == contact.disc)
    });
    own.fold(0.0, |sum, contact| sum + contact.force.dot(&contact.normal))
}

/// What cannot be solved among obstacles.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ContactError {
    /// Loads without a potential.
    #[error(
        "the wrench on disc {disc} is a moment or turns with its disc; among obstacles only forces that keep their direction \
         are solved for"
    )]
    Loads {
        /// The disc, from 0.
        disc: usize,
    },
    /// A start inside an obstacle: on which side it should come out is not known.
    #[error(
        "disc {disc} starts inside obstacle {obstacle:?}: a bead is centred at {position:?} m; expected a start with all beads' \
         centres outside of the obstacles"
    )]
    StartsInside {
        /// The disc, from 0.
        disc: usize,
        /// The obstacle's name.
        obstacle: String,
        /// Centre of the bead in the world (m).
        position: [f64; 3],
    },
}
