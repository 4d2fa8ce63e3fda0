//! Friction of obstacles: a joint whose tip is pressed against a ceiling, and pushed along it.

use std::path::Path;

use nalgebra::Vector3;
use tdcr_sim::contact::ContactStepper;
use tdcr_sim::dynamics::{DynamicsError, Integrator, State, Stepper};
use tdcr_sim::geometry::{Bead, Beads};
use tdcr_sim::robot::{Frame, Loads, Robot, RobotSpec, Wrench};
use tdcr_sim::scene::{Obstacle, Scene};

use super::beads;

/// One disc on a ball joint, without weight; its tendons are slack.
const ONE_DISC: &str = r#"
name = "one disc"
gravity = [0.0, 0.0, 0.0]
routing = "base"
[base]
position = [0.0, 0.0, 0.0]
holes = [[0.01, 0.0], [-0.005, 0.00866], [-0.005, -0.00866]]
hole_height = 0.0
[[modules]]
discs = 1
first_offset = 0.1
pitch = 0.1
radius = 0.01
half_height = 0.002
mass = { density = 1000.0 }
holes = [[0.01, 0.0], [-0.005, 0.00866], [-0.005, -0.00866]]
damping = 0.0
armature = 1e-4
tendons = { drive = { gain = 1.0 }, range = [0.0, 1.0] }
"#;
const RADIUS: f64 = 0.002;
/// Of the bead from the disc's origin (m).
const ARM: f64 = 0.1;
const COMPLIANCE: f64 = 1e-5;
const PRESSED: f64 = 1e-5;
const FRICTION: f64 = 0.3;

/// The robot pressed against a ceiling with `PRESSED / COMPLIANCE` = 1 N, and pushed along it with `force` (N) where it touches.
fn push(force: f64, seconds: f64, integrator: Integrator) -> (ContactStepper, State) {
    let spec = RobotSpec::from_toml(ONE_DISC, Path::new("robot.toml")).unwrap();
    let robot = Robot::new(spec).unwrap();
    let top = State::straight(&robot).positions(&robot)[0].z;
    let bead = Bead {
        disc: 0,
        centre: Vector3::new(0.0, 0.0, ARM),
        radius: RADIUS,
        along_rod: 0.0,
    };
    let ceiling = Obstacle::half_space("ceiling")
        .at([0.0, 0.0, top + ARM + RADIUS - PRESSED])
        .with_orientation([0.0, 1.0, 0.0, 0.0])
        .and_then(|ceiling| ceiling.with_compliance(COMPLIANCE))
        .and_then(|ceiling| ceiling.with_friction(FRICTION))
        .unwrap();
    let scene = Scene::new(vec![ceiling]).unwrap();
    let wrench = Wrench {
        point: [0.0, 0.0, ARM + RADIUS - PRESSED],
        force: [force, 0.0, 0.0],
        ..Wrench::none(0, Frame::World)
    };
    let loads = Loads::default().with_wrench(wrench).unwrap();
    let slack = robot.command(&[1.0; 3]).unwrap();
    let stepper = Stepper::new(&robot, 1e-3, integrator).unwrap();
    let beads = Beads::of(&robot, [bead]);
    let mut stepper = ContactStepper::with_beads(stepper, &scene, beads).unwrap();
    let mut state = State::straight(&robot);
    for _ in 0..(seconds / 1e-3) as usize {
        stepper.step(&mut state, &slack, &loads).unwrap();
    }
    (stepper, state)
}

/// Forces along the normal and along the push (N).
fn forces(stepper: &ContactStepper) -> [f64; 2] {
    let [contact] = stepper.contacts() else {
        panic!("{:?}", stepper.contacts());
    };
    [contact.force.dot(&contact.normal), -contact.force.x]
}

#[test]
fn a_tip_sticks_below_the_angle_of_friction_and_slips_above() {
    for integrator in [Integrator::SemiImplicitEuler, Integrator::ImplicitEuler] {
        for share in [0.5, 0.9, 0.99] {
            // tan(theta) = share mu of the force on the ceiling.
            let (stepper, state) = push(share * FRICTION, 1.0, integrator);
            let [normal, along] = forces(&stepper);
            assert!((normal - 1.0).abs() < 1e-6, "{normal} N");
            assert!((along - share * FRICTION).abs() < 1e-4, "{along} N");
            let way = beads(&stepper, &state)[0].x;
            assert!(way.abs() < 1.1e-6, "{way} m in 1 s");
        }
        for share in [1.01, 1.1, 2.0] {
            let (stepper, _) = push(share * FRICTION, 1e-3, integrator);
            let [normal, along] = forces(&stepper);
            assert!(
                (along - FRICTION * normal).abs() < 1e-6,
                "{along} N of {normal} N"
            );
            let (stepper, state) = push(share * FRICTION, 0.05, integrator);
            let way = beads(&stepper, &state)[0].x;
            // Less 1 N of friction, the force accelerates the joint.
            assert!(way > 1e-5, "{way} m in 50 ms");
        }
    }
}

/// A robot that leans on a wall by its tendons, whose friction bears on what presses it there.
#[test]
fn friction_of_any_coefficient_is_within_its_cone_or_the_step_is_refused() {
    let robot = Robot::load("2m").unwrap();
    let wanted = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];
    let turned = std::f64::consts::FRAC_1_SQRT_2;
    for friction in [0.5, 5.0, 15.0, 20.0, 50.0, 200.0, 1e4] {
        let wall = Obstacle::half_space("wall")
            .at([-0.05, 0.0, 0.0])
            .with_orientation([turned, 0.0, turned, 0.0])
            .and_then(|wall| wall.with_friction(friction))
            .unwrap();
        let scene = Scene::new(vec![wall]).unwrap();
        let stepper = Stepper::new(&robot, 2e-3, Integrator::SemiImplicitEuler).unwrap();
        let mut stepper = ContactStepper::new(stepper, &scene).unwrap();
        let mut state = State::straight(&robot);
        let (mut touched, mut refused) = (0, false);
        for step in 0..400 {
            let share = f64::from(step) / 399.0;
            let command = wanted.map(|to| 0.02 + share * (to - 0.02));
            let command = robot.command(&command).unwrap();
            match stepper.step(&mut state, &command, &Loads::default()) {
                Ok(()) => {}
                Err(DynamicsError::FrictionNotFound { off, .. }) => {
                    assert!(off > 0.01 && friction > 1e3, "{friction}: {off}");
                    refused = true;
                    break;
                }
                Err(error) => panic!("{friction}: {error}"),
            }
            let obstacles = stepper.contacts().iter();
            for contact in obstacles.filter(|contact| contact.partner.obstacle().is_some()) {
                let normal = contact.force.dot(&contact.normal);
                let across = (contact.force - contact.normal * normal).norm();
                assert!(
                    across <= friction * normal * 1.011 + 1e-9,
                    "{friction}, step {step}: {across} N beside {normal} N"
                );
                touched += 1;
            }
        }
        eprintln!(
            "{friction}: {touched} contacts, {} steps not to full precision, {refused}",
            stepper.unsolved()
        );
        assert!(refused || touched > 10, "{friction}: {touched}");
    }
}
