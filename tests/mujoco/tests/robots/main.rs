//! Settled poses against MuJoCo: its forces vanish there, and its own way leads there.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod contact_motion;
mod contacts;
mod hinges;
mod paper;
mod probe;
mod pushed;
mod random;
#[path = "../../../../sim/tests/statics/contact/scenes.rs"]
mod scenes;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::robot::{Loads, Robot, RobotSpec};

use crate::probe::{Probe, largest_difference};

fn standard_robots() -> impl Iterator<Item = Robot> {
    RobotSpec::STANDARD
        .into_iter()
        .map(|name| Robot::load(name).unwrap())
}

#[test]
fn mujoco_finds_no_force_at_our_equilibria() {
    let mut rng = ChaCha8Rng::seed_from_u64(20_260_101);
    for robot in standard_robots() {
        let model = probe::model(&robot);
        for payload in [0.0, 0.02] {
            let loads = Loads::payload(payload).unwrap();
            for _ in 0..100 {
                let command = robot.random_command(&mut rng);
                let ours = robot.settle(&command, &loads);
                assert!(ours.converged && ours.residual <= 1e-9);
                let mut probe = Probe::new(&model, &robot, &command, &loads);
                let force = probe.force_at(&ours.configuration);
                assert!(force <= 1e-9, "{} {command:?}: {force}", robot.spec().name);

                for (disc, orientation) in ours.orientations.iter().enumerate() {
                    let (position, theirs) = probe.disc_pose(disc);
                    assert!((position - ours.positions[disc]).amax() <= 1e-12);
                    assert!(theirs.angle_to(orientation) <= 1e-12);
                }
                let lengths = probe.data().ten_length();
                assert!(largest_difference(lengths, &ours.tendon_lengths) <= 1e-12);
                let tensions: Vec<f64> = probe.data().actuator_force().iter().map(|f| -f).collect();
                assert!(largest_difference(&tensions, &ours.tendon_tensions) <= 1e-9);
            }
        }
    }
}

#[test]
fn mujocos_own_way_leads_to_our_equilibria() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for robot in standard_robots() {
        let model = probe::model(&robot);
        for _ in 0..2 {
            let command = robot.random_command(&mut rng);
            let ours = robot.settle(&command, &Loads::default());
            let mut probe = Probe::new(&model, &robot, &command, &Loads::default());
            probe.step(5_000);
            probe.refine();
            for (disc, position) in ours.positions.iter().enumerate() {
                let apart = (probe.disc_pose(disc).0 - position).norm();
                assert!(
                    apart <= 1e-7,
                    "{} disc {disc}: {apart} m",
                    robot.spec().name
                );
            }
        }
    }
}

#[test]
fn a_payload_bends_the_robot_as_in_mujoco() {
    let robot = Robot::load("3m").unwrap();
    let model = probe::model(&robot);
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let command = robot.random_command(&mut rng);
    let unloaded = robot.settle(&command, &Loads::default());
    let mut probe = Probe::new(&model, &robot, &command, &Loads::default());
    probe.place(&unloaded.configuration);
    // Soft modes: Newton's method follows a payload that grows in steps.
    for step in 1..=10 {
        probe.load(&Loads::payload(0.003 * f64::from(step)).unwrap());
        probe.refine();
    }
    let ours = robot.settle(&command, &Loads::payload(0.03).unwrap());
    let tip = ours.positions.len() - 1;
    assert!((ours.positions[tip] - unloaded.positions[tip]).norm() > 1e-4);
    for (disc, position) in ours.positions.iter().enumerate() {
        let apart = (probe.disc_pose(disc).0 - position).norm();
        assert!(apart <= 1e-7, "disc {disc}: {apart} m");
    }
}
