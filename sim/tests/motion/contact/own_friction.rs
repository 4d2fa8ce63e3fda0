//! Friction between discs of one robot.

use std::path::Path;

use nalgebra::{UnitQuaternion, Vector3};
use tdcr_sim::contact::{Contact, ContactSettler, ContactStepper};
use tdcr_sim::dynamics::{DynamicsError, Integrator, Rollout, State, Stepper};
use tdcr_sim::geometry::{Bead, Beads};
use tdcr_sim::robot::{Frame, Loads, PerDisc, Robot, RobotSpec, Wrench};
use tdcr_sim::scene::{Scene, SelfContact};

use super::itself::curling;
use super::rest::{impulses, momentum_gained};
use super::{among, orientations};

#[path = "../../common/pressed_discs.rs"]
mod pressed_discs;

/// Three discs on ball joints, without weight, of which only the last moves; their tendons are slack.
const THREE_DISCS: &str = r#"
name = "three discs"
gravity = [0.0, 0.0, 0.0]
routing = "base"
[base]
position = [0.0, 0.0, 0.0]
holes = [[0.01, 0.0], [-0.005, 0.00866], [-0.005, -0.00866]]
hole_height = 0.0
[[modules]]
discs = 3
first_offset = 0.01
pitch = 0.01
radius = 0.01
half_height = 0.002
mass = { density = 1000.0 }
holes = [[0.01, 0.0], [-0.005, 0.00866], [-0.005, -0.00866]]
damping = 0.0
armature = [1e6, 1e6, 1e-4]
tendons = { drive = { gain = 1.0 }, range = [0.0, 1.0], pull = "tension_only" }
"#;
/// Of the beads, and of that of the last disc from its origin (m).
const RADIUS: f64 = 0.002;
const ARM: f64 = 0.1;
const COMPLIANCE: f64 = 1e-5;
const PRESSED: f64 = 1e-5;
const FRICTION: f64 = 0.3;

fn rough(compliance: f64, friction: f64) -> Scene {
    let own = SelfContact::Touching {
        compliance,
        friction,
    };
    let scene = Scene::new(Vec::new()).unwrap();
    scene.with_self_contact(own).unwrap()
}

/// The last disc pressed against a bead of the first with `PRESSED / COMPLIANCE` = 1 N, and pushed across with `force` (N) where it
/// touches. The stepper, how far its bead went (m).
fn push(force: f64, seconds: f64, integrator: Integrator) -> (ContactStepper, f64) {
    let robot =
        Robot::new(RobotSpec::from_toml(THREE_DISCS, Path::new("robot.toml")).unwrap()).unwrap();
    // Bent so far that the two are apart in the straight robot.
    let bent = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 2.5);
    let mut state = State::straight(&robot);
    state.configuration.0[2] = bent;
    let tip = |state: &State| {
        let turned = orientations(&robot, state)[2];
        state.positions(&robot)[2] + turned * Vector3::new(0.0, 0.0, ARM)
    };
    let start = tip(&state);
    let far = start + bent * Vector3::z() * (2.0 * RADIUS - PRESSED);
    let bead = |disc: usize, centre: Vector3<f64>| Bead {
        disc,
        centre,
        radius: RADIUS,
        along_rod: 0.0,
    };
    let own = bead(2, Vector3::new(0.0, 0.0, ARM));
    let beads = Beads::of(&robot, [bead(0, far - state.positions(&robot)[0]), own]);
    let wrench = Wrench {
        point: [0.0, 0.0, ARM + RADIUS - 0.5 * PRESSED],
        force: [force, 0.0, 0.0],
        ..Wrench::none(2, Frame::World)
    };
    let loads = Loads::default().with_wrench(wrench).unwrap();
    let slack = robot.command(&[1.0; 3]).unwrap();
    let stepper = Stepper::new(&robot, 1e-3, integrator).unwrap();
    let scene = rough(COMPLIANCE, FRICTION);
    let mut stepper = ContactStepper::with_beads(stepper, &scene, beads).unwrap();
    for _ in 0..(seconds / 1e-3) as usize {
        stepper.step(&mut state, &slack, &loads).unwrap();
    }
    let way = (tip(&state) - start).x;
    (stepper, way)
}

/// Forces between the discs along the normal and along the push (N).
fn forces(stepper: &ContactStepper) -> [f64; 2] {
    let [contact] = stepper.contacts() else {
        panic!("{:?}", stepper.contacts());
    };
    assert_eq!((contact.disc, contact.partner.disc()), (0, Some(2)));
    [contact.force.dot(&contact.normal), contact.force.x]
}

#[test]
fn a_disc_sticks_to_another_below_the_angle_of_friction_and_slips_above() {
    for integrator in [Integrator::SemiImplicitEuler, Integrator::ImplicitEuler] {
        for share in [0.5, 0.99] {
            let (stepper, way) = push(share * FRICTION, 0.5, integrator);
            let [normal, along] = forces(&stepper);
            assert!((normal - 1.0).abs() < 1e-4, "{normal} N");
            assert!((along - share * FRICTION).abs() < 1e-4, "{along} N");
            assert!(way.abs() < 1e-6, "{way} m in 0.5 s");
        }
        for share in [1.01, 2.0] {
            let (stepper, _) = push(share * FRICTION, 1e-3, integrator);
            let [normal, along] = forces(&stepper);
            assert!(
                (along - FRICTION * normal).abs() < 1e-9,
                "{along} N of {normal} N"
            );
            let (_, way) = push(share * FRICTION, 0.05, integrator);
            assert!(way > 1e-5, "{way} m in 50 ms");
        }
    }
}

/// Forces of contacts on discs and on those that they touch are equal and opposite, at one point: the change of the momentum by the
/// joints is that of both.
#[test]
fn forces_between_discs_are_the_change_of_momentum_and_within_the_cone() {
    const DAMPING: f64 = 2e-2;
    let mut spec = RobotSpec::standard("5m").unwrap();
    for module in &mut spec.modules {
        module.damping = PerDisc::Uniform(DAMPING);
    }
    let robot = Robot::new(spec).unwrap();
    let command = curling(&robot, 0);
    let (h, loads, friction) = (1e-3, Loads::default(), 0.4);
    let integrator = Integrator::SemiImplicitEuler;
    let mut stepper = among(&robot, &rough(1e-6, friction), h, integrator);
    let mut smooth = among(&robot, &rough(1e-6, 0.0), h, integrator);
    let mut free = Stepper::new(&robot, h, integrator).unwrap();
    let (mut state, mut other) = (State::straight(&robot), State::straight(&robot));
    let (mut compared, mut rubbed, mut beyond) = (0, 0, 0.0_f64);
    for _ in 0..1500 {
        let (before, mut without) = (state.clone(), state.clone());
        stepper.step(&mut state, &command, &loads).unwrap();
        smooth.step(&mut other, &command, &loads).unwrap();
        let across = |contact: &Contact| {
            let normal = contact.force.dot(&contact.normal);
            [normal, (contact.force - contact.normal * normal).norm()]
        };
        let forces: Vec<_> = stepper.contacts().iter().map(across).collect();
        let largest = forces
            .iter()
            .fold(0.0_f64, |most, force| most.max(force[0]));
        for [normal, across] in forces {
            beyond = beyond.max((across - friction * normal) / largest);
            rubbed += usize::from(across > 0.1 * friction * normal);
        }
        if stepper.contacts().is_empty() || compared == 40 {
            continue;
        }
        compared += 1;
        free.step(&mut without, &command, &loads).unwrap();
        let gained = momentum_gained(&robot, &before, [&state, &without], h * DAMPING);
        let impulse = impulses(&stepper, &before);
        let error = (&gained - &impulse).amax();
        assert!(
            error <= 1e-8 * impulse.amax() + 1e-13,
            "{error:e} of {:e}",
            impulse.amax()
        );
    }
    let apart = (state.positions(&robot).iter())
        .zip(other.positions(&robot))
        .map(|(here, there)| (here - there).norm())
        .fold(0.0, f64::max);
    eprintln!(
        "{compared} steps, {rubbed} contacts that rub, {beyond:e} beyond the cone, {} not to full precision, {apart} m",
        stepper.unsolved()
    );
    assert!(compared == 40 && rubbed > 100 && apart > 1e-4);
    assert!(beyond < 2e-6 && stepper.unsolved() == 0);
}

/// A path is the slow limit of motion: pushed aside until it slips, and let go again, the last disc comes to where a path leads it.
#[test]
fn a_slow_motion_goes_where_the_path_does() {
    let (robot, scene) = (pressed_discs::robot(), pressed_discs::alone(1e-6, FRICTION));
    let beads = pressed_discs::beads(&robot);
    let command = robot.command(&[]).unwrap();
    let mut path = ContactSettler::with_beads(&robot, &scene, beads.clone());
    path.settle(&command, &push_aside(0.0)).unwrap();
    let mut state = State::straight(&robot);
    (state.configuration).clone_from(&path.found().equilibrium.configuration);
    let stepper = Stepper::new(&robot, 1e-3, Integrator::ImplicitEuler).unwrap();
    let mut stepper = ContactStepper::with_beads(stepper, &scene, beads).unwrap();
    let tip = |state: &State| {
        let orientation = orientations(&robot, state)[2];
        pressed_discs::tip(state.positions(&robot)[2], orientation)
    };
    let start = tip(&state);
    for (from, to) in [(0.0, 1.5), (1.5, 0.3)] {
        for step in 1..=50 {
            let share = from + (to - from) * f64::from(step) / 50.0;
            path.follow(&command, &push_aside(share)).unwrap();
            assert!(path.found().equilibrium.converged, "{share}");
        }
        for step in 1..=4000 {
            let share = from + (to - from) * f64::min(f64::from(step) / 3000.0, 1.0);
            let loads = push_aside(share);
            stepper.step(&mut state, &command, &loads).unwrap();
        }
        let at = &path.found().equilibrium;
        let led = pressed_discs::tip(at.positions[2], at.orientations[2]);
        let moved = tip(&state);
        let (slid, apart) = ((led - start).norm(), (led - moved).norm());
        eprintln!("slid {slid} m, {apart:e} m apart");
        // What sticks in motion creeps by up to 1 um/s.
        assert!(slid > 5e-3 && apart < 1e-5, "{slid} {apart}");
    }
}

/// A share of the force at which it slips.
fn push_aside(share: f64) -> Loads {
    pressed_discs::push(share * FRICTION)
}

#[test]
fn derivatives_of_motions_refuse_it_by_name() {
    let robot = Robot::load("2m").unwrap();
    let (scene, loads) = (rough(1e-6, 0.3), Loads::default());
    let command = robot.mean_command();
    let mut stepper = among(&robot, &scene, 2e-3, Integrator::SemiImplicitEuler);
    let rollout = Rollout {
        start: State::straight(&robot),
        commands: vec![command],
        loads,
        wrenches: Vec::new(),
    };
    let states = stepper.rollout(&rollout).unwrap();
    let gradient = stepper.rollout_gradient(&rollout, &states, &[], |_, _, _| {});
    for error in [gradient.unwrap_err(), stepper.lineariser().unwrap_err()] {
        assert!(
            matches!(error, DynamicsError::Underivable { .. }),
            "{error}"
        );
        assert!(error.to_string().contains("friction between discs"));
    }
}
