//! Changes of obstacles, and derivatives by them.

use crate::pose::PoseTangent;

/// Derivatives of a cost by one obstacle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObstacleGradient {
    /// By a displacement of its origin (m) and a rotation about it (rad), world axes.
    pub pose: PoseTangent,
    /// By its compliance (m/N).
    pub compliance: f64,
}

/// A change of one obstacle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ObstacleTangent {
    /// Displacement of its origin (m) and rotation about it (rad), world axes.
    pub pose: PoseTangent,
    /// Of its compliance (m/N).
    pub compliance: f64,
}

impl ObstacleTangent {
    /// Change of a cost with this gradient.
    pub fn dot(&self, gradient: &ObstacleGradient) -> f64 {
        self.pose.position.dot(&gradient.pose.position)
            + self.pose.rotation.dot(&gradient.pose.rotation)
            + self.compliance * gradient.compliance
    }
}
