//! The implicit midpoint rule: energy, symmetry, stiffness, and what it says where it cannot step.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::dynamics::{DynamicsError, Integrator, State, Stepper};
use tdcr_sim::robot::{Frame, Loads, PerDisc, Robot, Wrench};

use super::rods::rod;
use super::{all_loads, dead_loads, difference, random_robots, random_state, without_kinks};
use crate::random_robot::{Kind, random_spec};

fn midpoint(robot: &Robot, h: f64) -> Stepper {
    Stepper::new(robot, h, Integrator::ImplicitMidpoint).unwrap()
}

/// Energy departs from its start by an error of second order that goes to and fro, and does not grow.
#[test]
fn without_damping_energy_is_kept_to_second_order_and_does_not_drift() {
    let mut rng = ChaCha8Rng::seed_from_u64(71);
    for _ in 0..3 {
        let mut spec = random_spec(Kind::Mujoco, &mut rng);
        for module in &mut spec.modules {
            module.damping = PerDisc::Uniform(0.0);
        }
        let robot = without_kinks(&Robot::new(spec).unwrap());
        let start = random_state(&robot, &mut rng);
        let loads = dead_loads(&robot, &mut rng);
        let command = robot.mean_command();
        let departures = |h: f64, time: f64| {
            let mut stepper = midpoint(&robot, h);
            let mut state = start.clone();
            let before = stepper.energy(&start, &command, &loads).unwrap().total();
            let mut departures = Vec::new();
            for _ in 0..(time / h).round() as usize {
                stepper.step(&mut state, &command, &loads).unwrap();
                let now = stepper.energy(&state, &command, &loads).unwrap().total();
                departures.push((now - before).abs());
            }
            assert_eq!(stepper.fallbacks(), 0);
            departures
        };
        let largest = |departures: &[f64]| departures.iter().fold(0.0_f64, |m, d| m.max(*d));
        let [coarse, fine] = [1e-3, 5e-4].map(|h| largest(&departures(h, 0.1)));
        let order = (coarse / fine).log2();
        assert!(
            (1.7..2.5).contains(&order),
            "order {order}: {coarse} {fine} J"
        );
        // Ten times as long, no more.
        let long = departures(1e-3, 2.0);
        let (early, late) = long.split_at(long.len() / 2);
        let [early, late] = [early, late].map(largest);
        assert!(late < 2.0 * early, "{early} J, then {late} J");
    }
}

/// The rule is symmetric: a step back leads to where the step began.
#[test]
fn a_step_with_the_rates_turned_round_leads_back() {
    let mut rng = ChaCha8Rng::seed_from_u64(72);
    for robot in random_robots(4, &mut rng) {
        let mut spec = without_kinks(&robot).spec().clone();
        for module in &mut spec.modules {
            module.damping = PerDisc::Uniform(0.0);
            if let Some(PerDisc::Each(joints)) = &mut module.joint {
                let hinges = joints.iter_mut().flat_map(|joint| &mut joint.hinges);
                hinges.for_each(|hinge| hinge.damping = 0.0);
            }
        }
        let robot = Robot::new(spec).unwrap();
        let (start, loads) = (random_state(&robot, &mut rng), all_loads(&robot, &mut rng));
        let command = robot.mean_command();
        let mut stepper = midpoint(&robot, 1e-3);
        let mut state = start.clone();
        for _ in 0..2 {
            for _ in 0..10 {
                stepper.step(&mut state, &command, &loads).unwrap();
            }
            state.velocity.iter_mut().for_each(|rate| *rate = -*rate);
        }
        let apart = difference(&robot, &start, &state);
        assert!(apart.iter().all(|d| d.abs() < 1e-6), "{apart:?}");
        assert_eq!(stepper.fallbacks(), 0);
    }
}

fn pressed(robot: &Robot, force: f64, frame: Frame) -> Loads {
    let wrench = Wrench {
        force: [0.0, 0.0, -force],
        ..Wrench::none(robot.discs().len() - 1, frame)
    };
    Loads::default().with_wrench(wrench).unwrap()
}

/// A steel rod pressed far beyond buckling: what stiffness there is, is negative. Pressed by a force that turns with its tip
/// the rod has no other equilibrium to go to (Beck's column), and steps are taken as they should.
#[test]
fn where_its_matrix_is_indefinite_the_implicit_euler_method_says_so() {
    let robot = rod(10, [0.0; 2], 1e-6);
    let command = robot.mean_command();
    let mut bent = State::straight(&robot);
    let turns: Vec<f64> = (0..robot.dof()).map(|i| 0.01 * (i as f64).sin()).collect();
    (State::straight(&robot).configuration).retract(&robot, &turns, &mut bent.configuration);
    for (force, frame, fallbacks) in [
        (50.0, Frame::World, 1),
        (0.1, Frame::World, 0),
        (50.0, Frame::Disc, 0),
    ] {
        let loads = pressed(&robot, force, frame);
        let mut stepper = Stepper::new(&robot, 2e-2, Integrator::ImplicitEuler).unwrap();
        let _ = stepper.step(&mut bent.clone(), &command, &loads);
        assert_eq!(stepper.fallbacks(), fallbacks, "{frame:?}, {force} N");
    }
}

/// A joint that turns too far in the whole step and, damped as it is, not in its halves.
#[test]
fn a_step_that_is_taken_in_halves_is_counted() {
    let robot = rod(1, [4.7; 2], 1e-2);
    let command = robot.mean_command();
    let mut state = State::straight(&robot);
    state.velocity[0] = 60.0;
    let mut whole = midpoint(&robot, 2e-2);
    let mut halves = midpoint(&robot, 1e-2);
    let [mut one, mut two] = [state.clone(), state.clone()];
    whole.step(&mut one, &command, &Loads::default()).unwrap();
    for _ in 0..2 {
        halves.step(&mut two, &command, &Loads::default()).unwrap();
    }
    assert_eq!([whole.fallbacks(), halves.fallbacks()], [1, 0]);
    assert_eq!(one, two);
    // Beyond all halves it is refused, and the state left as it was.
    state.velocity[0] = 1e6;
    let before = state.clone();
    let error = (whole.step(&mut state, &command, &Loads::default())).unwrap_err();
    assert!(matches!(error, DynamicsError::NotSolved { timestep, .. } if timestep == 2e-2));
    assert_eq!(state, before);
}

/// Stiff ways to move do not limit the step: 1 ms is some two hundred times what is stable for explicit steps.
#[test]
fn long_steps_of_a_stiff_rod_are_solved() {
    let robot = rod(50, [1e-5; 2], 0.0);
    let command = robot.mean_command();
    let push = pressed(&robot, -0.0, Frame::World);
    let mut state = State::straight(&robot);
    (0..robot.dof()).for_each(|i| state.velocity[i] = if i % 3 == 0 { 0.1 } else { 0.0 });
    let explicit = Stepper::new(&robot, 1e-3, Integrator::RungeKutta4).unwrap();
    assert!(matches!(
        explicit.check_stable(&State::straight(&robot), &command, &push),
        Err(DynamicsError::Unstable { longest, .. }) if longest < 1e-5
    ));
    let mut stepper = midpoint(&robot, 1e-3);
    let before = stepper.energy(&state, &command, &push).unwrap().total();
    for _ in 0..200 {
        stepper.step(&mut state, &command, &push).unwrap();
        let now = stepper.energy(&state, &command, &push).unwrap().total();
        assert!(
            now < before * (1.0 + 1e-9),
            "damping takes energy: {before} {now}"
        );
    }
    assert_eq!(stepper.fallbacks(), 0);
}
