//! Joints as a model has them, and what those of a body are together.

use nalgebra::Vector3;

use crate::robot::{Hinge, HingeJoint};

/// A joint element of a body.
pub(super) struct JointElement {
    pub element: usize,
    /// `None` for a ball.
    pub hinge: Option<Hinge>,
    /// Place in the body's frame (m).
    pub center: Vector3<f64>,
    pub damping: f64,
    pub armature: f64,
    pub stiffness: f64,
}

/// What a body's joints are together, in the body's frame.
#[derive(Clone)]
pub(super) struct BodyJoint {
    /// Centre (m).
    pub center: Vector3<f64>,
    pub damping: f64,
    pub armature: f64,
    pub kind: JointKind,
}

/// What turns a body.
#[derive(Clone)]
pub(super) enum JointKind {
    /// A ball joint with this stiffness about x, y and z (N m/rad).
    Ball(Vector3<f64>),
    Hinges(HingeJoint),
}

impl BodyJoint {
    /// Whether it tells how the body is turned where its coordinates are 0: by springs, or by its hinges.
    pub fn has_rest(&self) -> bool {
        match &self.kind {
            JointKind::Ball(springs) => *springs != Vector3::zeros(),
            JointKind::Hinges(_) => true,
        }
    }
}

impl JointElement {
    /// A ball joint at its place, with its damping and armature.
    pub fn ball(&self, springs: Vector3<f64>) -> BodyJoint {
        BodyJoint {
            center: self.center,
            damping: self.damping,
            armature: self.armature,
            kind: JointKind::Ball(springs),
        }
    }
}
