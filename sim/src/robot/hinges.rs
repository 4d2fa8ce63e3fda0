//! Joints that are hinges: universal joints, and other rows of one to three hinges at one place.
//!
//! With angles `t_i` about axes `a_i` fixed to the disc, and `R_0` where all angles are 0, the joint's rotation is
//! `R = R_0 exp(t_1 a_1) .. exp(t_m a_m)`, `m <= 3`: the first hinge lies on the body below and carries all others. A turn of the joint
//! is `w = A du`, the columns of `A` the hinges' axes as they stand, so of one or two hinges it has as many freedoms. To second order
//! turns along the axes compose by the formula of Baker, Campbell and Hausdorff: `w = A du + 1/2 sum_(i<j) du_i du_j e_i x e_j`.
//!
//! A rotation has one set of angles from -180 to 180 degrees: of three hinges that on the side of the gimbal lock where the angles 0
//! are. In gimbal lock, where the three axes lie in one plane, a joint has lost a freedom; no robot here goes there.

use std::f64::consts::PI;

use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::angle;
use super::checks::{finite, not_negative, radians};
use super::hinge_axes::HingeAxes;
use super::spec_error::{SpecError, refuse};

/// Smallest sine of the angle between successive axes, and smallest volume that three axes span at the angles 0.
const LEAST_APART: f64 = 1e-3;
/// Share of the volume that three axes span at the angles 0 below which they count as in gimbal lock.
const LOCKED: f64 = 1e-4;

/// A joint of one to three hinges at one place, in the order from the body below to the disc: about x, then y, it is a universal joint.
/// Files may give `zero_degrees` in place of `zero`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "HingeJointInFile")]
pub struct HingeJoint {
    /// The hinges, each carrying those that follow.
    pub hinges: Vec<Hinge>,
    /// Rotation vector (rad) from the body below to the disc where all angles are 0; none where the file does not give it.
    #[serde(skip_serializing_if = "is_none")]
    pub zero: [f64; 3],
}

/// One hinge. Files may give `rest_degrees` in place of `rest`, and leave out what is 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "HingeInFile")]
pub struct Hinge {
    /// Axis in the disc's frame, at the angles 0; of any length but 0.
    pub axis: [f64; 3],
    /// Stiffness (N m/rad): the moment about the axis is that times the angle from the rest.
    pub stiffness: f64,
    /// Angle at which the spring is at rest (rad).
    pub rest: f64,
    /// Viscous damping (N m s/rad) besides the module's.
    pub damping: f64,
    /// Armature inertia (kg m²) besides the module's.
    pub armature: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HingeJointInFile {
    hinges: Vec<Hinge>,
    zero: Option<[f64; 3]>,
    zero_degrees: Option<[f64; 3]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HingeInFile {
    axis: [f64; 3],
    #[serde(default)]
    stiffness: f64,
    rest: Option<f64>,
    rest_degrees: Option<f64>,
    #[serde(default)]
    damping: f64,
    #[serde(default)]
    armature: f64,
}

impl TryFrom<HingeJointInFile> for HingeJoint {
    type Error = String;

    fn try_from(file: HingeJointInFile) -> Result<Self, String> {
        let to_radians = |degrees: [f64; 3]| degrees.map(f64::to_radians);
        let names = ["zero", "zero_degrees"];
        let zero = angle::one_of(file.zero, file.zero_degrees, names, to_radians)?;
        Ok(Self {
            hinges: file.hinges,
            zero: zero.unwrap_or_default(),
        })
    }
}

impl TryFrom<HingeInFile> for Hinge {
    type Error = String;

    fn try_from(file: HingeInFile) -> Result<Self, String> {
        let names = ["rest", "rest_degrees"];
        let rest = angle::one_of(file.rest, file.rest_degrees, names, f64::to_radians)?;
        Ok(Self {
            axis: file.axis,
            stiffness: file.stiffness,
            rest: rest.unwrap_or_default(),
            damping: file.damping,
            armature: file.armature,
        })
    }
}

impl Hinge {
    /// A hinge about `axis` with a spring of `stiffness` (N m/rad), at rest at the angle 0.
    pub fn new(axis: [f64; 3], stiffness: f64) -> Self {
        Self {
            axis,
            stiffness,
            rest: 0.0,
            damping: 0.0,
            armature: 0.0,
        }
    }
}

impl HingeJoint {
    /// A universal joint: a hinge about x, then one about y, each with a spring of `stiffness` (N m/rad).
    pub fn universal(stiffness: f64) -> Self {
        let hinges = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(|axis| Hinge::new(axis, stiffness));
        Self {
            hinges: hinges.to_vec(),
            zero: [0.0; 3],
        }
    }

    /// Checks every field.
    pub(crate) fn validate(field: &str, joint: &Self) -> Result<(), SpecError> {
        let count = joint.hinges.len();
        if !(1..=3).contains(&count) {
            let field = format!("{field}.hinges");
            return Err(refuse(
                &field,
                format!("a list of {count}"),
                "one to three hinges",
            ));
        }
        radians(&format!("{field}.zero"), &joint.zero, "zero_degrees")?;
        for (index, hinge) in joint.hinges.iter().enumerate() {
            let at = |name: &str| format!("{field}.hinges[{index}].{name}");
            finite(&at("axis"), &hinge.axis)?;
            if Vector3::from(hinge.axis).norm() < 1e-6 {
                let found = format!("{:?}", hinge.axis);
                return Err(refuse(&at("axis"), found, "a direction"));
            }
            not_negative(&at("stiffness"), hinge.stiffness)?;
            not_negative(&at("damping"), hinge.damping)?;
            not_negative(&at("armature"), hinge.armature)?;
            radians(&at("rest"), &[hinge.rest], "rest_degrees")?;
            if hinge.rest.abs() > PI {
                let found = format!("{} rad", hinge.rest);
                return Err(refuse(&at("rest"), found, "-pi to pi"));
            }
        }
        let axes: Vec<_> = (joint.hinges.iter())
            .map(|hinge| Vector3::from(hinge.axis).normalize())
            .collect();
        let parallel = |pair: &[Vector3<f64>]| pair[0].cross(&pair[1]).norm() < LEAST_APART;
        if let Some(index) = axes.windows(2).position(parallel) {
            let found = format!("parallel to that of hinge {index}");
            let at = format!("{field}.hinges[{}].axis", index + 1);
            return Err(refuse(&at, found, "another direction"));
        }
        if let [a, b, c] = axes[..]
            && a.dot(&b.cross(&c)).abs() < LEAST_APART
        {
            let expected =
                "three that are not in one plane: at the angles 0 the joint is in gimbal lock";
            return Err(refuse(
                &format!("{field}.hinges"),
                "axes in one plane",
                expected,
            ));
        }
        Ok(())
    }
}

/// The hinges of a joint laid out for computation; entries of hinges that it does not have are zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Hinges {
    /// How many.
    pub count: usize,
    /// Unit vectors along the axes, in the disc's frame at the angles 0.
    pub axes: [Vector3<f64>; 3],
    /// Rotation of the disc against the body below at the angles 0.
    pub zero: UnitQuaternion<f64>,
    /// Stiffness of each (N m/rad).
    pub stiffness: Vector3<f64>,
    /// Angle at which each spring is at rest (rad).
    pub rest: Vector3<f64>,
    /// Damping of each (N m s/rad).
    pub damping: Vector3<f64>,
    /// Armature inertia of each (kg m²).
    pub armature: Vector3<f64>,
}

impl Hinges {
    /// Those of a joint, with the `damping` and `armature` that its module gives each.
    pub(super) fn of_joint(joint: &HingeJoint, damping: f64, armature: f64) -> Self {
        let count = joint.hinges.len();
        let each = |value: &dyn Fn(&Hinge) -> f64| {
            Vector3::from_fn(|i, _| joint.hinges.get(i).map_or(0.0, value))
        };
        let axis = |hinge: &Hinge| Vector3::from(hinge.axis).normalize();
        Self {
            count,
            axes: [0, 1, 2].map(|i| joint.hinges.get(i).map_or(Vector3::zeros(), axis)),
            zero: UnitQuaternion::from_scaled_axis(Vector3::from(joint.zero)),
            stiffness: each(&|hinge| hinge.stiffness),
            rest: each(&|hinge| hinge.rest),
            damping: each(&|hinge| damping + hinge.damping),
            armature: each(&|hinge| armature + hinge.armature),
        }
    }

    /// 1 for each hinge that there is, 0 for what is missing to three.
    pub(crate) fn present(&self) -> Vector3<f64> {
        Vector3::from_fn(|i, _| f64::from(u8::from(i < self.count)))
    }

    /// The joint's rotation at these angles (rad).
    pub fn rotation(&self, angles: &Vector3<f64>) -> UnitQuaternion<f64> {
        let turns = self.axes.iter().zip(angles.iter()).take(self.count);
        let rotation = turns.fold(self.zero, |below, (axis, angle)| {
            below * UnitQuaternion::from_scaled_axis(axis * *angle)
        });
        UnitQuaternion::new_normalize(rotation.into_inner())
    }

    /// The angles (rad), from -pi to pi, at which the joint has the rotation `q`. Where no angles give it, those of a rotation near it.
    pub fn angles(&self, q: &UnitQuaternion<f64>) -> Vector3<f64> {
        let r = self.zero.inverse() * q;
        let [a, b, c] = &self.axes;
        match self.count {
            1 => {
                let sign = if r.w < 0.0 { -1.0 } else { 1.0 };
                let angle = 2.0 * (sign * r.imag().dot(a)).atan2(sign * r.w);
                Vector3::new(angle, 0.0, 0.0)
            }
            2 => {
                let first = angle_between(a, b, &(r * b));
                let second = -angle_between(b, a, &(r.inverse() * a));
                Vector3::new(first, second, 0.0)
            }
            _ => {
                // a . exp(t b) c = a . R c: two solutions, one on each side of the gimbal lock.
                let along = a.dot(b) * b.dot(c);
                let (cos, sin) = (a.dot(c) - along, self.volume_at_zero());
                let share = (a.dot(&(r * c)) - along) / cos.hypot(sin);
                let apart = share.clamp(-1.0, 1.0).acos();
                let second = sin.atan2(cos) - sin.signum() * apart;
                let turn = UnitQuaternion::from_scaled_axis(b * second);
                let first = angle_between(a, &(turn * c), &(r * c));
                let third = -angle_between(c, &(turn.inverse() * a), &(r.inverse() * a));
                Vector3::new(first, second, third)
            }
        }
    }

    /// The axes as they stand at the rotation `q`, in the disc's frame.
    pub(crate) fn axes_at(&self, q: &UnitQuaternion<f64>) -> HingeAxes {
        let [a, b, c] = self.axes;
        let first = || (self.zero.inverse() * q).inverse() * a;
        let axes = match self.count {
            1 => [a, Vector3::zeros(), Vector3::zeros()],
            2 => [first(), b, Vector3::zeros()],
            _ => {
                let third = self.angles(q).z;
                let second = UnitQuaternion::from_scaled_axis(c * -third) * b;
                [first(), second, c]
            }
        };
        HingeAxes::new(self.count, axes)
    }

    /// The rotation to which steps `by` of the angles (rad) lead from `q`.
    pub(crate) fn moved(&self, q: &UnitQuaternion<f64>, by: &Vector3<f64>) -> UnitQuaternion<f64> {
        self.rotation(&(self.angles(q) + by))
    }

    /// Steps of the angles (rad) that lead from one rotation to another, the shorter way about each hinge.
    pub(crate) fn between(
        &self,
        from: &UnitQuaternion<f64>,
        to: &UnitQuaternion<f64>,
    ) -> Vector3<f64> {
        let apart = self.angles(to) - self.angles(from);
        apart.map(|angle| angle - 2.0 * PI * (angle / (2.0 * PI)).round())
    }

    /// Whether a rotation has these angles: none beyond a half turn, nor beyond the gimbal lock of three hinges.
    pub(crate) fn reaches(&self, angles: &Vector3<f64>) -> bool {
        let within = angles.iter().all(|angle| angle.abs() <= PI);
        if self.count < 3 {
            return within;
        }
        let [a, b, c] = self.axes;
        let volume = a.dot(&b.cross(&(UnitQuaternion::from_scaled_axis(b * angles.y) * c)));
        within && volume / self.volume_at_zero() > LOCKED
    }

    /// Volume that three axes span at the angles 0.
    fn volume_at_zero(&self) -> f64 {
        let [a, b, c] = &self.axes;
        a.dot(&b.cross(c))
    }
}

/// The angle about `axis` that takes `from` to `to`.
fn angle_between(axis: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    let sin = axis.dot(&from.cross(to));
    let cos = from.dot(to) - axis.dot(from) * axis.dot(to);
    sin.atan2(cos)
}

fn is_none(rotation: &[f64; 3]) -> bool {
    *rotation == [0.0; 3]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    fn joints() -> Vec<Hinges> {
        let rows: [&[[f64; 3]]; 6] = [
            &[[0.3, -1.0, 0.2]],
            &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            &[[0.0, -1.0, 0.0], [2.0, 0.6, 0.1]],
            &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            &[[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]],
            &[[1.0, 0.2, 0.0], [0.1, 1.0, 0.4], [0.3, 0.0, 1.0]],
        ];
        rows.map(|axes| {
            let joint = HingeJoint {
                hinges: axes.iter().map(|axis| Hinge::new(*axis, 0.1)).collect(),
                zero: [0.2, -0.1, 0.3],
            };
            Hinges::of_joint(&joint, 0.0, 0.0)
        })
        .to_vec()
    }

    fn some_angles(joint: &Hinges, seed: usize) -> Vector3<f64> {
        let angle = |i: usize| match i < joint.count {
            true => 0.9 * ((7 * seed + 3 * i + 1) as f64).sin(),
            false => 0.0,
        };
        Vector3::new(angle(0), angle(1), angle(2))
    }

    #[test]
    fn a_rotation_has_the_angles_that_it_was_made_of() {
        for joint in joints() {
            for seed in 0..40 {
                let angles = some_angles(&joint, seed);
                let found = joint.angles(&joint.rotation(&angles));
                assert!(
                    (found - angles).norm() < 1e-13,
                    "{joint:?}: {angles} {found}"
                );
            }
        }
    }

    #[test]
    fn the_axes_are_the_derivatives_of_the_rotation() {
        let h = 1e-6;
        for joint in joints() {
            let angles = some_angles(&joint, 5);
            let q = joint.rotation(&angles);
            let axes = joint.axes_at(&q);
            for hinge in 0..joint.count {
                let step = Vector3::ith(hinge, h);
                let [low, high] = [-step, step].map(|step| joint.moved(&q, &step));
                let turn = (low.inverse() * high).scaled_axis() / (2.0 * h);
                assert!((turn - axes.axes.column(hinge)).norm() < 1e-9);
                let back = axes.dual.tr_mul(&turn);
                assert!((back - Vector3::ith(hinge, 1.0)).norm() < 1e-9);
            }
        }
    }

    #[test]
    fn steps_compose_to_second_order_as_the_curving_says() {
        let h = 1e-4;
        for joint in joints() {
            let q = joint.rotation(&some_angles(&joint, 2));
            let axes = joint.axes_at(&q);
            let moment = Vector3::new(0.3, -0.7, 0.4);
            let along = |step: &Vector3<f64>| {
                moment.dot(&(q.inverse() * joint.moved(&q, step)).scaled_axis())
            };
            for i in 0..joint.count {
                for j in 0..i {
                    let (a, b) = (Vector3::ith(i, h), Vector3::ith(j, h));
                    let second =
                        along(&(a + b)) - along(&(a - b)) - along(&(b - a)) + along(&(-a - b));
                    let expected = 2.0
                        * axes
                            .axes
                            .column(i)
                            .dot(&(axes.curving(&moment) * axes.axes.column(j)));
                    let found = second / (2.0 * h * h);
                    assert!((found - expected).abs() < 1e-6, "{found} {expected}");
                }
            }
        }
    }

    #[test]
    fn gimbal_lock_and_more_than_a_half_turn_are_out_of_reach() {
        let joint = &joints()[3];
        assert!(joint.reaches(&Vector3::new(3.0, 1.5, -3.0)));
        assert!(!joint.reaches(&Vector3::new(0.0, FRAC_PI_2, 0.0)));
        assert!(!joint.reaches(&Vector3::new(0.0, 1.6, 0.0)));
        assert!(!joint.reaches(&Vector3::new(3.2, 0.0, 0.0)));
    }
}
