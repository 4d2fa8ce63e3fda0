//! One body on a ball joint or on hinges as a disc.

use nalgebra::{Isometry3, Vector3};

use super::body::{BodyReader, Carried, RigidGroup, Site};
use super::check::SMALLEST_MASS;
use super::frame::SAME_PLACE;
use super::joint_element::{BodyJoint, JointKind};
use super::mass::{Geom, GeomMass, PartMass, Shape};
use crate::formats::{DiscMass, ImportError, is_inertia};
use crate::robot::{Backbone, HingeJoint, RigidMass};

/// Angles (rad), and shares of the largest moment of inertia, that count as none.
const NEGLIGIBLE: f64 = 1e-9;

/// A disc before its place in the chain is known. Its origin is the centre of the one cylinder that
/// shows it, or else its centre of mass.
pub(super) struct DiscBody {
    pub element: usize,
    /// Pose of the body in the frame of the body (with those fastened to it) that carries it.
    pub pose: Isometry3<f64>,
    pub joint: BodyJoint,
    /// Height of the origin in the body's frame (m).
    pub center: f64,
    /// Height of the origin above the joint (m).
    pub joint_below: f64,
    pub mass: DiscMass,
    pub radius: f64,
    pub half_height: f64,
}

impl BodyReader<'_> {
    pub fn disc(
        &mut self,
        body: &Carried<'_>,
        group: &RigidGroup<'_>,
    ) -> Result<DiscBody, ImportError> {
        let Some(joint) = self.body_joint(&group.joints)? else {
            let reason = "expected a ball joint, or hinges";
            return Err(self.document.refuse(body.element, reason));
        };
        let refuse = |reason: &str| Err(self.document.refuse(body.element, reason));
        if group.masses.is_empty() {
            return refuse("the body has no mass: expected geoms or an inertial");
        }
        let total = PartMass::sum(&group.masses);
        if total.mass < SMALLEST_MASS {
            let reason = format!(
                "its mass is {} kg; expected one, as MuJoCo does",
                total.mass
            );
            return refuse(&reason);
        }
        is_inertia(total.inertia.diagonal().into())
            .map_err(|reason| self.document.refuse(body.element, reason))?;
        let drawn = self.cylinder_of(group);
        if drawn.is_none() && off_axis(&total.center) {
            return refuse("the centre of mass lies off the z axis: expected on it");
        }
        let center = drawn.unwrap_or(total.center.z);
        if off_axis(&joint.center) {
            return refuse("the joint lies off the z axis: expected on it");
        }
        let joint_below = center - joint.center.z;
        if joint_below < -SAME_PLACE {
            let reason = "the joint lies above the disc's cylinder, or centre of mass: expected in \
                          its centre or below";
            return refuse(reason);
        }
        let mut between = total.inertia;
        between.fill_diagonal(0.0);
        if between.amax() > NEGLIGIBLE * total.inertia.amax() {
            return refuse("products of inertia: expected the body's axes to be principal ones");
        }
        let Some((radius, half_height)) = extent(&group.geoms) else {
            return refuse("expected a geom: discs are seen as cylinders");
        };
        let mass = match plain_density(group) {
            Some(density) => DiscMass::Density(density),
            None => DiscMass::Rigid(RigidMass {
                mass: total.mass,
                inertia: total.inertia.diagonal().into(),
                centre_of_mass: (total.center - Vector3::new(0.0, 0.0, center)).into(),
            }),
        };
        if drawn.is_none() {
            let text = "drawn as one upright cylinder around its centre of mass";
            self.note(body.element, text);
        }
        Ok(DiscBody {
            element: body.element,
            pose: body.carrier_pose * self.pose(body.element)?,
            joint,
            center,
            joint_below: joint_below.max(0.0),
            mass,
            radius,
            half_height,
        })
    }
}

impl BodyReader<'_> {
    /// Height of the centre of the one upright cylinder on the z axis that shows a body (m), if the
    /// tendons' holes are at its height.
    fn cylinder_of(&self, group: &RigidGroup<'_>) -> Option<f64> {
        let [geom] = group.geoms.as_slice() else {
            return None;
        };
        let place = &geom.pose.translation.vector;
        let is_disc = matches!(geom.shape, Shape::Cylinder { .. }) && is_upright(geom);
        let used = |site: &&Site<'_>| site.name.is_some_and(|n| self.used_sites.contains(n));
        let mut holes = group.sites.iter().filter(used);
        let level = holes.all(|site| (site.in_group().z - place.z).abs() < SAME_PLACE);
        (is_disc && !off_axis(place) && level).then_some(place.z)
    }
}

impl DiscBody {
    /// Origin of the disc with its joint not turned, where the body below has its origin `below`
    /// (m) high in its frame; seen from that origin.
    pub fn straight(&self, pose: &Isometry3<f64>, below: f64) -> Vector3<f64> {
        let position = pose.translation.vector;
        if is_turned(pose) {
            let joint = position + pose.rotation * self.joint.center;
            joint + Vector3::new(0.0, 0.0, self.joint_below - below)
        } else {
            // The same, without the rounding.
            position + Vector3::new(0.0, 0.0, self.center - below)
        }
    }

    /// The spring of the joint, at rest in `pose`.
    pub fn backbone(&self, pose: &Isometry3<f64>) -> Option<Backbone> {
        let JointKind::Ball(springs) = &self.joint.kind else {
            return None;
        };
        self.joint.has_rest().then_some(Backbone {
            bending: [springs.x, springs.y],
            torsion: springs.z,
            rest: turn_of(pose),
        })
    }

    /// The hinges that the joint consists of, at the angles 0 in `pose`.
    pub fn hinges(&self, pose: &Isometry3<f64>) -> Option<HingeJoint> {
        match &self.joint.kind {
            JointKind::Ball(_) => None,
            JointKind::Hinges(joint) => Some(HingeJoint {
                zero: turn_of(pose),
                ..joint.clone()
            }),
        }
    }
}

/// Rotation vector of a pose; none where it is negligible.
fn turn_of(pose: &Isometry3<f64>) -> [f64; 3] {
    match is_turned(pose) {
        true => pose.rotation.scaled_axis().into(),
        false => [0.0; 3],
    }
}

pub(super) fn is_turned(pose: &Isometry3<f64>) -> bool {
    pose.rotation.angle() > NEGLIGIBLE
}

pub(super) fn off_axis(point: &Vector3<f64>) -> bool {
    point.x.hypot(point.y) > SAME_PLACE
}

/// Density of the one upright cylinder that a body consists of.
fn plain_density(group: &RigidGroup<'_>) -> Option<f64> {
    let ([geom], [part]) = (group.geoms.as_slice(), group.masses.as_slice()) else {
        return None;
    };
    let GeomMass::Density(density) = geom.mass else {
        return None;
    };
    let plain = is_upright(geom) && matches!(geom.shape, Shape::Cylinder { .. });
    // An inertial may stand in place of the geom's own mass.
    let own = geom.part();
    (plain && part.mass == own.mass && part.inertia == own.inertia && part.center == own.center)
        .then_some(density)
}

fn is_upright(geom: &Geom) -> bool {
    let axis = geom.pose.rotation * Vector3::z();
    axis.x.hypot(axis.y) < NEGLIGIBLE
}

/// Radius and half height of the cylinder that shows a body (m): of its first cylinder on the z
/// axis, else of the cylinder around its first geom.
fn extent(geoms: &[Geom]) -> Option<(f64, f64)> {
    let is_disc = |geom: &&Geom| {
        matches!(geom.shape, Shape::Cylinder { .. })
            && is_upright(geom)
            && !off_axis(&geom.pose.translation.vector)
    };
    let geom = geoms.iter().find(is_disc).or(geoms.first());
    geom.map(|geom| geom.shape.extent())
}
