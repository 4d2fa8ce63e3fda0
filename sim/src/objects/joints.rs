//! Joints of objects to the world as rapier's.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Matrix6, Unit, UnitQuaternion, Vector3, Vector6};
use rapier3d_f64::prelude::{
    GenericJoint, MotorModel, PrismaticJointBuilder, RevoluteJointBuilder,
};

use super::shapes::vector;
use crate::scene::{JointSpec, Obstacle};

/// Axis of a joint in the world at a rotation of its object.
pub(super) fn axis(joint: &JointSpec, rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    rotation * Unit::new_normalize(Vector3::from(joint.axis())).into_inner()
}

/// The joint of an object that stands where the scene has it, the first body being fixed at the world's origin.
pub(super) fn to_world(joint: &JointSpec, object: &Obstacle) -> GenericJoint {
    let local = axis(joint, &UnitQuaternion::identity());
    let world = axis(joint, &object.pose.rotation);
    match joint {
        JointSpec::Hinge(hinge) => {
            let anchor = Vector3::from(hinge.anchor);
            let place = object.pose.transform_point(&anchor.into()).coords;
            let mut built = RevoluteJointBuilder::new(vector(&world))
                .local_anchor1(vector(&place))
                .local_anchor2(vector(&anchor))
                .contacts_enabled(false);
            if let Some(limits) = hinge.limits {
                built = built.limits(limits);
            }
            if hinge.damping > 0.0 {
                built = built
                    .motor_model(MotorModel::ForceBased)
                    .motor_velocity(0.0, hinge.damping);
            }
            let mut joint: GenericJoint = built.build().into();
            // Both frames coincide where the object stands: the angle there is 0.
            let frame = joint.local_frame1.rotation;
            joint.local_frame2.rotation =
                super::shapes::pose(&object.pose.inverse()).rotation * frame;
            joint
        }
        JointSpec::Slider(slider) => {
            let place = object.pose.translation.vector;
            let mut built = PrismaticJointBuilder::new(vector(&local))
                .local_anchor1(vector(&place))
                .contacts_enabled(false);
            if let Some(limits) = slider.limits {
                built = built.limits(limits);
            }
            if slider.damping > 0.0 {
                built = built
                    .motor_model(MotorModel::ForceBased)
                    .motor_velocity(0.0, slider.damping);
            }
            let mut joint: GenericJoint = built.build().into();
            let frame = joint.local_frame2.rotation;
            joint.local_frame1.rotation = super::shapes::pose(&object.pose).rotation * frame;
            joint
        }
    }
}

/// Damping of an object's joint along its one motion (N s/m or N m s/rad).
pub(super) fn damping(joint: Option<&JointSpec>) -> f64 {
    match joint {
        None => 0.0,
        Some(JointSpec::Hinge(hinge)) => hinge.damping,
        Some(JointSpec::Slider(slider)) => slider.damping,
    }
}

/// An end of an object's joint.
pub(super) struct Stop {
    /// What is held there (m).
    pub point: Vector3<f64>,
    /// In which direction it is held.
    pub direction: Vector3<f64>,
    /// How far it may still go against that (m; of a hinge rad, at a point 1 m from its axis).
    pub gap: f64,
}

/// The ends of an object's joint, if it has any. `start` is where the joint's position is 0.
pub(super) fn stops(
    joint: Option<&JointSpec>,
    start: &Isometry3<f64>,
    pose: &Isometry3<f64>,
) -> Option<[Stop; 2]> {
    let joint = joint?;
    let axis = axis(joint, &pose.rotation);
    let ([low, high], position, point, along) = match joint {
        JointSpec::Slider(slider) => {
            let way = pose.translation.vector - start.translation.vector;
            let point = pose.translation.vector;
            (slider.limits?, axis.dot(&way), point, axis)
        }
        JointSpec::Hinge(hinge) => {
            let turn = pose.rotation * start.rotation.inverse();
            let half = turn.imag().dot(&axis).atan2(turn.w);
            // Of the two angles of a rotation the one within half a turn.
            let angle = (2.0 * half + PI).rem_euclid(TAU) - PI;
            let anchor = pose.transform_point(&hinge.anchor.into()).coords;
            let arm = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
            (hinge.limits?, angle, anchor + arm, axis.cross(&arm))
        }
    };
    let stop = |direction, gap| Stop {
        point,
        direction,
        gap,
    };
    Some([stop(along, position - low), stop(-along, high - position)])
}

/// The motions `[velocity of the centre of mass; angular velocity]` that a joint leaves its object, and their number, where the centre
/// of mass is at `arm` (m) from the object's origin, world axes.
pub(super) fn motions(
    joint: Option<&JointSpec>,
    rotation: &UnitQuaternion<f64>,
    arm: &Vector3<f64>,
) -> (Matrix6<f64>, usize) {
    let Some(joint) = joint else {
        return (Matrix6::identity(), 6);
    };
    let axis = axis(joint, rotation);
    let motion = match joint {
        JointSpec::Hinge(hinge) => {
            let anchor = rotation * Vector3::from(hinge.anchor);
            let linear = axis.cross(&(arm - anchor));
            Vector6::new(linear.x, linear.y, linear.z, axis.x, axis.y, axis.z)
        }
        JointSpec::Slider(_) => Vector6::new(axis.x, axis.y, axis.z, 0.0, 0.0, 0.0),
    };
    let mut basis = Matrix6::zeros();
    basis.set_column(0, &motion);
    (basis, 1)
}
