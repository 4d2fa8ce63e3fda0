//! The moving parts of a robot and how they move.

use nalgebra::{Matrix3, Matrix6, Vector3};

use super::symmetric::{Symmetric, times};
use crate::robot::{Loads, Robot};

/// A ball joint and the disc it carries.
#[derive(Clone, Debug)]
pub(super) struct Link {
    /// Centre of the joint seen from that of the joint below, in the frame of the body below (m).
    pub joint_offset: Vector3<f64>,
    /// Mass (kg), and where its centre is, seen from the joint in the disc's frame (m).
    pub mass: f64,
    pub centre: Vector3<f64>,
    /// Moments of inertia about the centre of mass and the disc's axes (kg m²).
    pub moments: Vector3<f64>,
    /// Armature of the joint (kg m²).
    pub armature: f64,
    /// Damping of the joint that is alike about all axes, and what there is more about the disc's (N m s/rad).
    pub damping: f64,
    pub extra_damping: Vector3<f64>,
}

impl Link {
    pub fn all(robot: &Robot) -> Vec<Self> {
        (robot.discs().iter())
            .map(|disc| Self {
                joint_offset: disc.joint_offset,
                mass: disc.mass,
                centre: disc.origin + disc.centre_of_mass,
                moments: disc.inertia,
                armature: disc.armature,
                damping: disc.damping,
                extra_damping: disc.extra_damping,
            })
            .collect()
    }

    /// The joint's damping in world axes (N m s/rad), on a disc turned to `orientation`.
    pub fn damping_matrix(&self, orientation: &Matrix3<f64>) -> Matrix3<f64> {
        let alike = Matrix3::identity() * self.damping;
        if self.extra_damping == Vector3::zeros() {
            return alike;
        }
        alike + orientation * Matrix3::from_diagonal(&self.extra_damping) * orientation.transpose()
    }

    /// Whether the disc turns about some axis through its joint without resistance.
    pub fn has_axis_without_inertia(&self) -> bool {
        let body = self.body(&Matrix3::identity());
        body.inertia.matrix().determinant() <= 0.0
    }

    /// The disc as a rigid body, turned to `orientation`.
    #[inline(always)]
    pub fn body(&self, orientation: &Matrix3<f64>) -> RigidBody {
        let centre = times(orientation, &self.centre);
        RigidBody {
            mass: self.mass,
            moment: centre * self.mass,
            inertia: Symmetric::turned(orientation, &self.moments)
                .add(&Symmetric::point_mass(self.mass, &centre)),
        }
    }
}

/// A point mass on the distal disc.
#[derive(Clone, Copy, Debug)]
pub(super) struct PointMass {
    /// Mass (kg).
    pub mass: f64,
    /// Where it is, seen from the disc's joint in the disc's frame (m).
    pub arm: Vector3<f64>,
}

impl PointMass {
    pub fn payload(robot: &Robot, loads: &Loads) -> Self {
        let payload = loads.tip_payload();
        let origin = (robot.discs().last()).map_or(Vector3::zeros(), |disc| disc.origin);
        Self {
            mass: payload.mass,
            arm: origin + Vector3::from(payload.offset),
        }
    }

    /// As a rigid body, on a disc turned to `orientation`.
    pub fn body(&self, orientation: &Matrix3<f64>) -> RigidBody {
        let arm = times(orientation, &self.arm);
        RigidBody {
            mass: self.mass,
            moment: arm * self.mass,
            inertia: Symmetric::point_mass(self.mass, &arm),
        }
    }
}

/// Inertia of a rigid body about a joint's centre, world axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct RigidBody {
    /// Mass (kg).
    pub mass: f64,
    /// Mass times its centre's position from the joint (kg m).
    pub moment: Vector3<f64>,
    /// Moments of inertia about the joint's centre (kg m²).
    pub inertia: Symmetric,
}

impl RigidBody {
    /// The inertia of motions: of `[turn; displacement of the joint's centre]`.
    pub fn spatial(&self) -> Matrix6<f64> {
        let mut spatial = Matrix6::from_diagonal_element(self.mass);
        let coupling = self.moment.cross_matrix();
        spatial
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&self.inertia.matrix());
        spatial.fixed_view_mut::<3, 3>(0, 3).copy_from(&coupling);
        spatial.fixed_view_mut::<3, 3>(3, 0).copy_from(&-coupling);
        spatial
    }

    /// Two bodies as one.
    pub fn with(&self, other: &Self) -> Self {
        Self {
            mass: self.mass + other.mass,
            moment: self.moment + other.moment,
            inertia: self.inertia.add(&other.inertia),
        }
    }
}

/// How a link moves; world axes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Motion {
    /// Centre of the joint from that of the joint below (m).
    pub arm: Vector3<f64>,
    /// Angular velocity of the joint (rad/s).
    pub rate: Vector3<f64>,
    /// Angular velocity of the disc (rad/s).
    pub spin: Vector3<f64>,
    /// Angular bias acceleration: what the joint adds at constant rates (rad/s²). Its axes turn with
    /// the disc, so this is the spin below, crossed with the joint's rate.
    pub angular_bias: Vector3<f64>,
    /// Linear bias acceleration: of the joint's centre from that of the joint below at constant rates,
    /// centrifugal (m/s²).
    pub linear_bias: Vector3<f64>,
}

/// A chain of links in motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct MovingChain<'a> {
    pub links: &'a [Link],
    pub payload: &'a PointMass,
    /// Orientations of the discs in the world.
    pub orientations: &'a [Matrix3<f64>],
    pub motions: &'a [Motion],
}

/// Sets the motions of all links: `orientations` of the base and the discs in the world, `velocity`
/// the joints' rates in the discs' frames.
pub(super) fn set_in_motion(
    links: &[Link],
    orientations: &[Matrix3<f64>],
    velocity: &[f64],
    motions: &mut [Motion],
) {
    let mut spin = Vector3::zeros();
    let moving = (motions.iter_mut().zip(links)).zip(velocity.as_chunks::<3>().0);
    for (((motion, link), velocity), pair) in moving.zip(orientations.array_windows()) {
        let [below, own]: &[Matrix3<f64>; 2] = pair;
        let arm = times(below, &link.joint_offset);
        let rate = times(own, &Vector3::from(*velocity));
        *motion = Motion {
            arm,
            rate,
            spin: spin + rate,
            angular_bias: spin.cross(&rate),
            linear_bias: spin.cross(&spin.cross(&arm)),
        };
        spin += rate;
    }
}
