//! Robots in motion among objects, which rapier moves.

mod alone;
mod dragged;
mod hostile;
mod states;
mod touched;

use tdcr_sim::contact::ContactStepper;
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::robot::{Loads, Robot};
use tdcr_sim::scene::{Obstacle, Scene};

const STEP: f64 = 2e-3;

fn among(robot: &Robot, obstacles: Vec<Obstacle>) -> ContactStepper {
    let stepper = Stepper::new(robot, STEP, Integrator::SemiImplicitEuler).unwrap();
    let scene = Scene::new(obstacles).unwrap();
    ContactStepper::new(stepper, &scene).unwrap()
}

/// The robot `2m` without gravity.
fn weightless() -> Robot {
    let mut spec = Robot::load("2m").unwrap().spec().clone();
    spec.gravity = [0.0; 3];
    Robot::new(spec).unwrap()
}

/// A command that bends `2m` towards `-x`, and one to the other side.
const LEFT: [f64; 6] = [0.034, 0.007, 0.001, 0.026, 0.015, 0.019];

/// Moves a robot for so many steps under the commands that `of` gives by the time (s), telling `seen` of each.
fn drive(
    stepper: &mut ContactStepper,
    state: &mut State,
    steps: usize,
    of: impl Fn(f64) -> Vec<f64>,
    mut seen: impl FnMut(&ContactStepper, &State),
) {
    for step in 0..steps {
        let command = of(STEP * step as f64);
        let command = stepper.robot().command(&command).unwrap();
        (stepper.step(state, &command, &Loads::default()))
            .unwrap_or_else(|error| panic!("step {step}: {error}"));
        seen(stepper, state);
    }
}

/// From the middle of all ranges to a command, in a second.
fn towards(robot: &Robot, command: &[f64]) -> impl Fn(f64) -> Vec<f64> + use<> {
    let (from, to) = (robot.mean_command().as_slice().to_vec(), command.to_vec());
    move |time| {
        let share = time.min(1.0);
        let between = from.iter().zip(&to);
        between.map(|(a, b)| a + (b - a) * share).collect()
    }
}
