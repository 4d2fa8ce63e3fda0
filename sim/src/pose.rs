//! Where a robot is, at rest or in motion: what cameras, sensors and controllers see of it; derivatives by it.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};

use crate::chain::{Chain, Configuration};
use crate::robot::Robot;

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

/// Tangent or cotangent of a disc's pose, world frame: a change of the pose, or the derivative of a cost by one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseTangent {
    /// Of the origin (m).
    pub position: Vector3<f64>,
    /// Of the orientation: a rotation vector (rad).
    pub rotation: Vector3<f64>,
}

/// Derivative of a cost by a turn of an orientation, a rotation vector in the world frame, given that by the numbers
/// `(w, x, y, z)` of its unit quaternion. Only the part along the unit sphere counts.
///
/// A turn `r` makes `exp(r / 2) q` of `q`, so that is half the imaginary part of `derivative q*` (Sola, Quaternion kinematics
/// for the error-state Kalman filter, 2017, ch. 4).
pub fn rotation_cotangent(orientation: &UnitQuaternion<f64>, derivative: [f64; 4]) -> Vector3<f64> {
    let [w, x, y, z] = derivative;
    (Quaternion::new(w, x, y, z) * orientation.conjugate().into_inner()).imag() * 0.5
}

/// Derivatives of a cost by the joints' turns `q exp(dq)`, each in its disc's own frame (three entries per joint, rad), given
/// those by the discs' poses: the adjoint of the kinematics, in O(n).
///
/// # Panics
/// If there is not one cotangent and one joint for each disc of `robot`.
pub fn joint_cotangent(
    robot: &Robot,
    configuration: &Configuration,
    cotangents: &[PoseTangent],
) -> Vec<f64> {
    let n = robot.discs().len();
    assert_eq!(configuration.0.len(), n, "one joint for each disc");
    assert_eq!(cotangents.len(), n, "one cotangent for each disc");
    let mut chain = Chain::new(robot);
    chain.place(robot, configuration);
    let mut out = vec![0.0; 3 * n];
    add_joint_cotangent(&chain, cotangents, &mut out);
    out
}

/// Adds those derivatives, in the poses of `chain`.
pub(crate) fn add_joint_cotangent(chain: &Chain, cotangents: &[PoseTangent], out: &mut [f64]) {
    let mut turn = Vector3::zeros();
    let levers = levers(chain, cotangents);
    for (joint, lever) in levers.iter().enumerate().rev() {
        turn += lever;
        let own_axes = chain.disc(joint).tr_mul(&turn);
        for axis in 0..3 {
            out[3 * joint + axis] += own_axes[axis];
        }
    }
}

/// Derivative of a cost by each disc's turn in the world, given those by the poses.
pub(crate) fn levers(chain: &Chain, cotangents: &[PoseTangent]) -> Vec<Vector3<f64>> {
    let n = cotangents.len();
    let mut levers = vec![Vector3::zeros(); n];
    let mut above = Vector3::zeros();
    for k in (0..n).rev() {
        let arm = chain.positions[k] - chain.centres[k];
        // A turn of disc k moves its own origin, and the centre of the next joint with all above.
        levers[k] = arm.cross(&cotangents[k].position) + cotangents[k].rotation;
        if k + 1 < n {
            levers[k] += (chain.centres[k + 1] - chain.centres[k]).cross(&above);
        }
        above += cotangents[k].position;
    }
    levers
}
