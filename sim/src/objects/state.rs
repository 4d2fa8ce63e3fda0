//! Where an object is, and why objects cannot move.

use nalgebra::{Isometry3, Vector3};
use thiserror::Error;

use crate::scene::Obstacle;
#[cfg(feature = "rapier")]
use crate::scene::{LARGEST_LENGTH, LARGEST_SPEED};

/// How far the length of a rotation's quaternion may be from 1.
#[cfg(feature = "rapier")]
const UNIT: f64 = 1e-6;

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

    /// Refuses what no `object` of a scene can start in.
    #[cfg(feature = "rapier")]
    pub(super) fn check(&self, object: &str) -> Result<(), ObjectError> {
        let within = |v: &Vector3<f64>, largest| v.iter().all(|x| x.abs() <= largest);
        let refuse = |what, found: &[f64], expected| {
            let object = object.to_owned();
            let found = format!("{what} {found:?}");
            Err(ObjectError::State {
                object,
                found,
                expected,
            })
        };
        let position = &self.pose.translation.vector;
        if !within(position, LARGEST_LENGTH) {
            let expected = "finite coordinates of at most 1e6 m";
            return refuse("position", position.as_slice(), expected);
        }
        let turn = self.pose.rotation.as_vector();
        let is_rotation = (turn.norm() - 1.0).abs() <= UNIT;
        if !is_rotation {
            let wxyz = [turn.w, turn.x, turn.y, turn.z];
            return refuse(
                "orientation",
                &wxyz,
                "a quaternion (w, x, y, z) of length 1",
            );
        }
        for (what, velocity) in [
            ("velocity", &self.velocity),
            ("angular velocity", &self.angular_velocity),
        ] {
            if !within(velocity, LARGEST_SPEED) {
                let expected = "finite components of at most 1e4 (m/s, rad/s)";
                return refuse(what, velocity.as_slice(), expected);
            }
        }
        Ok(())
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
    /// A state with numbers that none can have.
    #[error("the state given of object `{object}` has {found}; expected {expected}")]
    State {
        /// The object's name.
        object: String,
        /// What is wrong.
        found: String,
        /// What would be right.
        expected: &'static str,
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
