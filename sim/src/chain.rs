//! Kinematics of the chain on SO(3)^n.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::robot::Robot;

/// Configuration `q`: the rotation of each disc relative to the body below, from the base up.
#[derive(Clone, Debug, PartialEq)]
pub struct Configuration(pub Vec<UnitQuaternion<f64>>);

impl Configuration {
    /// The straight pose of a robot: no joint turned.
    pub fn straight(robot: &Robot) -> Self {
        Self(vec![UnitQuaternion::identity(); robot.discs.len()])
    }

    /// Writes `self * exp(step)` to `out`: joint `i` turned by the rotation vector
    /// `step[3 i .. 3 i + 3]` (rad), given in its disc's own frame.
    pub(crate) fn retract(&self, step: &[f64], out: &mut Self) {
        for ((from, to), turn) in self.0.iter().zip(&mut out.0).zip(step.chunks_exact(3)) {
            *to = *from * UnitQuaternion::from_scaled_axis(Vector3::from_column_slice(turn));
            to.renormalize();
        }
    }
}

/// World poses of all discs in one configuration, with the joint rotations as matrices.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    /// Rotation of each disc relative to the body below.
    pub joints: Vec<Matrix3<f64>>,
    /// Orientation of each disc in the world.
    pub orientations: Vec<Matrix3<f64>>,
    /// Origin of each disc in the world (m).
    pub positions: Vec<Vector3<f64>>,
}

impl Chain {
    /// Room for the poses of a robot's discs.
    pub fn new(robot: &Robot) -> Self {
        let n = robot.discs.len();
        Self {
            joints: vec![Matrix3::identity(); n],
            orientations: vec![Matrix3::identity(); n],
            positions: vec![Vector3::zeros(); n],
        }
    }

    /// Forward kinematics: the poses of all discs in configuration `q`.
    pub fn place(&mut self, robot: &Robot, q: &Configuration) {
        let mut below = Matrix3::identity();
        let mut origin = robot.base;
        for (i, (disc, joint)) in robot.discs.iter().zip(&q.0).enumerate() {
            origin += below * disc.joint_offset;
            let rotation = *joint.to_rotation_matrix().matrix();
            below *= rotation;
            self.joints[i] = rotation;
            self.orientations[i] = below;
            self.positions[i] = origin;
        }
    }
}
