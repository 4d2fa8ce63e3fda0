//! The moving parts of a robot and how they move.

use nalgebra::{Matrix3, Matrix6, Vector3};

use super::symmetric::{Symmetric, times};
use crate::chain::Chain;
use crate::robot::{HingeAxes, Hinges, Loads, Robot};

/// A joint and the disc it carries.
#[derive(Clone, Debug)]
pub(super) struct Link {
    /// Centre of the joint seen from that of the joint below, in the frame of the body below (m).
    pub joint_offset: Vector3<f64>,
    /// Mass (kg), and where its centre is, seen from the joint in the disc's frame (m).
    pub mass: f64,
    pub centre: Vector3<f64>,
    /// Moments of inertia about the centre of mass and the disc's axes (kg m²).
    pub moments: Vector3<f64>,
    /// Armature of a ball joint (kg m²).
    pub armature: f64,
    /// Damping of a ball joint that is alike about all axes, and what there is more about the disc's (N m s/rad).
    pub damping: f64,
    pub extra_damping: Vector3<f64>,
    /// The hinges that the joint consists of, with their dampings and armatures.
    pub hinges: Option<Box<Hinges>>,
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
                hinges: disc.hinges.clone(),
            })
            .collect()
    }

    /// The armature of each joint of a robot by its coordinates (kg m²), and `implicit` (s) times its damping, which acts on the change
    /// of rates as an armature would. 1 for a coordinate that the joint does not have.
    pub fn armatures(robot: &Robot, implicit: f64) -> Vec<Vector3<f64>> {
        (robot.discs().iter())
            .map(|disc| match &disc.hinges {
                None => Vector3::repeat(disc.armature + implicit * disc.damping),
                Some(hinges) => Vector3::from_fn(|i, _| match i < hinges.count {
                    true => hinges.armature[i] + implicit * hinges.damping[i],
                    false => 1.0,
                }),
            })
            .collect()
    }

    /// The joint's damping by its coordinates (N m s/rad).
    pub fn damping(&self) -> Vector3<f64> {
        match &self.hinges {
            None => self.extra_damping.add_scalar(self.damping),
            Some(hinges) => hinges.damping,
        }
    }

    /// The joint's armature in world axes (kg m²), its hinges standing along `axes`.
    pub fn armature_matrix(&self, axes: Option<&HingeAxes>) -> Matrix3<f64> {
        match (&self.hinges, axes) {
            (Some(hinges), Some(axes)) => axes.form(&hinges.armature),
            _ => Matrix3::identity() * self.armature,
        }
    }

    /// The joint's damping in world axes (N m s/rad), on a disc turned to `orientation`, its hinges standing along `axes`.
    pub fn damping_matrix(
        &self,
        orientation: &Matrix3<f64>,
        axes: Option<&HingeAxes>,
    ) -> Matrix3<f64> {
        if let (Some(hinges), Some(axes)) = (&self.hinges, axes) {
            return axes.form(&hinges.damping);
        }
        let alike = Matrix3::identity() * self.damping;
        if self.extra_damping == Vector3::zeros() {
            return alike;
        }
        alike + orientation * Matrix3::from_diagonal(&self.extra_damping) * orientation.transpose()
    }

    /// Whether the disc turns about some axis of its joint without resistance, where the joint has this `armature`.
    pub fn has_axis_without_inertia(&self, armature: &Vector3<f64>) -> bool {
        let inertia = self.body(&Matrix3::identity()).inertia.matrix();
        match &self.hinges {
            None => armature.x == 0.0 && inertia.determinant() <= 0.0,
            Some(hinges) => {
                let axes = hinges.axes_at(&hinges.zero).axes;
                let own = axes.tr_mul(&inertia) * axes + Matrix3::from_diagonal(armature);
                own.determinant() <= 0.0
            }
        }
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
    /// Angular bias acceleration: what the joint adds at constant rates (rad/s²). The axes of a ball joint turn with the disc, so this
    /// is the spin below, crossed with the joint's rate; lower hinges also turn the axes of those above.
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
    /// The axes of hinges, as in [`Chain::hinges`].
    pub hinges: &'a [Option<HingeAxes>],
}

/// Sets the motions of all links in the poses of `chain`, `velocity` the rates of the joints' coordinates.
pub(super) fn set_in_motion(
    links: &[Link],
    chain: &Chain,
    velocity: &[f64],
    motions: &mut [Motion],
) {
    let mut spin = Vector3::zeros();
    let moving = (motions.iter_mut().zip(links)).zip(velocity.as_chunks::<3>().0);
    for (((motion, link), velocity), pair) in moving.zip(chain.orientations.array_windows()) {
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
    if !chain.hinges.is_empty() {
        set_hinges_in_motion(chain, velocity, motions);
    }
}

/// The same for a robot some of whose joints consist of hinges.
fn set_hinges_in_motion(chain: &Chain, velocity: &[f64], motions: &mut [Motion]) {
    let mut spin = Vector3::zeros();
    let moving = motions.iter_mut().zip(velocity.as_chunks::<3>().0);
    for (joint, (motion, velocity)) in moving.enumerate() {
        let rates = Vector3::from(*velocity);
        let rate = times(chain.axes(joint), &rates);
        let own = (chain.hinges(joint)).map_or(Vector3::zeros(), |hinges| hinges.bias(&rates));
        *motion = Motion {
            arm: motion.arm,
            rate,
            spin: spin + rate,
            angular_bias: spin.cross(&rate) + own,
            linear_bias: spin.cross(&spin.cross(&motion.arm)),
        };
        spin += rate;
    }
}
