//! Lengths of routed tendons and their derivatives.
//!
//! A tendon is a chain of straight segments, each between holes of neighbouring bodies, so each
//! depends on one ball joint alone: its length is a sum over joints.

use nalgebra::{Matrix3, Vector3};

use crate::chain::Chain;
use crate::robot::{Robot, Segment};

/// Derivatives of a segment's length by the joint's rotation vector in the disc's frame.
pub(crate) struct SegmentDerivatives {
    /// Gradient (m/rad).
    pub gradient: Vector3<f64>,
    /// Hessian (m/rad²), symmetric.
    pub hessian: Matrix3<f64>,
}

impl Segment {
    /// Length (m) with the joint at `rotation`.
    pub fn length(&self, rotation: &Matrix3<f64>) -> f64 {
        (rotation * self.to - self.from).norm()
    }

    /// The first two derivatives of the length at `rotation`, along `rotation * exp(xi)` at `xi = 0`.
    ///
    /// With `h` the upper hole and `u` the segment's unit vector, both in the disc's frame,
    /// `dl = (h x u) . xi`; the second derivative is that of the norm of a vector that turns.
    pub fn derivatives(&self, rotation: &Matrix3<f64>) -> SegmentDerivatives {
        let h = self.to;
        let span = h - rotation.tr_mul(&self.from);
        let length = span.norm();
        let u = span / length;
        let gradient = h.cross(&u);
        let identity = Matrix3::identity();
        let turning = (h * u.transpose() + u * h.transpose()) * 0.5 - identity * h.dot(&u);
        let stretching =
            identity * h.norm_squared() - h * h.transpose() - gradient * gradient.transpose();
        SegmentDerivatives {
            gradient,
            hessian: turning + stretching / length,
        }
    }
}

/// Writes the length of every tendon (m) to `lengths`.
pub(crate) fn tendon_lengths(robot: &Robot, chain: &Chain, lengths: &mut [f64]) {
    lengths.fill(0.0);
    for segment in &robot.segments {
        lengths[segment.tendon] += segment.length(&chain.joints[segment.joint]);
    }
}
