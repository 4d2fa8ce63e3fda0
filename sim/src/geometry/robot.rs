//! The solids that a robot consists of.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::primitives::{Capsule, Cuboid, Cylinder};
use super::shape::Kind;
use super::{Instance, Shape, Solid};
use crate::robot::Robot;

/// Colour of the base: light yellow.
pub(crate) const BASE_COLOR: [u8; 3] = [230, 226, 185];
const ROD_COLOR: [u8; 3] = [96, 101, 110];

/// The discs at these poses.
pub(crate) fn disc_solids(
    robot: &Robot,
    pose_of: impl Fn(usize) -> Isometry3<f64>,
) -> impl Iterator<Item = Solid> {
    let count = robot.discs().len();
    (robot.discs().iter().enumerate()).map(move |(index, disc)| Solid {
        shape: Shape(Kind::Cylinder(Cylinder {
            radius: disc.radius,
            half_height: disc.half_height,
        })),
        pose: pose_of(index),
        color: disc_color(index, count),
        instance: Instance::Disc(index as u16),
    })
}

/// Pose of the base in the world (m).
pub(crate) fn base_pose(robot: &Robot) -> Isometry3<f64> {
    Isometry3::from_parts(robot.base().into(), robot.base_orientation())
}

/// A capsule of a radius (m) between two places in the world (m), and its pose.
pub(crate) fn between([from, to]: [Point3<f64>; 2], radius: f64) -> (Shape, Isometry3<f64>) {
    let along = to - from;
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &along)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
    let shape = Shape(Kind::Capsule(Capsule {
        radius,
        half_length: along.norm() / 2.0,
    }));
    let middle = nalgebra::center(&from, &to);
    (shape, Isometry3::from_parts(middle.into(), turn))
}

/// The rods through the discs at these poses.
pub(crate) fn rod_solids(robot: &Robot, pose_of: impl Fn(usize) -> Isometry3<f64>) -> Vec<Solid> {
    let spec = robot.spec();
    let radius = |disc: usize| Some(spec.modules[spec.module_of(disc)?].rod?.radius);
    let solid = |(_, shape, pose)| Solid {
        shape,
        pose,
        color: ROD_COLOR,
        instance: Instance::Rod,
    };
    (rod_pieces(robot, radius, pose_of).into_iter())
        .map(solid)
        .collect()
}

/// Rods of a radius (m) at each disc's joint, at these poses: the body that carries each piece, from 0 the discs, none for the
/// base; its shape, and its pose in the world. A disc's joint stands for its module's rod from the origin of the body below to
/// that of the disc: each body carries the part on its side of the joint.
pub(crate) fn rod_pieces(
    robot: &Robot,
    radius_of: impl Fn(usize) -> Option<f64>,
    pose_of: impl Fn(usize) -> Isometry3<f64>,
) -> Vec<(Option<usize>, Shape, Isometry3<f64>)> {
    let mut below = (None, base_pose(robot));
    let mut pieces = Vec::new();
    for (index, disc) in robot.discs().iter().enumerate() {
        let own = (Some(index), pose_of(index));
        if let Some(radius) = radius_of(index) {
            let joint = own.1 * Point3::from(-disc.origin);
            for (body, ends) in [
                (below.0, [below.1 * Point3::origin(), joint]),
                (own.0, [joint, own.1 * Point3::origin()]),
            ] {
                // A joint at the origin of its disc leaves no rod above it.
                if ends[0] != ends[1] {
                    let (shape, pose) = between(ends, radius);
                    pieces.push((body, shape, pose));
                }
            }
        }
        below = own;
    }
    pieces
}

/// Colour of disc `index` of `count`: a ramp of hues from red at the base to violet at the tip.
pub fn disc_color(index: usize, count: usize) -> [u8; 3] {
    let hue = 300.0 * index as f64 / count.max(2).saturating_sub(1) as f64;
    // HSV to RGB (e.g. Foley et al., Computer Graphics, 13.3.4), one formula for the three channels.
    let (saturation, value) = (0.8, 0.95);
    [5.0, 3.0, 1.0].map(|shift| {
        let k: f64 = (shift + hue / 60.0) % 6.0;
        let channel = value * (1.0 - saturation * k.min(4.0 - k).clamp(0.0, 1.0));
        (255.0 * channel).round() as u8
    })
}

/// A base in the paper's manner, from the floor to the robot: per module a layer with a plate and
/// three servo boxes at 120 degrees, around a guide column.
pub(crate) fn base_solids(robot: &Robot) -> Vec<Solid> {
    const COLUMN_RADIUS: f64 = 0.012;
    const PLATE: (f64, f64) = (0.055, 0.002);
    const SERVO_HALF_SIZE: [f64; 3] = [0.017, 0.010, 0.013];
    const SERVO_RADIUS: f64 = 0.034;
    let top = robot.base().z;
    // Built on the floor under an upright base; another base carries it along.
    let foot = robot.base() - robot.base_orientation() * Vector3::new(0.0, 0.0, top);
    let height = top + robot.spec().base.hole_height;
    if height <= 0.0 {
        return Vec::new();
    }
    let layers = robot.spec().modules.len();
    let layer_height = height / layers as f64;
    let solid = |shape, z: f64, offset: f64, angle: f64| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        let place = turn * Vector3::new(offset, 0.0, 0.0) + Vector3::new(0.0, 0.0, z);
        let rotation = robot.base_orientation() * turn;
        let position = foot + robot.base_orientation() * place;
        Solid {
            shape,
            pose: Isometry3::from_parts(Translation3::from(position), rotation),
            color: BASE_COLOR,
            instance: Instance::Base,
        }
    };
    let cylinder = |radius, half_height| {
        Shape(Kind::Cylinder(Cylinder {
            radius,
            half_height,
        }))
    };
    let mut solids = vec![solid(
        cylinder(COLUMN_RADIUS, height / 2.0),
        height / 2.0,
        0.0,
        0.0,
    )];
    for layer in 0..layers {
        let floor = layer as f64 * layer_height;
        solids.push(solid(cylinder(PLATE.0, PLATE.1), floor + PLATE.1, 0.0, 0.0));
        let servo_half_height = SERVO_HALF_SIZE[2].min(0.4 * layer_height);
        let servo = Cuboid {
            half: Vector3::new(SERVO_HALF_SIZE[0], SERVO_HALF_SIZE[1], servo_half_height),
        };
        for arm in 0..3 {
            let angle = std::f64::consts::TAU * f64::from(arm) / 3.0;
            let z = floor + 2.0 * PLATE.1 + servo_half_height;
            solids.push(solid(Shape(Kind::Cuboid(servo)), z, SERVO_RADIUS, angle));
        }
    }
    solids
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_color_ramp_runs_from_red_to_violet() {
        assert_eq!(disc_color(0, 10), [242, 48, 48]);
        assert_eq!(disc_color(9, 10), [242, 48, 242]);
        assert_eq!(disc_color(0, 1), [242, 48, 48]);
    }
}
