//! Where a robot is, at rest or in motion: what cameras, sensors and controllers see of it; derivatives by it.

use nalgebra::{DMatrix, Isometry3, Quaternion, UnitQuaternion, Vector3};

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

/// A frame fixed to a disc: a gripper, a marker, the tip's face.
///
/// ```
/// use tdcr_sim::pose::ToolFrame;
/// use tdcr_sim::robot::{Loads, Robot};
///
/// let robot = Robot::load("2m")?;
/// let (command, loads) = (robot.mean_command(), Loads::default());
/// let settled = robot.settle(&command, &loads);
/// let tool = ToolFrame::tip_face(&robot);
/// println!("{}", tool.pose(&settled.pose()));
/// // How it moves with a force and a moment on it.
/// let compliance = robot.sensitivity(&command, &loads, &settled)?.compliance(&tool)?;
/// assert!(compliance[(0, 0)] > 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolFrame {
    /// The disc, from 0 at the base.
    pub disc: usize,
    /// The frame in that of the disc (m).
    pub in_disc: Isometry3<f64>,
}

impl ToolFrame {
    /// The centre of the distal disc's upper face, its axes along the disc's.
    pub fn tip_face(robot: &Robot) -> Self {
        let height = robot.discs().last().map_or(0.0, |disc| disc.half_height);
        Self {
            disc: robot.discs().len().saturating_sub(1),
            in_disc: Isometry3::translation(0.0, 0.0, height),
        }
    }

    /// The frame in the world (m).
    ///
    /// # Panics
    /// For a disc that the robot does not have; so do the functions below.
    pub fn pose(&self, pose: &Pose) -> Isometry3<f64> {
        pose.disc(self.disc) * self.in_disc
    }

    /// The frame's origin from that of its disc, world axes (m).
    pub fn arm(&self, pose: &Pose) -> Vector3<f64> {
        pose.orientations[self.disc] * self.in_disc.translation.vector
    }

    /// The frame's tangent, given that of its disc.
    pub fn tangent(&self, pose: &Pose, disc: &PoseTangent) -> PoseTangent {
        PoseTangent {
            position: disc.position + disc.rotation.cross(&self.arm(pose)),
            rotation: disc.rotation,
        }
    }

    /// The disc's cotangent, given that of the frame: what [`Sensitivity::vjp`](crate::sensitivity::Sensitivity::vjp) and
    /// [`joint_cotangent`] take.
    pub fn cotangent(&self, pose: &Pose, frame: &PoseTangent) -> PoseTangent {
        PoseTangent {
            position: frame.position,
            rotation: frame.rotation + self.arm(pose).cross(&frame.position),
        }
    }

    /// The frame's Jacobian by the joints' coordinates, turns `q exp(dq)` in the disc's own frame or hinges' angles: six rows, the origin (m) and the
    /// rotation (rad) in the world, `3 n` columns (rad).
    pub fn joint_jacobian(&self, robot: &Robot, configuration: &Configuration) -> DMatrix<f64> {
        let mut chain = Chain::new(robot);
        chain.place(robot, configuration);
        let origin =
            chain.positions[self.disc] + chain.disc(self.disc) * self.in_disc.translation.vector;
        let mut jacobian = DMatrix::zeros(6, robot.dof());
        for joint in 0..=self.disc {
            let axes = chain.axes(joint);
            let arm = origin - chain.centres[joint];
            let mut shift = jacobian.fixed_view_mut::<3, 3>(0, 3 * joint);
            shift.copy_from(&(-arm.cross_matrix() * axes));
            let mut turn = jacobian.fixed_view_mut::<3, 3>(3, 3 * joint);
            turn.copy_from(axes);
        }
        jacobian
    }
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

/// Derivatives of a cost by the joints' coordinates, turns `q exp(dq)` in the disc's own frame or hinges' angles (three entries per
/// joint, rad), given
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
        let own_axes = chain.axes(joint).tr_mul(&turn);
        for axis in 0..3 {
            out[3 * joint + axis] += own_axes[axis];
        }
    }
}

/// Turn (rad) of each disc and displacement (m) of its joint's centre by the joints' turns, to first order, world axes.
pub(crate) fn motions(
    centres: &[Vector3<f64>],
    turns: &[Vector3<f64>],
) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let (mut turn, mut shift) = (Vector3::zeros(), Vector3::zeros());
    let mut below = centres.first().copied().unwrap_or_default();
    (turns.iter().zip(centres))
        .map(|(own, centre): (&Vector3<f64>, _)| {
            shift += turn.cross(&(centre - below));
            below = *centre;
            turn += own;
            (turn, shift)
        })
        .collect()
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
