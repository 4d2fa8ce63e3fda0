//! Servos: commanded lengths, lag, rate and limits of force.

use tdcr_sim::dynamics::{DynamicsError, Integrator, Lineariser, Rollout, State, Stepper};
use tdcr_sim::robot::{
    Backbone, Command, Drive, Fluid, Loads, PerDisc, Pull, Robot, RobotSpec, ServoSpec,
};
use tdcr_sim::simulation::{MovingRobot, Simulation};

/// 2m on an elastic backbone, well damped, with other tendons.
fn driven(drive: Drive, range: [f64; 2], pull: Pull, servo: Option<ServoSpec>) -> Robot {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.2)));
        module.damping = PerDisc::Uniform(0.02);
        let tendons = module.tendons.as_mut().unwrap();
        (tendons.drive, tendons.range, tendons.pull) = (drive, range, pull);
        tendons.servo = servo;
    }
    Robot::new(spec).unwrap()
}

/// Where the robot comes to rest from `start`.
fn at_rest(robot: &Robot, integrator: Integrator, start: &Command, end: &Command) -> MovingRobot {
    let mut moving = MovingRobot::new(robot, 0.002, integrator, 5000).unwrap();
    moving.reset(start, &Loads::default()).unwrap();
    moving.advance(end, &Loads::default()).unwrap();
    moving
}

/// Largest distance of a disc from where the robot settles (m), and of a tension from that there (N).
fn off(robot: &Robot, moving: &MovingRobot, command: &Command) -> (f64, f64) {
    let settled = robot.settle(command, &Loads::default());
    assert!(settled.converged);
    let pose = moving.pose();
    let discs = pose.positions.iter().zip(&settled.positions);
    let tensions = pose.tendon_tensions.iter().zip(&settled.tendon_tensions);
    let far = discs.map(|(p, q)| (p - q).norm()).fold(0.0, f64::max);
    (
        far,
        tensions.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max),
    )
}

#[test]
fn commanded_lengths_come_to_rest_where_the_robot_settles() {
    let servo = ServoSpec {
        lag: 0.05,
        rate: Some(0.1),
        largest_force: None,
    };
    let robot = driven(Drive::Length, [0.0, 0.2], Pull::TensionOnly, Some(servo));
    let start = robot.command(&[0.084, 0.2, 0.2, 0.2, 0.2, 0.2]).unwrap();
    for (end, pulling) in [
        ([0.075, 0.2, 0.2, 0.2, 0.2, 0.2], 1),
        ([0.078, 0.08, 0.2, 0.2, 0.2, 0.072], 3),
    ] {
        let end = robot.command(&end).unwrap();
        for integrator in [Integrator::SemiImplicitEuler, Integrator::ImplicitEuler] {
            let moving = at_rest(&robot, integrator, &start, &end);
            let (far, pulled) = off(&robot, &moving, &end);
            let taut = moving.pose().tendon_tensions.iter().filter(|t| **t > 0.1);
            eprintln!("{integrator:?}: {far:.1e} m, {pulled:.1e} N");
            assert_eq!(taut.count(), pulling);
            assert!(
                far < 1e-6 && pulled < 1e-5,
                "{integrator:?}: {far} {pulled}"
            );
        }
    }
}

#[test]
fn lengths_that_contradict_each_other_share_the_load_and_do_not_diverge() {
    // All tendons of both modules shorter than the discs let them be: by 0.5 mm each.
    let robot = driven(Drive::Length, [0.0, 0.2], Pull::TensionOnly, None);
    let mut moving = MovingRobot::new(&robot, 0.002, Integrator::ImplicitEuler, 100).unwrap();
    let straight = moving.pose().tendon_lengths.to_vec();
    let command = |short: f64| {
        let lengths: Vec<f64> = straight.iter().map(|length| length - short).collect();
        robot.command(&lengths).unwrap()
    };
    let state = State::straight(&robot);
    moving.start_at(&state, &command(0.0)).unwrap();
    moving.advance(&command(5e-4), &Loads::default()).unwrap();
    let tensions = moving.pose().tendon_tensions;
    assert!(
        tensions.iter().all(|tension| *tension > 1e4),
        "{tensions:?}"
    );
}

#[test]
fn a_commanded_length_is_kept_in_every_step_of_a_motion() {
    let servo = ServoSpec {
        rate: Some(0.05),
        ..ServoSpec::default()
    };
    let robot = driven(Drive::Length, [0.0, 0.2], Pull::TensionOnly, Some(servo));
    let command = |first: f64| robot.command(&[first, 0.2, 0.2, 0.2, 0.2, 0.2]).unwrap();
    for integrator in [Integrator::SemiImplicitEuler, Integrator::ImplicitEuler] {
        let mut moving = MovingRobot::new(&robot, 0.002, integrator, 1).unwrap();
        moving.reset(&command(0.084), &Loads::default()).unwrap();
        for step in 1..=100 {
            moving.advance(&command(0.07), &Loads::default()).unwrap();
            let acting = moving.acting().as_slice()[0];
            assert!((acting - (0.084 - 1e-4 * f64::from(step))).abs() < 1e-12);
            let error = moving.pose().tendon_lengths[0] - acting;
            assert!(error.abs() < 1e-6, "{step}: {error}");
            assert!(moving.pose().tendon_tensions[0] > 0.0);
            assert_eq!(moving.pose().tendon_tensions[1], 0.0);
        }
    }
}

#[test]
fn the_tensions_that_hold_lengths_move_the_robot_as_the_same_tensions_commanded() {
    // In a thick fluid, which is in the step's matrix.
    let thick = |drive, range| {
        let mut spec = driven(drive, range, Pull::TensionOnly, None).spec().clone();
        spec.fluid = Some(Fluid {
            density: 1e5,
            drag_coefficient: 1.1,
        });
        Robot::new(spec).unwrap()
    };
    let held = thick(Drive::Length, [0.0, 0.2]);
    let pulled = thick(Drive::Tension, [0.0, 1e6]);
    let stepper = |robot| Stepper::new(robot, 0.002, Integrator::SemiImplicitEuler).unwrap();
    let (mut holding, mut pulling) = (stepper(&held), stepper(&pulled));
    let mut state = State::straight(&held);
    for step in 1..=50 {
        let first = 0.085 - 1e-4 * f64::from(step);
        let lengths = held.command(&[first, 0.2, 0.2, 0.2, 0.2, first]).unwrap();
        let mut other = state.clone();
        holding
            .step(&mut state, &lengths, &Loads::default())
            .unwrap();
        let tensions: Vec<f64> = holding
            .held_tensions()
            .map(|(_, tension)| tension)
            .collect();
        let tensions = pulled.command(&tensions).unwrap();
        pulling
            .step(&mut other, &tensions, &Loads::default())
            .unwrap();
        let rates = state.velocity.iter().zip(&other.velocity);
        let apart = rates.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-9, "{step}: {apart}");
    }
    assert!(state.velocity.iter().any(|rate| rate.abs() > 0.01));
}

#[test]
fn a_servo_at_its_largest_force_holds_that_in_motion_and_at_rest() {
    let servo = |force| ServoSpec {
        largest_force: Some(force),
        ..ServoSpec::default()
    };
    let drive = Drive::Gain(500.0);
    let weak = driven(drive, [0.0, 0.2], Pull::TensionOnly, Some(servo(2.0)));
    let strong = driven(drive, [0.0, 0.2], Pull::TensionOnly, None);
    let values = [0.07, 0.1, 0.1, 0.1, 0.1, 0.1];
    let [start, end] = [[0.1; 6], values].map(|values| weak.command(&values).unwrap());
    let unlimited = strong.settle(&strong.command(&values).unwrap(), &Loads::default());
    assert!(
        unlimited.tendon_tensions[0] > 2.5,
        "{:?}",
        unlimited.tendon_tensions
    );
    let moving = at_rest(&weak, Integrator::SemiImplicitEuler, &start, &end);
    let (far, pulled) = off(&weak, &moving, &end);
    assert!(far < 1e-6 && pulled < 1e-6, "{far} {pulled}");
    assert_eq!(moving.pose().tendon_tensions[0], 2.0);
}

#[test]
fn a_late_servo_is_an_ideal_one_under_the_command_that_acts() {
    let servo = ServoSpec {
        lag: 0.03,
        ..ServoSpec::default()
    };
    let drive = Drive::Gain(300.0);
    let late = driven(drive, [0.0, 0.1], Pull::Bilateral, Some(servo));
    let ideal = driven(drive, [0.0, 0.1], Pull::Bilateral, None);
    let (from, to, h) = (0.05, 0.03, 0.002);
    let command = |robot: &Robot, value: f64| {
        robot
            .command(&[value, 0.05, 0.05, 0.05, 0.05, 0.05])
            .unwrap()
    };
    let rollout = |robot: &Robot, values: Vec<f64>| {
        let rollout = Rollout {
            start: State::straight(robot),
            commands: values
                .into_iter()
                .map(|value| command(robot, value))
                .collect(),
            loads: Loads::default(),
            wrenches: Vec::new(),
        };
        let mut stepper = Stepper::new(robot, h, Integrator::SemiImplicitEuler).unwrap();
        stepper.rollout(&rollout).unwrap()
    };
    // From the first command to the second by the lag's closed form.
    let given = |step: i32| if step == 0 { from } else { to };
    let acts = |step: i32| to + (from - to) * (-f64::from(step) * h / servo.lag).exp();
    let states = rollout(&late, (0..100).map(given).collect());
    let expected = rollout(&ideal, (0..100).map(acts).collect());
    for (state, expected) in states.iter().zip(&expected) {
        let rates = state.velocity.iter().zip(&expected.velocity);
        assert!(rates.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 1e-11);
    }
    assert_eq!(
        Lineariser::new(&late, h).unwrap_err(),
        DynamicsError::LateServo { tendon: 0 }
    );
}
