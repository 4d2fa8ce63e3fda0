//! Floor and base that a robot stands on, as cameras see them: whether a pose goes through them.

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::robot::base_solids;
use super::{Bead, Beads, Solid};
use crate::chain::Configuration;
use crate::robot::Robot;

/// Overlap of beads with the floor or the base (m) up to which they touch: that of their shape and a disc's is larger.
const TOUCHING: f64 = 1e-4;

/// The floor that a robot's drawn base stands on, and that base. Nothing keeps a robot from them unless its scene has them.
#[derive(Clone, Debug)]
pub struct Stand {
    /// On the floor (m), and its normal.
    foot: Vector3<f64>,
    up: Vector3<f64>,
    base: Vec<Solid>,
    /// Largest height of the base above the floor (m).
    height: f64,
    /// Those that are not in the base where the robot is straight.
    beads: Vec<Bead>,
}

/// What a pose goes through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Overlaps {
    /// The floor.
    pub floor: bool,
    /// The base that cameras see.
    pub base: bool,
}

impl Stand {
    /// That of a robot: the floor is the plane `z = 0` of the world under an upright base, and another base carries it along.
    pub fn new(robot: &Robot) -> Self {
        let up = robot.base_orientation() * Vector3::z();
        let mut stand = Self {
            foot: robot.base() - up * robot.base().z,
            up,
            base: base_solids(robot),
            height: (robot.base().z + robot.spec().base.hole_height).max(0.0),
            beads: Vec::new(),
        };
        let (positions, orientations) = Configuration::straight(robot).place(robot);
        let beads = Beads::new(robot);
        let outside = |bead: &&Bead| !stand.is_in_base(bead, &positions, &orientations);
        stand.beads = beads.as_slice().iter().filter(outside).copied().collect();
        stand
    }

    /// What the robot goes through where its discs are at `positions` (m) and `orientations` in the world.
    pub fn overlaps(
        &self,
        positions: &[Vector3<f64>],
        orientations: &[UnitQuaternion<f64>],
    ) -> Overlaps {
        let mut found = Overlaps::default();
        for bead in &self.beads {
            let centre = positions[bead.disc] + orientations[bead.disc] * bead.centre;
            found.floor |= self.above(&centre) < bead.radius - TOUCHING;
            found.base |= self.is_in_base(bead, positions, orientations);
        }
        found
    }

    /// Height above the floor (m).
    fn above(&self, point: &Vector3<f64>) -> f64 {
        (point - self.foot).dot(&self.up)
    }

    fn is_in_base(
        &self,
        bead: &Bead,
        positions: &[Vector3<f64>],
        orientations: &[UnitQuaternion<f64>],
    ) -> bool {
        let centre = positions[bead.disc] + orientations[bead.disc] * bead.centre;
        if self.above(&centre) > self.height + bead.radius {
            return false;
        }
        self.base.iter().any(|solid| {
            let local = solid.pose.inverse_transform_point(&Point3::from(centre));
            solid.shape.nearest(&local.coords).distance < bead.radius - TOUCHING
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    /// What the paper's robot of five modules, longer than its base is high, goes through where it is turned rigidly
    /// about the y axis of its base.
    fn turned(angle: f64) -> Overlaps {
        let robot = Robot::load("5m").unwrap();
        let (positions, orientations) = Configuration::straight(&robot).place(&robot);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
        let base = robot.base();
        let positions: Vec<_> = positions.iter().map(|p| base + turn * (p - base)).collect();
        let orientations: Vec<_> = orientations.iter().map(|q| turn * q).collect();
        Stand::new(&robot).overlaps(&positions, &orientations)
    }

    #[test]
    fn a_straight_robot_goes_through_nothing_and_one_upside_down_through_base_and_floor() {
        assert_eq!(turned(0.0), Overlaps::default());
        let down = turned(std::f64::consts::PI);
        assert!(down.floor && down.base, "{down:?}");
        // Level above the servos.
        assert!(!turned(std::f64::consts::FRAC_PI_2).floor);
    }
}
