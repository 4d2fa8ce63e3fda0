//! What the dynamics promise, checked from outside through the public interface.

mod derivatives;
mod drag;
mod gradients;
mod midpoint;
mod refusals;
mod rods;
mod servos;
mod steps;

use nalgebra::{UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::chain::Configuration;
use tdcr_sim::dynamics::State;
use tdcr_sim::robot::{Frame, Hinges, Loads, Payload, Pull, Robot, Wrench};

use crate::random_robot::{Kind, random_hinged_robot, random_robot, within};

/// A bent robot in motion.
fn random_state(robot: &Robot, rng: &mut ChaCha8Rng) -> State {
    let turn: Vec<f64> = (0..robot.dof()).map(|_| within(-0.2, 0.2, rng)).collect();
    let straight = Configuration::straight(robot);
    let mut state = State::straight(robot);
    straight.retract(robot, &turn, &mut state.configuration);
    state
        .velocity
        .iter_mut()
        .for_each(|v| *v = within(-2.0, 2.0, rng));
    // What a joint of fewer than three hinges does not have stands still.
    for (joint, disc) in robot.discs().iter().enumerate() {
        if let Some(hinges) = &disc.hinges {
            state.velocity[3 * joint + hinges.count..3 * joint + 3].fill(0.0);
        }
    }
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

/// Robots of every kind, of at least four discs, and half as many more with hinges.
fn random_robots(count: usize, rng: &mut ChaCha8Rng) -> Vec<Robot> {
    let long = |robot: &Robot| robot.discs().len() >= 4;
    let mut robots: Vec<Robot> = std::iter::repeat_with(|| random_robot(Kind::Elastic, rng))
        .filter(long)
        .take(count)
        .collect();
    // Streams of their own: the others stay as they are.
    let mut rng = ChaCha8Rng::seed_from_u64(count as u64);
    let hinged = std::iter::repeat_with(|| random_hinged_robot(Kind::Elastic, &mut rng));
    robots.extend(hinged.filter(long).take(count.div_ceil(2)));
    robots
}

/// The joint's coordinates that lead from one rotation to the other.
fn turn(
    hinges: Option<&Hinges>,
    from: &UnitQuaternion<f64>,
    to: &UnitQuaternion<f64>,
) -> Vector3<f64> {
    match hinges {
        None => (from.inverse() * to).scaled_axis(),
        Some(hinges) => hinges.angles(to) - hinges.angles(from),
    }
}

/// The turns and rates that lead from `from` to `to`.
fn difference(robot: &Robot, from: &State, to: &State) -> Vec<f64> {
    let turns = (from.configuration.0.iter().zip(&to.configuration.0))
        .zip(robot.discs())
        .flat_map(|((from, to), disc)| <[f64; 3]>::from(turn(disc.hinges.as_deref(), from, to)));
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
