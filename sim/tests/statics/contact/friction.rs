//! Friction of contacts along paths.

use std::path::Path;

use nalgebra::{UnitQuaternion, Vector3};
use tdcr_sim::contact::{Contact, ContactSettler, Sliding};
use tdcr_sim::geometry::{Bead, Beads};
use tdcr_sim::robot::{Frame, Loads, Robot, RobotSpec, Wrench};
use tdcr_sim::scene::{Obstacle, Scene};
use tdcr_sim::sensitivity::SensitivityError;

const FRICTION: f64 = 0.5;
const LENGTH: f64 = 0.2;
const STIFFNESS: f64 = 0.05;

/// One disc on a springy ball joint, which stands upright 0.2 m below it.
fn lever() -> Robot {
    let text = format!(
        "name = 'lever'
         gravity = [0.0, 0.0, 0.0]
         routing = 'base'
         base = {{ position = [0.0, 0.0, 0.0], holes = [], hole_height = 0.0 }}
         [[modules]]
         discs = 1
         first_offset = {LENGTH}
         pitch = {LENGTH}
         joint_below = {LENGTH}
         radius = 0.01
         half_height = 0.002
         holes = []
         mass = {{ density = 100.0 }}
         damping = 0.0
         armature = 0.0
         backbone = {{ bending = [{STIFFNESS}, {STIFFNESS}], torsion = {STIFFNESS} }}"
    );
    Robot::new(RobotSpec::from_toml(&text, Path::new("robot.toml")).unwrap()).unwrap()
}

/// A wall of friction that touches a bead of 10 mm about the lever's end from +x.
fn wall(friction: f64) -> Scene {
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &-Vector3::x()).unwrap();
    let wall = Obstacle::half_space("wall").at([0.01, 0.0, 0.0]);
    let wall = wall
        .with_orientation([turn.w, turn.i, turn.j, turn.k])
        .unwrap();
    Scene::new(vec![wall.with_friction(friction).unwrap()]).unwrap()
}

fn settler(robot: &Robot, scene: &Scene) -> ContactSettler {
    let bead = Bead {
        disc: 0,
        centre: Vector3::zeros(),
        radius: 0.01,
        along_rod: 0.0,
    };
    ContactSettler::with_beads(robot, scene, Beads::of(robot, [bead]))
}

/// A force of 1 N towards the wall, at an angle (rad) from its normal.
fn push(angle: f64) -> Loads {
    let wrench = Wrench {
        force: [angle.cos(), angle.sin(), 0.0],
        ..Wrench::none(0, Frame::World)
    };
    Loads::default().with_wrench(wrench).unwrap()
}

/// Forces of a contact along its normal and across it (N).
fn parts(contact: &Contact) -> (f64, Vector3<f64>) {
    let along = contact.force.dot(&contact.normal);
    (along, contact.force - contact.normal * along)
}

#[test]
fn a_force_slips_where_its_angle_is_above_that_of_friction() {
    let (robot, scene) = (lever(), wall(FRICTION));
    let mut settler = settler(&robot, &scene);
    let command = robot.command(&[]).unwrap();
    settler.settle(&command, &push(0.0)).unwrap();
    assert_eq!(settler.found().contacts[0].sliding, Sliding::Free);
    for step in 1..80 {
        let angle = (f64::from(step) * 0.5).to_radians();
        let found = settler.follow(&command, &push(angle)).unwrap();
        assert!(found.equilibrium.converged && found.equilibrium.residual <= 1e-9);
        let (normal, across) = parts(&found.contacts[0]);
        match angle.tan() > FRICTION {
            true => {
                assert_eq!(found.contacts[0].sliding, Sliding::Slips, "{step}");
                assert!((across.norm() - FRICTION * normal).abs() < 1e-9);
                assert!(across.y < 0.0);
                // The spring bears what friction does not.
                let at = &found.equilibrium;
                let pushed = Vector3::new(angle.cos(), angle.sin(), 0.0) + found.contacts[0].force;
                let moment = at.positions[0].cross(&pushed);
                let spring = at.orientations[0].scaled_axis() * STIFFNESS;
                assert!((moment - spring).norm() < 1e-8, "{moment} {spring}");
            }
            false => {
                assert_eq!(found.contacts[0].sliding, Sliding::Sticks, "{step}");
                // It moves as far as the surface gives way.
                assert!(found.equilibrium.positions[0].y < 1.1e-6);
                assert!((across.y + angle.sin()).abs() < 1e-5);
            }
        }
    }
    // Pushed straight again, it stays where it slipped to: friction now bears the spring.
    let slid = settler.found().equilibrium.positions[0].y;
    let found = settler.follow(&command, &push(0.0)).unwrap();
    let (_, across) = parts(&found.contacts[0]);
    assert_eq!(found.contacts[0].sliding, Sliding::Sticks);
    assert!((found.equilibrium.positions[0].y - slid).abs() < 2e-6 && across.y > 0.0);
}

#[test]
fn what_slips_has_no_derivatives_and_what_sticks_has() {
    let (robot, scene) = (lever(), wall(FRICTION));
    let mut settler = settler(&robot, &scene);
    let command = robot.command(&[]).unwrap();
    settler.settle(&command, &push(0.0)).unwrap();
    settler.follow(&command, &push(0.2)).unwrap();
    let moved = settler.sensitivity(&command, &push(0.2)).unwrap();
    // An obstacle carries along what sticks to it.
    let along = tdcr_sim::pose::PoseTangent {
        position: Vector3::y(),
        rotation: Vector3::zeros(),
    };
    let carried = moved.by_obstacle(0, &along)[0].position.y;
    assert!((carried - 1.0).abs() < 1e-4, "{carried}");
    settler.follow(&command, &push(0.6)).unwrap();
    let error = settler.sensitivity(&command, &push(0.6)).unwrap_err();
    assert!(matches!(
        error,
        SensitivityError::Slipping {
            disc: 0,
            obstacle: 0
        }
    ));
}

#[test]
fn without_friction_a_path_is_as_before() {
    let robot = lever();
    let command = robot.command(&[]).unwrap();
    let (scene, with) = (wall(0.0), wall(FRICTION));
    let mut free = settler(&robot, &scene);
    free.settle(&command, &push(0.0)).unwrap();
    let followed = free.follow(&command, &push(0.3)).unwrap().clone();
    assert_eq!(followed.contacts[0].sliding, Sliding::Free);
    // Where no path is known there is no friction.
    let mut rubbed = settler(&robot, &with);
    let settled = rubbed.settle(&command, &push(0.3)).unwrap();
    let apart = settled.equilibrium.positions[0] - followed.equilibrium.positions[0];
    assert!(apart.norm() < 1e-9);
}
