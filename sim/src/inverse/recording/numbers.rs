//! What unknowns are numbers of: a robot, and what lies between it and the recording.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::Transmission;
use super::explicit::{Explicit, change_joints};
use super::places::At;
use crate::robot::{Axis, Drive, Friction, Holes, RobotSpec, TendonSpec};

/// A robot and a transmission that take the values of unknowns. Changes are relative to the robot as it was given, so each unknown is
/// set once.
pub(super) struct Numbers<'a> {
    pub explicit: &'a Explicit,
    pub spec: &'a mut RobotSpec,
    pub transmission: &'a mut Transmission,
}

impl Numbers<'_> {
    fn change_tendons(&mut self, module: usize, mut change: impl FnMut(&mut TendonSpec)) {
        let ends = self.spec.routes.iter_mut().zip(&self.explicit.ends);
        ends.filter(|(_, end)| **end == module)
            .for_each(|(route, _)| change(&mut route.tendon));
    }

    /// Moves each hole of a body (0 the base, then the modules) and a tendon.
    fn move_holes(&mut self, place: impl Fn(usize, usize, [f64; 2]) -> [f64; 2]) {
        let modules = self.spec.modules.iter_mut().map(|m| &mut m.holes);
        let bodies = std::iter::once(&mut self.spec.base.holes).chain(modules);
        for (body, (holes, owners)) in bodies.zip(&self.explicit.owners).enumerate() {
            if let Holes::At(holes) = holes {
                for (hole, &owner) in holes.iter_mut().zip(owners) {
                    *hole = place(body, owner, *hole);
                }
            }
        }
    }
}

/// Multiplies the gains of all servos, whose own unknowns come before.
pub(super) fn scale_gains(numbers: &mut Numbers, _: At, factor: f64) {
    for servo in &mut numbers.transmission.servos {
        servo.gain *= factor;
    }
}

/// Rotates the holes of a tendon about the axis (rad).
pub(super) fn rotate_holes(numbers: &mut Numbers, at: At, angle: f64) {
    let (sin, cos) = angle.sin_cos();
    numbers.move_holes(|_, owner, [x, y]| match owner == at.number {
        true => [cos * x - sin * y, sin * x + cos * y],
        false => [x, y],
    });
}

/// Multiplies the distances of a module's holes from the axis; those of the base go with the first module.
pub(super) fn scale_holes(numbers: &mut Numbers, at: At, factor: f64) {
    numbers.move_holes(
        |body, _, [x, y]| match body.saturating_sub(1) == at.number {
            true => [factor * x, factor * y],
            false => [x, y],
        },
    );
}

/// Bends, or twists, a module at rest about an axis of its discs (rad), even along it.
pub(super) fn bend_at_rest(numbers: &mut Numbers, at: At, angle: f64) {
    let share = angle / numbers.spec.modules[at.number].discs as f64;
    change_joints(numbers.spec, at.number, |joint| {
        joint.rest[at.axis.index()] += share;
    });
}

pub(super) fn scale_bending(numbers: &mut Numbers, at: At, factor: f64) {
    change_joints(numbers.spec, at.number, |joint| {
        joint.bending = joint.bending.map(|stiffness| factor * stiffness);
    });
}

pub(super) fn scale_torsion(numbers: &mut Numbers, at: At, factor: f64) {
    change_joints(numbers.spec, at.number, |joint| joint.torsion *= factor);
}

/// Multiplies the stiffness of the tendons that end at a module: that of both springs of a series, so that the series' is.
pub(super) fn scale_tendons(numbers: &mut Numbers, at: At, factor: f64) {
    numbers.change_tendons(at.number, |tendon| {
        if let Drive::Gain(gain) = &mut tendon.drive {
            *gain *= factor;
        }
        if let Some(axial) = &mut tendon.axial_stiffness {
            *axial *= factor;
        }
    });
}

/// Sets the stiffening (1/m) of the tendons that end at a module.
pub(super) fn stiffen_tendons(numbers: &mut Numbers, at: At, stiffening: f64) {
    numbers.change_tendons(at.number, |tendon| {
        if tendon.stretches() {
            tendon.stiffening = stiffening;
        }
    });
}

/// Sets the coefficient of friction of the tendons that end at a module.
pub(super) fn set_friction(numbers: &mut Numbers, at: At, coefficient: f64) {
    numbers.change_tendons(at.number, |tendon| {
        tendon.friction.get_or_insert(Friction::NONE).coefficient = coefficient;
    });
}

/// Rotates the base about one of its own axes (rad).
pub(super) fn rotate_base(numbers: &mut Numbers, at: At, angle: f64) {
    let [w, x, y, z] = numbers.spec.base.orientation;
    let rotated =
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)) * rotation(at.axis, angle);
    numbers.spec.base.orientation = [rotated.w, rotated.i, rotated.j, rotated.k];
}

/// Rotates gravity about an axis of the world (rad).
pub(super) fn rotate_gravity(numbers: &mut Numbers, at: At, angle: f64) {
    let gravity = rotation(at.axis, angle) * Vector3::from(numbers.spec.gravity);
    numbers.spec.gravity = gravity.into();
}

fn rotation(axis: Axis, angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(axis.unit() * angle)
}
