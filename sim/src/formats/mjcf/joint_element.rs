//! Joints as a model has them, and what those of a body are together.

use nalgebra::Vector3;

/// A joint element of a body.
pub(super) struct JointElement {
    pub element: usize,
    /// The axis of a hinge; `None` for a ball.
    pub axis: Option<usize>,
    /// Place in the body's frame (m).
    pub center: Vector3<f64>,
    pub damping: f64,
    pub armature: f64,
    pub stiffness: f64,
}

/// What a body's joints are as one ball joint, in the body's frame.
#[derive(Clone, Copy)]
pub(super) struct BallJoint {
    /// Centre (m).
    pub center: Vector3<f64>,
    pub damping: f64,
    pub armature: f64,
    /// Stiffness about x, y and z (N m/rad).
    pub springs: Vector3<f64>,
    /// The axis about which it does not turn at all, if any.
    pub held: Option<usize>,
}

impl BallJoint {
    /// Whether it has a rest that it springs back to.
    pub fn is_elastic(&self) -> bool {
        self.springs != Vector3::zeros() || self.held.is_some()
    }
}

impl JointElement {
    /// A ball joint at its place, with its damping and armature.
    pub fn alone(&self, springs: Vector3<f64>, held: Option<usize>) -> BallJoint {
        BallJoint {
            center: self.center,
            damping: self.damping,
            armature: self.armature,
            springs,
            held,
        }
    }
}
