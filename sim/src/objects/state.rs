//! Where an object is, and why objects cannot move.

use nalgebra::{Isometry3, Vector3};
use thiserror::Error;

use crate::scene::Obstacle;

/// Where an object is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectState {
    /// Pose of its frame in the world (m).
    pub pose: Isometry3<f64>,
    /// Velocity of its frame's origin, world axes (m/s).
    pub velocity: Vector3<f64>,
    /// Angular velocity, world axes (rad/s).
    pub angular_velocity: Vector3<f64>,
}

impl ObjectState {
    /// Where an obstacle stands, at rest.
    pub fn at_rest(obstacle: &Obstacle) -> Self {
        Self {
            pose: obstacle.pose,
            velocity: Vector3::zeros(),
            angular_velocity: Vector3::zeros(),
        }
    }

    /// Where an obstacle's motion starts.
    pub fn start(obstacle: &Obstacle) -> Self {
        Self {
            pose: obstacle.pose,
            velocity: obstacle.velocity,
            angular_velocity: obstacle.angular_velocity,
        }
    }

    /// Whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        let turn = self.pose.rotation.coords;
        let vectors = [
            self.pose.translation.vector,
            self.velocity,
            self.angular_velocity,
        ];
        turn.iter().all(|x| x.is_finite())
            && vectors.iter().all(|v| v.iter().all(|x| x.is_finite()))
    }
}

/// Why objects cannot move.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ObjectError {
    /// This build moves no objects.
    #[error(
        "`{object}` has a mass, so it moves; this build has no rapier, which moves objects: expected one with the feature \
         `rapier`, or a scene whose obstacles are fixed"
    )]
    NoRapier {
        /// The object's name.
        object: String,
    },
    /// A shape that objects cannot have.
    #[error("object `{object}` is {found}; expected {expected}")]
    Shape {
        /// The object's name.
        object: String,
        /// Its shape.
        found: &'static str,
        /// What would be right.
        expected: &'static str,
    },
    /// States of other objects than those of the scene.
    #[error("{found} states of objects; the scene has {expected}")]
    Count {
        /// States found.
        found: usize,
        /// Objects of the scene.
        expected: usize,
    },
    /// A state with a number that is not finite, or with a rotation that is none.
    #[error("the state given of object `{object}` is not finite; expected finite numbers")]
    State {
        /// The object's name.
        object: String,
    },
    /// A motion that left the range of numbers.
    #[error(
        "object `{object}` left the range of numbers at {speed:.3e} m/s; take a shorter time step"
    )]
    Diverged {
        /// The object's name.
        object: String,
        /// Its speed before (m/s).
        speed: f64,
    },
}
