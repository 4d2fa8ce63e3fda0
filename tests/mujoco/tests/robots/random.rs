//! Robots of every kind that MuJoCo models the same way, in the MJCF that we export.

use nalgebra::DVector;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_mujoco::Model;
use tdcr_sim::chain::Configuration;
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::formats::mjcf::{self, ExportOptions};
use tdcr_sim::robot::{Command, Loads, Robot, RobotSpec};

use crate::probe::{Probe, largest_difference};

#[path = "../../../../sim/tests/common/random_robot.rs"]
pub mod random_robot;
use random_robot::{Kind, random_robot, within};

/// The robot as MuJoCo reads it from our export, a payload included.
fn exported(robot: &Robot, loads: &Loads) -> Model {
    exported_with_step(robot, loads, None)
}

/// The same with a time step (s), where not the one that the export chooses.
fn exported_with_step(robot: &Robot, loads: &Loads, timestep: Option<f64>) -> Model {
    let options = ExportOptions {
        payload: loads.tip_payload(),
        timestep,
        ..ExportOptions::default()
    };
    Model::from_xml(&mjcf::export(robot.spec(), &options).unwrap()).unwrap()
}

/// The standard robots and random ones.
fn robots(count: usize, rng: &mut impl Rng) -> Vec<Robot> {
    let standard = RobotSpec::STANDARD.map(|name| Robot::load(name).unwrap());
    let random = (0..count).map(|_| random_robot(Kind::Mujoco, rng));
    standard.into_iter().chain(random).collect()
}

/// A state with joints turned and turning.
fn random_state(robot: &Robot, rng: &mut impl Rng) -> State {
    let straight = Configuration::straight(robot);
    let mut state = State::straight(robot);
    let turns: Vec<f64> = (0..robot.dof()).map(|_| within(-0.3, 0.3, rng)).collect();
    straight.retract(robot, &turns, &mut state.configuration);
    state.velocity = (0..robot.dof()).map(|_| within(-2.0, 2.0, rng)).collect();
    state
}

fn random_payload(rng: &mut impl Rng) -> Loads {
    Loads::payload(if rng.random() { 0.0 } else { 0.02 }).unwrap()
}

#[test]
fn kinematics_masses_and_bias_are_mujocos() {
    let mut rng = ChaCha8Rng::seed_from_u64(41);
    for robot in robots(30, &mut rng) {
        let loads = random_payload(&mut rng);
        let model = exported(&robot, &loads);
        let command = robot.random_command(&mut rng);
        let state = random_state(&robot, &mut rng);
        let mut probe = Probe::new(&model, &robot, &command, &Loads::default());
        probe.place(&state.configuration);
        probe.set_in_motion(&state.velocity);
        let name = &robot.spec().name;
        let (lengths, jacobian) = robot.tendon_kinematics(&state.configuration);
        assert!(largest_difference(probe.data().ten_length(), &lengths) <= 1e-12);
        assert!(
            (probe.data().ten_jacobian() - jacobian).amax() <= 1e-12,
            "{name}"
        );
        let terms = robot.motion_terms(&state, &loads).unwrap();
        // MuJoCo takes no point mass: the payload has moments of 1e-14 kg m2.
        let mass = (probe.data().mass_matrix() - terms.mass).amax();
        assert!(mass <= 1e-12, "{name}: masses differ by {mass} kg m2");
        let bias = largest_difference(probe.data().qfrc_bias(), &terms.bias);
        assert!(bias <= 1e-12, "{name}: bias torques differ by {bias} N m");
        for (disc, position) in state.positions(&robot).iter().enumerate() {
            assert!((probe.disc_pose(disc).0 - position).amax() <= 1e-12);
        }
    }
}

#[test]
fn mujoco_finds_no_force_where_random_robots_settle() {
    let mut rng = ChaCha8Rng::seed_from_u64(42);
    let mut settled_robots = 0;
    for robot in robots(60, &mut rng) {
        let loads = random_payload(&mut rng);
        let command = robot.random_command(&mut rng);
        let settled = robot.settle(&command, &loads);
        if !settled.converged {
            continue;
        }
        settled_robots += 1;
        let model = exported(&robot, &loads);
        let mut probe = Probe::new(&model, &robot, &command, &Loads::default());
        let force = probe.force_at(&settled.configuration);
        assert!(force <= 1e-9, "{force} N m left");
        assert!(largest_difference(probe.data().ten_length(), &settled.tendon_lengths) <= 1e-12);
    }
    assert!(
        settled_robots >= 50,
        "{settled_robots} of 63 robots settled"
    );
}

/// Commands that move all tendons within their ranges.
fn moving(robot: &Robot, steps: usize, rng: &mut impl Rng) -> Vec<Command> {
    let phases: Vec<f64> = robot
        .tendons()
        .iter()
        .map(|_| within(0.0, 6.0, rng))
        .collect();
    let command = |step: usize| {
        let pull = |phase: &f64| 0.02 + 0.015 * (0.02 * step as f64 + phase).sin();
        robot
            .command(&phases.iter().map(pull).collect::<Vec<_>>())
            .unwrap()
    };
    (0..steps).map(command).collect()
}

#[test]
fn trajectories_are_mujocos_for_a_thousand_steps() {
    let mut rng = ChaCha8Rng::seed_from_u64(43);
    let mut worst: f64 = 0.0;
    for robot in robots(12, &mut rng) {
        let loads = random_payload(&mut rng);
        let model = exported_with_step(&robot, &loads, Some(0.002));
        let commands = moving(&robot, 1_000, &mut rng);
        let mut stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler).unwrap();
        let mut state = State::straight(&robot);
        let mut probe = Probe::new(&model, &robot, &commands[0], &Loads::default());
        for command in &commands {
            stepper.step(&mut state, command, &loads).unwrap();
            probe.command(command);
            probe.step(1);
        }
        probe.look();
        for (disc, position) in state.positions(&robot).iter().enumerate() {
            let apart = (probe.disc_pose(disc).0 - position).norm();
            worst = worst.max(apart);
            assert!(
                apart <= 1e-8,
                "{} disc {disc}: {apart} m",
                robot.spec().name
            );
        }
        let rates = DVector::from_column_slice(probe.data().qvel())
            - DVector::from_column_slice(&state.velocity);
        assert!(rates.amax() <= 1e-6, "{} rad/s", rates.amax());
    }
    assert!(worst > 0.0, "two programs differ in rounding at least");
}
