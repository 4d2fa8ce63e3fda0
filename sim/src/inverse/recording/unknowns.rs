//! The unknowns of a fit: what each does to the robot and the transmission.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::explicit::{Explicit, change_joints};
use super::{Group, Transmission};
use crate::robot::{Axis, Drive, Friction, Holes, RobotSpec};

/// An unknown, and what was known of it before: in its coordinate `x` it has a normal distribution of mean 0 and standard deviation
/// 1. Its value is `first + spread x`, or of sizes `first exp(spread x)`.
#[derive(Clone, Debug)]
pub(super) struct Unknown {
    pub name: String,
    pub unit: &'static str,
    pub group: Group,
    pub target: Target,
    pub scale: Scale,
    pub first: f64,
    pub spread: f64,
    /// Smallest value.
    pub least: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scale {
    Linear,
    Logarithmic,
}

/// What an unknown is a number of. Tendons, modules and markers by their numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    Gain(usize),
    /// A factor on top of the gains, whose unknowns come before it.
    CommonGain,
    Offset(usize),
    Backlash(usize),
    Lag,
    HoleAngle(usize),
    HoleRadius(usize),
    Rest(usize, Axis),
    Bending(usize),
    Torsion(usize),
    TendonStiffness(usize),
    TendonStiffening(usize),
    Friction(usize),
    BaseRotation(Axis),
    BasePosition(Axis),
    MarkerPosition(usize, Axis),
    GravityDirection(Axis),
    Mass(usize),
}

/// Coordinates are sought within so many standard deviations.
const WIDEST: f64 = 20.0;

impl Unknown {
    pub fn value(&self, x: f64) -> f64 {
        match self.scale {
            Scale::Linear => self.first + self.spread * x,
            Scale::Logarithmic => self.first * (self.spread * x).exp(),
        }
    }

    /// Smallest and largest coordinate.
    pub fn range(&self) -> [f64; 2] {
        match self.scale {
            Scale::Linear => [
                ((self.least - self.first) / self.spread).max(-WIDEST),
                WIDEST,
            ],
            Scale::Logarithmic => [-WIDEST, WIDEST],
        }
    }

    /// Whether it changes the robot, and not only what lies between it and the recording.
    pub fn is_of_robot(&self) -> bool {
        !matches!(
            self.target,
            Target::Gain(_)
                | Target::CommonGain
                | Target::Offset(_)
                | Target::Backlash(_)
                | Target::Lag
                | Target::MarkerPosition(..)
        )
    }

    /// Gives the robot, or the transmission, this unknown's value at `x`.
    pub fn set(
        &self,
        x: f64,
        explicit: &Explicit,
        spec: &mut RobotSpec,
        transmission: &mut Transmission,
    ) {
        let value = self.value(x);
        match self.target {
            Target::Gain(t) => transmission.servos[t].gain = value,
            Target::CommonGain => {
                for servo in &mut transmission.servos {
                    servo.gain *= value;
                }
            }
            Target::Offset(t) => transmission.servos[t].offset = value,
            Target::Backlash(t) => transmission.servos[t].backlash = value,
            Target::Lag => transmission.lag = value,
            Target::MarkerPosition(marker, axis) => {
                transmission.markers[marker].place[axis.index()] = value;
            }
            Target::HoleAngle(t) => {
                let (sin, cos) = value.sin_cos();
                move_holes(explicit, spec, |_, owner, [x, y]| match owner == t {
                    true => [cos * x - sin * y, sin * x + cos * y],
                    false => [x, y],
                });
            }
            Target::HoleRadius(module) => {
                move_holes(explicit, spec, |group, _, [x, y]| {
                    match group.saturating_sub(1) == module {
                        true => [value * x, value * y],
                        false => [x, y],
                    }
                })
            }
            Target::Rest(module, axis) => {
                let share = value / spec.modules[module].discs as f64;
                change_joints(spec, module, |joint| joint.rest[axis.index()] += share);
            }
            Target::Bending(module) => change_joints(spec, module, |joint| {
                joint.bending = joint.bending.map(|stiffness| value * stiffness);
            }),
            Target::Torsion(module) => change_joints(spec, module, |joint| joint.torsion *= value),
            Target::TendonStiffness(module) => {
                let ends = spec.routes.iter_mut().zip(&explicit.ends);
                for (route, _) in ends.filter(|(_, end)| **end == module) {
                    // Both springs of a series change alike, so that the series does.
                    if let Drive::Gain(gain) = &mut route.tendon.drive {
                        *gain *= value;
                    }
                    if let Some(axial) = &mut route.tendon.axial_stiffness {
                        *axial *= value;
                    }
                }
            }
            Target::TendonStiffening(module) => {
                let ends = spec.routes.iter_mut().zip(&explicit.ends);
                for (route, _) in ends.filter(|(_, end)| **end == module) {
                    if route.tendon.stretches() {
                        route.tendon.stiffening = value;
                    }
                }
            }
            Target::Friction(module) => {
                let ends = spec.routes.iter_mut().zip(&explicit.ends);
                for (route, _) in ends.filter(|(_, end)| **end == module) {
                    let friction = route.tendon.friction.get_or_insert(Friction::NONE);
                    friction.coefficient = value;
                }
            }
            Target::BaseRotation(axis) => {
                let [w, x, y, z] = spec.base.orientation;
                let turn = UnitQuaternion::from_scaled_axis(axis.unit() * value);
                let turned = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)) * turn;
                spec.base.orientation = [turned.w, turned.i, turned.j, turned.k];
            }
            Target::BasePosition(axis) => spec.base.position[axis.index()] = value,
            Target::Mass(module) => spec.modules[module].mass.scale(value),
            Target::GravityDirection(axis) => {
                let turn = UnitQuaternion::from_scaled_axis(axis.unit() * value);
                spec.gravity = (turn * Vector3::from(spec.gravity)).into();
            }
        }
    }
}

fn move_holes(
    explicit: &Explicit,
    spec: &mut RobotSpec,
    place: impl Fn(usize, usize, [f64; 2]) -> [f64; 2],
) {
    let bodies =
        std::iter::once(&mut spec.base.holes).chain(spec.modules.iter_mut().map(|m| &mut m.holes));
    for (group, (holes, owners)) in bodies.zip(&explicit.owners).enumerate() {
        if let Holes::At(holes) = holes {
            for (hole, &owner) in holes.iter_mut().zip(owners) {
                *hole = place(group, owner, *hole);
            }
        }
    }
}
