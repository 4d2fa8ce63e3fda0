//! Where a robot is, at rest or in motion: what cameras, sensors and controllers see of it.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::chain::Configuration;

/// Where all of a robot is at one moment: a view of whatever computed it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose<'a> {
    /// Rotation of each disc relative to the body below.
    pub configuration: &'a Configuration,
    /// Origin of each disc, world frame (m).
    pub positions: &'a [Vector3<f64>],
    /// Orientation of each disc, world frame. Of the two quaternions of an orientation the one nearer to that of the body
    /// below, counted from the base's with `w >= 0`.
    pub orientations: &'a [UnitQuaternion<f64>],
    /// Length of each tendon (m).
    pub tendon_lengths: &'a [f64],
    /// Tension of each tendon (N), at the servo; positive when it pulls.
    pub tendon_tensions: &'a [f64],
}

impl Pose<'_> {
    /// Disc `index`'s frame in the world (m).
    ///
    /// # Panics
    /// For a disc that the robot does not have.
    pub fn disc(&self, index: usize) -> Isometry3<f64> {
        Isometry3::from_parts(self.positions[index].into(), self.orientations[index])
    }

    /// The distal disc's frame in the world (m).
    pub fn tip(&self) -> Isometry3<f64> {
        self.disc(self.positions.len() - 1)
    }
}
