//! Kinematics of the chain on SO(3)^n.
//!
//! The coordinates of a ball joint are a rotation vector `xi_i` in its disc's own frame, `q_i exp(xi_i)`, as MuJoCo's ball joints
//! have them; those of [`Hinges`](crate::robot::Hinges) are their angles, and the joint's rotation is one that they can have. Inside,
//! turns are kept in world axes, so that nothing changes frames along the chain: of hinges, turns in the span of their axes.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::robot::{Disc, HingeAxes, Robot};

/// Configuration `q`: the rotation of each disc relative to the body below, from the base up.
#[derive(Clone, Debug, PartialEq)]
pub struct Configuration(pub Vec<UnitQuaternion<f64>>);

impl Configuration {
    /// Origins (m) and orientations of the discs of `robot` in this configuration, world frame. Signs of the quaternions as in
    /// an equilibrium: each nearer to that of the body below.
    ///
    /// # Panics
    /// If the configuration is of a robot with another number of discs.
    pub fn place(&self, robot: &Robot) -> (Vec<Vector3<f64>>, Vec<UnitQuaternion<f64>>) {
        assert_eq!(self.0.len(), robot.discs().len(), "of this robot");
        let mut chain = Chain::new(robot);
        chain.place(robot, self);
        let mut orientations = vec![UnitQuaternion::identity(); self.0.len()];
        chain.quaternions(&mut orientations);
        (chain.positions, orientations)
    }

    /// The straight pose of a robot: no joint turned, all hinges at the angle 0.
    pub fn straight(robot: &Robot) -> Self {
        let joints = robot.discs().iter();
        Self(joints.map(Disc::straight_rotation).collect())
    }

    /// Writes where a step leads to `out`: joint `i` of `robot` turned by `step[3 i .. 3 i + 3]` (rad), the rotation vector of
    /// `self * exp(step)` in its disc's own frame, or steps of its hinges' angles.
    pub fn retract(&self, robot: &Robot, step: &[f64], out: &mut Self) {
        let joints = self.0.iter().zip(&mut out.0).zip(robot.discs());
        for (((from, to), disc), step) in joints.zip(step.chunks_exact(3)) {
            *to = disc.moved(from, &Vector3::from_column_slice(step));
        }
    }
}

impl Disc {
    /// The rotation of the disc's joint in the straight pose.
    pub(crate) fn straight_rotation(&self) -> UnitQuaternion<f64> {
        (self.hinges.as_ref()).map_or_else(UnitQuaternion::identity, |hinges| hinges.zero)
    }

    /// The rotation to which a step of the joint's coordinates leads from `q` (rad).
    #[inline]
    pub(crate) fn moved(
        &self,
        q: &UnitQuaternion<f64>,
        step: &Vector3<f64>,
    ) -> UnitQuaternion<f64> {
        match &self.hinges {
            None => turned(q, step),
            Some(hinges) => hinges.moved(q, step),
        }
    }

    /// The step of the joint's coordinates that turns its rotation `q` by the rotation vector `turn` (rad), `q exp(turn)`, to first
    /// order: the turn itself, or of hinges the steps of their angles, then 0; what they cannot turn by is left out.
    pub fn step_along(&self, q: &UnitQuaternion<f64>, turn: &Vector3<f64>) -> Vector3<f64> {
        match &self.hinges {
            None => *turn,
            Some(hinges) => hinges.axes_at(q).dual.tr_mul(turn),
        }
    }

    /// The transpose of [`step_along`](Self::step_along): derivatives of a cost by a turn of the joint at `q`, from those by a step of
    /// its coordinates.
    pub fn turn_cotangent(&self, q: &UnitQuaternion<f64>, by_step: &Vector3<f64>) -> Vector3<f64> {
        match &self.hinges {
            None => *by_step,
            Some(hinges) => hinges.axes_at(q).dual * by_step,
        }
    }

    /// The step of the joint's coordinates that leads from one rotation to another near it, to first order (rad).
    pub(crate) fn step_between(
        &self,
        from: &UnitQuaternion<f64>,
        to: &UnitQuaternion<f64>,
    ) -> Vector3<f64> {
        match &self.hinges {
            None => (from.inverse() * to).imag() * 2.0,
            Some(hinges) => hinges.between(from, to),
        }
    }
}

/// `q exp(turn)`, normalised. Left alone the compiler calls it, which takes a seventh of a step.
#[inline(always)]
pub(crate) fn turned(q: &UnitQuaternion<f64>, turn: &Vector3<f64>) -> UnitQuaternion<f64> {
    let squared = turn.norm_squared();
    // cos(|turn| / 2) and sin(|turn| / 2) / |turn|, by their series where a turn is small: the next
    // terms are below 1e-17.
    let (cos, sinc) = if squared < 1e-4 {
        let x = squared / 4.0;
        (
            1.0 - x * (0.5 - x * (1.0 / 24.0 - x * (1.0 / 720.0))),
            0.5 - x * (1.0 / 12.0 - x * (1.0 / 240.0 - x * (1.0 / 10080.0))),
        )
    } else {
        let angle = squared.sqrt();
        let (sin, cos) = (0.5 * angle).sin_cos();
        (cos, sin / angle)
    };
    let (w, v) = (q.w, q.imag());
    let u = turn * sinc;
    let product =
        nalgebra::Quaternion::from_parts(w * cos - v.dot(&u), u * w + v * cos + v.cross(&u));
    UnitQuaternion::new_normalize(product)
}

/// World poses of all discs in one configuration.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    /// Orientation of the base, then of each disc, in the world.
    pub orientations: Vec<Matrix3<f64>>,
    /// Centre of each disc's joint in the world (m).
    pub centres: Vec<Vector3<f64>>,
    /// Origin of each disc in the world (m).
    pub positions: Vec<Vector3<f64>>,
    /// Of each joint that consists of hinges their axes in the world; of a robot without hinges no entries.
    pub hinges: Vec<Option<HingeAxes>>,
}

impl Chain {
    /// Storage for the poses of a robot's discs.
    pub fn new(robot: &Robot) -> Self {
        let n = robot.discs().len();
        let base = *robot.base_orientation().to_rotation_matrix().matrix();
        Self {
            orientations: vec![base; n + 1],
            centres: vec![Vector3::zeros(); n],
            positions: vec![Vector3::zeros(); n],
            hinges: if robot.has_hinges() {
                vec![None; n]
            } else {
                Vec::new()
            },
        }
    }

    /// Forward kinematics: the poses of all discs in configuration `q`.
    pub fn place(&mut self, robot: &Robot, q: &Configuration) {
        let mut below = self.orientations[0];
        let mut centre = robot.base();
        let poses = (self.orientations[1..].iter_mut())
            .zip(self.centres.iter_mut().zip(&mut self.positions));
        for ((disc, joint), (orientation, (joint_centre, position))) in
            robot.discs().iter().zip(&q.0).zip(poses)
        {
            centre += below * disc.joint_offset;
            below *= joint.to_rotation_matrix().matrix();
            *orientation = below;
            *joint_centre = centre;
            *position = centre + below * disc.origin;
        }
        for (joint, axes) in self.hinges.iter_mut().enumerate() {
            let hinges = robot.discs()[joint].hinges.as_ref();
            let orientation = &self.orientations[joint + 1];
            *axes = hinges.map(|hinges| hinges.axes_at(&q.0[joint]).turned(orientation));
        }
    }

    /// The axes of the hinges of a joint in the world; `None` for a ball joint.
    #[inline]
    pub fn hinges(&self, joint: usize) -> Option<&HingeAxes> {
        self.hinges.get(joint)?.as_ref()
    }

    /// What takes steps of a joint's coordinates to turns, world axes: of a ball joint the orientation of its disc. Transposed, it
    /// takes moments to those about the coordinates' axes.
    #[inline]
    pub fn axes(&self, joint: usize) -> &Matrix3<f64> {
        self.hinges(joint)
            .map_or(self.disc(joint), |hinges| &hinges.axes)
    }

    /// What takes moments about the axes of a joint's coordinates to moments, world axes. Transposed, it takes turns to steps of the
    /// coordinates.
    #[inline]
    pub fn dual(&self, joint: usize) -> &Matrix3<f64> {
        self.hinges(joint)
            .map_or(self.disc(joint), |hinges| &hinges.dual)
    }

    /// Writes the orientation of each disc as a quaternion: of the two the one nearer to that of the body below, counted
    /// from the base's with `w >= 0`.
    pub fn quaternions(&self, out: &mut [UnitQuaternion<f64>]) {
        let mut below = quaternion(&self.orientations[0]);
        if below.w < 0.0 {
            below = opposite(&below);
        }
        for (to, orientation) in out.iter_mut().zip(&self.orientations[1..]) {
            *to = quaternion(orientation);
            if to.coords.dot(&below.coords) < 0.0 {
                *to = opposite(to);
            }
            below = *to;
        }
    }

    /// Orientation of disc `index`.
    pub fn disc(&self, index: usize) -> &Matrix3<f64> {
        &self.orientations[index + 1]
    }

    /// A point of a disc, given from its origin in its frame, in the world (m).
    pub fn carried(&self, disc: usize, local: &Vector3<f64>) -> Vector3<f64> {
        self.positions[disc] + self.disc(disc) * local
    }

    /// A point in the world, from the origin of a disc in its frame (m).
    pub fn local(&self, disc: usize, point: &Vector3<f64>) -> Vector3<f64> {
        self.disc(disc).tr_mul(&(point - self.positions[disc]))
    }

    /// A point of a disc (`None`: of the base) given from its joint's centre (the base origin) in
    /// its frame, in the world (m).
    pub fn point(&self, robot: &Robot, disc: Option<usize>, local: &Vector3<f64>) -> Vector3<f64> {
        match disc {
            None => robot.base() + self.orientations[0] * local,
            Some(index) => self.centres[index] + self.disc(index) * local,
        }
    }
}

fn quaternion(orientation: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*orientation))
}

/// The other quaternion of the same rotation.
fn opposite(q: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(-q.into_inner())
}
