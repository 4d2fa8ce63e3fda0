//! Robots among obstacles whose inextensible tendons have commanded lengths.

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::contact::{ContactSettler, ContactStepper};
use tdcr_sim::dynamics::{DynamicsError, Integrator, State, Stepper};
use tdcr_sim::robot::{
    Backbone, Command, Drive, Frame, Loads, PerDisc, Pull, Robot, RobotSpec, Wrench,
};
use tdcr_sim::scene::{ContactLaw, Impedance, Obstacle, Scene, SelfContact};
use tdcr_sim::simulation::{MovingRobot, Simulation};

use super::rest::{impulses, momentum_gained};
use super::{among, scene};
use crate::random_robot::within;

const BOTH: [Integrator; 2] = [Integrator::SemiImplicitEuler, Integrator::ImplicitEuler];
const DAMPING: f64 = 0.02;
/// Commanded lengths that one tendon has and the others, which only pull, do not reach (m); and those of three.
const ONE: [f64; 6] = [0.075, 0.2, 0.2, 0.2, 0.2, 0.2];
const THREE: [f64; 6] = [0.078, 0.08, 0.2, 0.2, 0.2, 0.072];

/// 2m on an elastic backbone whose tendons are driven so.
fn driven(drive: Drive, range: [f64; 2], pull: Pull) -> Robot {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.2)));
        module.damping = PerDisc::Uniform(DAMPING);
        let tendons = module.tendons.as_mut().unwrap();
        (tendons.drive, tendons.range, tendons.pull) = (drive, range, pull);
    }
    Robot::new(spec).unwrap()
}

fn held() -> Robot {
    driven(Drive::Length, [0.0, 0.2], Pull::TensionOnly)
}

/// A ball that is in the way of the robot's tip as it bends, and clear of the straight robot.
fn in_the_way(robot: &Robot, command: &Command) -> Scene {
    let straight = *State::straight(robot).positions(robot).last().unwrap();
    let bent = robot.settle(command, &Loads::default()).positions;
    let between = straight.lerp(bent.last().unwrap(), 0.8);
    let aside = (bent.last().unwrap() - straight).normalize();
    let ball = Obstacle::sphere("ball", 0.01).unwrap();
    let ball = ball.at((between + aside * 0.03).into()).with_friction(0.3);
    Scene::new(vec![ball.unwrap()]).unwrap()
}

/// The command of a step of a motion from the straight robot's lengths to these in half a second.
fn ramp(robot: &Robot, step: usize, lengths: &[f64; 6]) -> Command {
    let straight = MovingRobot::new(robot, 2e-3, Integrator::ImplicitEuler, 1).unwrap();
    let share = (step as f64 / 250.0).min(1.0);
    let from = straight.pose().tendon_lengths;
    let given = from
        .iter()
        .zip(lengths)
        .map(|(from, to)| from + share * (to - from));
    robot.command(&given.collect::<Vec<f64>>()).unwrap()
}

/// The tensions of the last step (N).
fn tensions(stepper: &ContactStepper) -> Vec<f64> {
    let held = stepper.stepper().held_tensions();
    held.map(|(_, tension)| tension).collect()
}

#[test]
fn far_from_obstacles_steps_are_the_same_to_the_last_bit() {
    let robot = held();
    let far = Obstacle::sphere("far", 0.1).unwrap().at([3.0, 0.0, 0.0]);
    let far = Scene::new(vec![far]).unwrap();
    // It curls up at once.
    let far = far.with_self_contact(SelfContact::Ignored).unwrap();
    let command = robot.command(&THREE).unwrap();
    for integrator in BOTH {
        let mut free = Stepper::new(&robot, 2e-3, integrator).unwrap();
        let mut among = among(&robot, &far, 2e-3, integrator);
        let mut states = [State::straight(&robot), State::straight(&robot)];
        for _ in 0..50 {
            let [own, other] = &mut states;
            free.step(own, &command, &Loads::default()).unwrap();
            among.step(other, &command, &Loads::default()).unwrap();
            assert_eq!(own, other);
            assert!(free.held_tensions().eq(among.stepper().held_tensions()));
        }
    }
}

#[test]
fn a_pressed_robot_keeps_its_lengths() {
    let robot = held();
    for lengths in [ONE, THREE] {
        let command = robot.command(&lengths).unwrap();
        let scene = in_the_way(&robot, &command);
        for integrator in BOTH {
            let stepper = among(&robot, &scene, 2e-3, integrator);
            let mut moving = MovingRobot::among(stepper, 1);
            let (mut touched, mut worst) = (0, 0.0_f64);
            for step in 0..5000 {
                let given = ramp(&robot, step, &lengths);
                if step == 0 {
                    moving.start_at(&State::straight(&robot), &given).unwrap();
                }
                moving.advance(&given, &Loads::default()).unwrap();
                touched += usize::from(!moving.contacts().is_empty());
                let pose = moving.pose();
                for (tendon, &length) in pose.tendon_lengths.iter().enumerate() {
                    let over = length - given.as_slice()[tendon];
                    let error = match pose.tendon_tensions[tendon] > 0.0 {
                        true => over.abs(),
                        false => over.max(0.0),
                    };
                    worst = worst.max(error);
                }
            }
            let unsolved = moving.contact_stepper().unsolved();
            eprintln!("{integrator:?}: {touched} steps in contact, {worst:.1e} m, {unsolved}");
            assert!(touched > 1000 && unsolved == 0, "{touched} {unsolved}");
            assert!(worst < 2e-6, "{worst}");
        }
    }
}

#[test]
fn a_pressed_robot_comes_to_rest_where_it_settles() {
    let robot = held();
    let [semi, implicit] = BOTH;
    // From the straight robot at once. In implicit steps three lengths lead to another pose of rest, from which settling does not
    // converge.
    for (lengths, integrators) in [(ONE, vec![semi, implicit]), (THREE, vec![semi])] {
        let command = robot.command(&lengths).unwrap();
        let scene = frictionless(&in_the_way(&robot, &command));
        for integrator in integrators {
            let mut stepper = among(&robot, &scene, 2e-3, integrator);
            let mut state = State::straight(&robot);
            for _ in 0..10_000 {
                stepper
                    .step(&mut state, &command, &Loads::default())
                    .unwrap();
            }
            let mut settler = ContactSettler::new(&robot, &scene);
            let found = settler
                .settle_from(&state.configuration, &command, &Loads::default())
                .unwrap();
            assert!(found.equilibrium.converged);
            let here = state.positions(&robot);
            let apart = here.iter().zip(&found.equilibrium.positions);
            let far = apart.map(|(p, q)| (p - q).norm()).fold(0.0, f64::max);
            let pulls = tensions(&stepper);
            let pulls = pulls.iter().zip(&found.equilibrium.tendon_tensions);
            let pulled = pulls.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let sum = |contacts: &[tdcr_sim::contact::Contact]| -> Vector3<f64> {
                contacts.iter().map(|contact| contact.force).sum()
            };
            let (moving, resting) = (sum(stepper.contacts()), sum(&found.contacts));
            let pressed = (moving - resting).norm();
            eprintln!(
                "{integrator:?}: {far:.1e} m, {pulled:.1e} N of a tension, {pressed:.1e} N of {:.2}",
                resting.norm()
            );
            assert!(resting.norm() > 0.03);
            // Where several pull, their tensions depend on lengths to what the settler has these.
            assert!(far < 1e-6 && pulled < 1e-4 && pressed < 1e-5);
        }
    }
}

fn frictionless(scene: &Scene) -> Scene {
    let smooth = scene.obstacles()[0].clone().with_friction(0.0).unwrap();
    Scene::new(vec![smooth]).unwrap()
}

#[test]
fn tensions_and_contact_forces_are_the_change_of_momentum() {
    let (robot, pulled) = (
        held(),
        driven(Drive::Tension, [0.0, 1e6], Pull::TensionOnly),
    );
    let (h, loads) = (2e-3, Loads::default());
    let command = robot.command(&THREE).unwrap();
    let scene = in_the_way(&robot, &command);
    let mut stepper = among(&robot, &scene, h, Integrator::SemiImplicitEuler);
    let mut free = Stepper::new(&pulled, h, Integrator::SemiImplicitEuler).unwrap();
    let mut state = State::straight(&robot);
    let mut compared = 0;
    for step in 0..600 {
        let given = ramp(&robot, step, &THREE);
        let before = state.clone();
        let mut without = state.clone();
        stepper.step(&mut state, &given, &loads).unwrap();
        let tensions = pulled.command(&tensions(&stepper)).unwrap();
        free.step(&mut without, &tensions, &loads).unwrap();
        let gained = momentum_gained(&pulled, &before, [&state, &without], h * DAMPING);
        let impulse = impulses(&stepper, &before);
        let error = (&gained - &impulse).amax();
        assert!(
            error <= 1e-8 * impulse.amax() + 1e-11,
            "{step}: {error:e} of {:e}",
            impulse.amax()
        );
        compared += usize::from(impulse.amax() > 1e-6);
    }
    assert!(compared > 100, "{compared}");
}

/// A load that stretches a tendon, and a wall that pushes the robot the other way.
#[test]
fn a_tendon_goes_slack_where_an_obstacle_pushes_it_shorter() {
    let robot = held();
    let mut moving = MovingRobot::new(&robot, 2e-3, Integrator::ImplicitEuler, 1).unwrap();
    let straight = State::straight(&robot);
    let lengths = moving.pose().tendon_lengths.to_vec();
    let last = robot.discs().len() - 1;
    let tip = straight.positions(&robot)[last];
    // The side to which the tip goes as the first tendon pulls.
    let bent = robot.settle(&robot.command(&ONE).unwrap(), &Loads::default());
    let mut side = bent.positions[last] - tip;
    side.z = 0.0;
    let side = side.normalize();
    let command = robot
        .command(&[lengths[0], 0.2, 0.2, 0.2, 0.2, 0.2])
        .unwrap();
    let load = Wrench {
        force: (-side).into(),
        ..Wrench::none(last, Frame::World)
    };
    let loads = Loads::default().with_wrench(load).unwrap();
    moving.start_at(&straight, &command).unwrap();
    moving.advance(&command, &loads).unwrap();
    assert!(moving.pose().tendon_tensions[0] > 0.1);
    // A soft wall that the disc's rim is pressed into by 1 mm.
    let turn = nalgebra::UnitQuaternion::rotation_between(&Vector3::z(), &side).unwrap();
    let rim = robot.spec().modules.last().unwrap().radius;
    let turn = [turn.w, turn.i, turn.j, turn.k];
    for integrator in BOTH {
        let wall = Obstacle::half_space("wall")
            .at((tip - side * (rim - 1e-3)).into())
            .with_orientation(turn)
            .and_then(|wall| wall.with_compliance(1e-4))
            .unwrap();
        let scene = Scene::new(vec![wall]).unwrap();
        let mut moving = MovingRobot::among(among(&robot, &scene, 2e-3, integrator), 1);
        moving.start_at(&straight, &command).unwrap();
        for _ in 0..20 {
            moving.advance(&command, &loads).unwrap();
            assert_eq!(moving.pose().tendon_tensions[0], 0.0);
            assert!(moving.pose().tendon_lengths[0] < lengths[0] - 1e-7);
        }
        assert_eq!(moving.contact_stepper().unsolved(), 0);
    }
}

#[test]
fn energy_does_not_grow_without_input() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let robot = held();
    let straight = MovingRobot::new(&robot, 1e-3, Integrator::ImplicitEuler, 1).unwrap();
    let lengths = straight.pose().tendon_lengths.to_vec();
    let command = robot
        .command(&[lengths[0], 0.2, 0.2, lengths[3], 0.2, 0.2])
        .unwrap();
    let (mut worst, mut touched, mut unsolved) = (0.0_f64, 0, 0);
    for _ in 0..20 {
        let scene = scene(&mut rng, &robot);
        let mut stepper = among(&robot, &scene, 1e-3, Integrator::ImplicitEuler);
        let mut state = State::straight(&robot);
        if stepper.check_start(&state).is_err() {
            continue;
        }
        (state.velocity.iter_mut()).for_each(|v| *v = within(-4.0, 4.0, &mut rng));
        let start = stepper.energy(&state, &command, &Loads::default()).unwrap();
        let mut before = start.total();
        for _ in 0..500 {
            stepper
                .step(&mut state, &command, &Loads::default())
                .unwrap();
            touched += stepper.contacts().len();
            let now = stepper.energy(&state, &command, &Loads::default()).unwrap();
            worst = worst.max((now.total() - before) / start.kinetic);
            before = now.total();
        }
        unsolved += stepper.unsolved();
    }
    eprintln!("{touched} contacts, largest growth {worst:e} of the kinetic energy, {unsolved}");
    assert!(touched > 300 && unsolved == 0, "{touched} {unsolved}");
    assert!(worst < 1e-3, "{worst:e}");
}

#[test]
fn the_law_of_mujoco_refuses_them_by_name() {
    let stepper = Stepper::new(&held(), 2e-3, Integrator::ImplicitEuler).unwrap();
    let law = ContactLaw::Impedance(Impedance::default());
    let ground = Scene::new(vec![Obstacle::half_space("ground")]).unwrap();
    let refused = ContactStepper::new(stepper, &ground.with_contact_law(law).unwrap());
    assert_eq!(
        refused.unwrap_err(),
        DynamicsError::Inextensible { tendon: 0 }
    );
}
