//! Rotations as quaternions w, x, y, z.

use nalgebra::{Quaternion, UnitQuaternion};

/// The rotation of numbers w, x, y, z.
pub(super) fn quaternion([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

/// No rotation.
pub(super) fn upright() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}
