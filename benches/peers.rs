//! The times of ours that `benches/peers.py` sets beside MuJoCo's: prints one line of JSON.
//!
//! On one thread, but for the batch of rollouts and the pictures: settling random commands from the straight pose, and
//! along a path of commands; the Jacobian of all disc poses by the command, at a settled pose; steps
//! of 2 ms along a moving command; colour, depth and mask of the robot's eight cameras, with base.
#![allow(clippy::print_stdout, reason = "the result goes to stdout")]

use std::hint::black_box;
use std::time::{Duration, Instant};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use tdcr::base::stats::median;
use tdcr::sim::camera::Camera;
use tdcr::sim::dynamics::{Integrator, Rollout, State, Stepper, rollout_batch};
use tdcr::sim::render::{BaseVisibility, Visuals};
use tdcr::sim::robot::{Command, Loads, Robot, RobotSpec};
use tdcr::sim::statics::Settler;

const TIMESTEP: f64 = 0.002;
const ROLLOUTS: usize = 16;

/// Medians, in microseconds, and the commands for MuJoCo to settle.
#[derive(Serialize)]
struct Times {
    robot: &'static str,
    commands: Vec<Vec<f64>>,
    settle: f64,
    /// Settling along a path across the range in 100 commands.
    follow: f64,
    jacobian: f64,
    step: f64,
    /// A step of one of a batch of rollouts, on all processors.
    rollout: f64,
    /// Pictures of a settled robot by all of its cameras, on all processors.
    render: f64,
}

fn main() {
    let times: Vec<Times> = RobotSpec::STANDARD.into_iter().map(measure).collect();
    println!("{}", serde_json::to_string(&times).expect("plain numbers"));
}

fn measure(name: &'static str) -> Times {
    let robot = Robot::load(name).expect("a standard robot");
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let commands: Vec<_> = (0..2_000).map(|_| robot.random_command(&mut rng)).collect();
    Times {
        robot: name,
        commands: commands[..3]
            .iter()
            .map(|c| c.as_slice().to_vec())
            .collect(),
        settle: settle(&robot, &commands),
        follow: follow(&robot, &commands[..20]),
        jacobian: jacobian(&robot, &commands[..200]),
        step: step(&robot),
        rollout: rollout(&robot),
        render: render(&robot, &commands[..50]),
    }
}

/// Their median (µs).
fn median_us(times: Vec<Duration>) -> f64 {
    let mut times: Vec<f64> = times
        .iter()
        .map(|time| time.as_nanos() as f64 / 1e3)
        .collect();
    median(&mut times)
}

fn settle(robot: &Robot, commands: &[Command]) -> f64 {
    let (mut settler, none) = (Settler::new(robot), Loads::default());
    let time = |command| {
        let began = Instant::now();
        black_box(settler.settle(command, &none));
        began.elapsed()
    };
    median_us(commands.iter().map(time).collect())
}

fn follow(robot: &Robot, corners: &[Command]) -> f64 {
    let (mut settler, none) = (Settler::new(robot), Loads::default());
    let mut times = Vec::new();
    for ends in corners.windows(2) {
        settler.settle(&ends[0], &none);
        for part in 1..=100 {
            let between = ends[0].as_slice().iter().zip(ends[1].as_slice());
            let values: Vec<_> = between
                .map(|(from, to)| from + (to - from) * f64::from(part) / 100.0)
                .collect();
            let command = robot.command(&values).expect("between two commands");
            let began = Instant::now();
            black_box(settler.follow(&command, &none));
            times.push(began.elapsed());
        }
    }
    median_us(times)
}

fn jacobian(robot: &Robot, commands: &[Command]) -> f64 {
    let none = Loads::default();
    let time = |command| {
        let settled = robot.settle(command, &none);
        let began = Instant::now();
        let sensitivity = robot.sensitivity(command, &none, &settled);
        black_box(
            sensitivity
                .expect("a stable equilibrium")
                .command_jacobian(),
        );
        began.elapsed()
    };
    median_us(commands.iter().map(time).collect())
}

/// A command that moves all tendons, different in each of its steps.
fn moving(robot: &Robot, steps: u32) -> Vec<Command> {
    let command = |k| {
        let pull = |t: usize| 0.02 + 0.015 * (0.01 * f64::from(k) + t as f64).sin();
        let values: Vec<_> = (0..robot.tendons().len()).map(pull).collect();
        robot.command(&values).expect("within the range")
    };
    (0..steps).map(command).collect()
}

fn step(robot: &Robot) -> f64 {
    let commands = moving(robot, 1_000);
    let mut stepper =
        Stepper::new(robot, TIMESTEP, Integrator::SemiImplicitEuler).expect("a robot that moves");
    let mut state = State::straight(robot);
    let none = Loads::default();
    let time = |_| {
        let began = Instant::now();
        for command in &commands {
            stepper.step(&mut state, command, &none).expect("a step");
        }
        began.elapsed() / 1_000
    };
    median_us((0..20).map(time).collect())
}

fn rollout(robot: &Robot) -> f64 {
    let rollout = Rollout {
        start: State::straight(robot),
        commands: moving(robot, 500),
        loads: Loads::default(),
        wrenches: Vec::new(),
    };
    let batch = vec![rollout; ROLLOUTS];
    let time = |_| {
        let began = Instant::now();
        let states = rollout_batch(robot, TIMESTEP, Integrator::SemiImplicitEuler, &batch);
        black_box(states.expect("rollouts"));
        began.elapsed() / (500 * ROLLOUTS as u32)
    };
    median_us((0..7).map(time).collect())
}

fn render(robot: &Robot, commands: &[Command]) -> f64 {
    let (cameras, none) = (Camera::placed(&robot.spec().cameras), Loads::default());
    let mut frames = Vec::new();
    let mut time = |command| {
        let settled = robot.settle(command, &none);
        let began = Instant::now();
        let visuals = Visuals::of_robot(robot, &settled, BaseVisibility::Shown);
        visuals.render_all_into(&cameras, &mut frames);
        began.elapsed()
    };
    median_us(commands.iter().map(&mut time).collect())
}
