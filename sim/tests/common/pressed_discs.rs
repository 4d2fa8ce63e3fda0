//! A robot whose last disc is pressed on its first.

use std::path::Path;

use nalgebra::{UnitQuaternion, Vector3};
use tdcr_sim::chain::Configuration;
use tdcr_sim::geometry::{Bead, Beads};
use tdcr_sim::robot::{Frame, Loads, Robot, RobotSpec, Wrench};
use tdcr_sim::scene::{Scene, SelfContact};

/// Stiffness of the last joint, a fraction of that of the others (N m/rad).
pub const STIFFNESS: f64 = 0.5;
/// Turn of the last joint where the beads just touch (rad).
pub const TURN: f64 = 0.3;
/// Of the beads on the first disc, a blunt one, and on the last, which is so far from that disc's origin (m).
const BLUNT: f64 = 0.05;
const RADIUS: f64 = 0.002;
const ARM: f64 = 0.1;

/// Three discs without weight on springy ball joints, of which the last bends most.
pub fn robot() -> Robot {
    let joint = |stiffness: f64| {
        format!("{{ bending = [{stiffness}, {stiffness}], torsion = {stiffness} }}")
    };
    let [held, free] = [100.0 * STIFFNESS, STIFFNESS].map(joint);
    let text = format!(
        "name = 'pressed discs'
         gravity = [0.0, 0.0, 0.0]
         routing = 'base'
         base = {{ position = [0.0, 0.0, 0.0], holes = [], hole_height = 0.0 }}
         [[modules]]
         discs = 3
         first_offset = 0.01
         pitch = 0.01
         radius = 0.01
         half_height = 0.002
         holes = []
         mass = {{ density = 1000.0 }}
         damping = 0.05
         armature = 1e-4
         backbone = [{held}, {held}, {free}]"
    );
    Robot::new(RobotSpec::from_toml(&text, Path::new("robot.toml")).unwrap()).unwrap()
}

/// One bead on its first disc and one on its last.
pub fn beads(robot: &Robot) -> Beads {
    let mut bent = Configuration::straight(robot);
    bent.0[2] = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), TURN);
    let (positions, orientations) = bent.place(robot);
    let far =
        tip(positions[2], orientations[2]) - orientations[2] * Vector3::y() * (BLUNT + RADIUS);
    let bead = |disc: usize, centre: Vector3<f64>, radius: f64| Bead {
        disc,
        centre,
        radius,
        along_rod: 0.0,
    };
    let own = bead(2, Vector3::z() * ARM, RADIUS);
    Beads::of(robot, [bead(0, far - positions[0], BLUNT), own])
}

/// Where the bead on the last disc is (m), given where that disc is and how it is turned.
pub fn tip(position: Vector3<f64>, orientation: UnitQuaternion<f64>) -> Vector3<f64> {
    position + orientation * Vector3::z() * ARM
}

/// Nothing but the robot itself.
pub fn alone(compliance: f64, friction: f64) -> Scene {
    let own = SelfContact::Touching {
        compliance,
        friction,
    };
    let scene = Scene::new(Vec::new()).unwrap();
    scene.with_self_contact(own).unwrap()
}

/// A force on the last disc where it touches the first: 1 N across what the last joint's spring takes there, and `aside` (N) along x.
pub fn push(aside: f64) -> Loads {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), TURN);
    let pressed = 1.0 + STIFFNESS * TURN / (ARM + 0.005);
    let wrench = Wrench {
        point: [0.0, -RADIUS, ARM],
        force: (turn * Vector3::new(aside, -pressed, 0.0)).into(),
        ..Wrench::none(2, Frame::World)
    };
    Loads::default().with_wrench(wrench).unwrap()
}
