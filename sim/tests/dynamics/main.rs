//! What the dynamics promise, checked from outside through the public interface.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod derivatives;
mod gradients;
mod midpoint;
#[path = "../common/random_robot.rs"]
mod random_robot;
mod refusals;
mod rods;
mod steps;

use rand_chacha::ChaCha8Rng;
use random_robot::{Kind, random_robot, within};
use tdcr_sim::chain::Configuration;
use tdcr_sim::dynamics::State;
use tdcr_sim::robot::{Frame, Loads, Payload, Pull, Robot, Wrench};

/// A bent robot in motion.
fn random_state(robot: &Robot, rng: &mut ChaCha8Rng) -> State {
    let turn: Vec<f64> = (0..robot.dof()).map(|_| within(-0.2, 0.2, rng)).collect();
    let straight = Configuration::straight(robot);
    let mut state = State::straight(robot);
    straight.retract(&turn, &mut state.configuration);
    state
        .velocity
        .iter_mut()
        .for_each(|v| *v = within(-2.0, 2.0, rng));
    state
}

/// A payload off the axis, a line load and a force that keeps its direction.
fn dead_loads(robot: &Robot, rng: &mut ChaCha8Rng) -> Loads {
    let mut three = |size: f64| -> [f64; 3] { std::array::from_fn(|_| within(-size, size, rng)) };
    let payload = Payload {
        mass: 0.01,
        offset: three(0.02),
    };
    let push = Wrench {
        point: three(0.03),
        force: three(0.1),
        ..Wrench::none(robot.discs().len() / 2, Frame::World)
    };
    (Loads::default().with_payload(payload).unwrap())
        .with_wrench(push)
        .unwrap()
        .with_line_load(three(0.5))
        .unwrap()
}

/// Those and wrenches without a potential.
fn all_loads(robot: &Robot, rng: &mut ChaCha8Rng) -> Loads {
    let mut loads = dead_loads(robot, rng);
    for (disc, frame) in [(1, Frame::Disc), (2, Frame::World), (3, Frame::Disc)] {
        loads = loads
            .with_wrench(Wrench {
                disc,
                point: std::array::from_fn(|_| within(-0.03, 0.03, rng)),
                force: std::array::from_fn(|_| within(-0.1, 0.1, rng)),
                moment: std::array::from_fn(|_| within(-0.01, 0.01, rng)),
                frame,
            })
            .unwrap();
    }
    loads
}

/// Robots of every kind, of at least four discs.
fn random_robots(count: usize, rng: &mut ChaCha8Rng) -> Vec<Robot> {
    std::iter::repeat_with(|| random_robot(Kind::Elastic, rng))
        .filter(|robot| robot.discs().len() >= 4)
        .take(count)
        .collect()
}

/// The turns and rates that lead from `from` to `to`.
fn difference(from: &State, to: &State) -> Vec<f64> {
    let turns = (from.configuration.0.iter().zip(&to.configuration.0))
        .flat_map(|(from, to)| <[f64; 3]>::from((from.inverse() * to).scaled_axis()));
    let rates = from.velocity.iter().zip(&to.velocity).map(|(a, b)| b - a);
    turns.chain(rates).collect()
}

/// The robot with tendons that push as they pull, and joints without limits.
fn without_kinks(robot: &Robot) -> Robot {
    let mut spec = robot.spec().clone();
    for module in &mut spec.modules {
        module.limit = None;
        if let Some(tendon) = &mut module.tendons {
            tendon.pull = Pull::Bilateral;
        }
    }
    for route in &mut spec.routes {
        route.tendon.pull = Pull::Bilateral;
    }
    Robot::new(spec).unwrap()
}
