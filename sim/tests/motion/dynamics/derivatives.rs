//! Derivatives of steps and motions.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::dynamics::{
    Integrator, Lineariser, Rollout, State, Stepper, rollout_batch, rollout_gradient,
};
use tdcr_sim::robot::{Command, Robot, Tendon};

use super::{all_loads, difference, random_robots, random_state, without_kinks};
use crate::random_robot::within;

/// `state` with coordinate `index` moved by `size`.
pub fn nudged(robot: &Robot, state: &State, index: usize, size: f64) -> State {
    let dof = state.velocity.len();
    let mut nudged = state.clone();
    if index < dof {
        let mut turn = vec![0.0; dof];
        turn[index] = size;
        (state.configuration).retract(robot, &turn, &mut nudged.configuration);
    } else {
        nudged.velocity[index - dof] += size;
    }
    nudged
}

pub fn nudged_command(robot: &Robot, command: &Command, index: usize, size: f64) -> Command {
    let mut values = command.as_slice().to_vec();
    values[index] += size;
    robot.command(&values).unwrap()
}

/// A command away from the ends of the ranges.
pub fn inner_command(robot: &Robot, rng: &mut ChaCha8Rng) -> Command {
    let inner = |tendon: &Tendon| {
        let [low, high] = tendon.range;
        low + (high - low) * within(0.1, 0.9, rng)
    };
    let values: Vec<f64> = robot.tendons().iter().map(inner).collect();
    robot.command(&values).unwrap()
}

#[test]
fn the_linearisation_is_the_central_difference_of_a_step() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for robot in random_robots(10, &mut rng) {
        let state = random_state(&robot, &mut rng);
        let command = inner_command(&robot, &mut rng);
        let loads = all_loads(&robot, &mut rng);
        let h = 0.004;
        let mut lineariser = Lineariser::new(&robot, h).unwrap();
        let linear = lineariser.linearise(&state, &command, &loads).unwrap();
        let mut stepper = Stepper::new(&robot, h, Integrator::SemiImplicitEuler).unwrap();
        let mut step = |state: State, command: &Command| {
            let mut state = state;
            stepper.step(&mut state, command, &loads).unwrap();
            state
        };
        let size = 1e-5;
        let mut worst = [0.0_f64; 2];
        for column in 0..2 * robot.dof() {
            let ahead = step(nudged(&robot, &state, column, size), &command);
            let back = step(nudged(&robot, &state, column, -size), &command);
            let found = linear.a.column(column);
            for (found, change) in found.iter().zip(difference(&robot, &back, &ahead)) {
                worst[0] = worst[0].max((found - change / (2.0 * size)).abs());
            }
        }
        for column in 0..robot.tendons().len() {
            let ahead = step(
                state.clone(),
                &nudged_command(&robot, &command, column, size),
            );
            let back = step(
                state.clone(),
                &nudged_command(&robot, &command, column, -size),
            );
            let found = linear.b.column(column);
            for (found, change) in found.iter().zip(difference(&robot, &back, &ahead)) {
                worst[1] = worst[1].max((found - change / (2.0 * size)).abs());
            }
        }
        let relative = [worst[0] / linear.a.amax(), worst[1] / linear.b.amax()];
        assert!(
            relative.iter().all(|r| *r < 1e-8),
            "off by {relative:?} of the largest entry"
        );
    }
}

/// A motion under random commands.
pub fn random_rollout(robot: &Robot, steps: usize, rng: &mut ChaCha8Rng) -> Rollout {
    Rollout {
        start: random_state(robot, rng),
        commands: (0..steps).map(|_| inner_command(robot, rng)).collect(),
        loads: all_loads(robot, rng),
        wrenches: Vec::new(),
    }
}

#[test]
fn the_adjoint_is_the_central_difference_of_the_cost() {
    let mut rng = ChaCha8Rng::seed_from_u64(31);
    let robot = random_robots(1, &mut rng).remove(0);
    let robot = without_kinks(&robot);
    let (h, steps) = (0.002, 25);
    let rollout = random_rollout(&robot, steps, &mut rng);
    let mut stepper = Stepper::new(&robot, h, Integrator::SemiImplicitEuler).unwrap();
    let states = stepper.rollout(&rollout).unwrap();
    // A running cost of the rates, and one of the distance to a posture at the end.
    let goal = random_state(&robot, &mut rng);
    let mut cost = |rollout: &Rollout| -> f64 {
        let states = stepper.rollout(rollout).unwrap();
        let running: f64 = (std::iter::once(&rollout.start).chain(&states))
            .map(|state| state.velocity.iter().map(|v| 0.5 * v * v).sum::<f64>())
            .sum();
        let apart = states[steps - 1]
            .configuration
            .0
            .iter()
            .zip(&goal.configuration.0);
        running
            + apart
                .map(|(q, goal)| 100.0 * (1.0 - q.coords.dot(&goal.coords).powi(2)))
                .sum::<f64>()
    };
    let gradient = rollout_gradient(&robot, h, &rollout, &states, &[], |k, state, gradient| {
        let (turns, rates) = gradient.coordinates.split_at_mut(state.velocity.len());
        for (g, v) in rates.iter_mut().zip(&state.velocity) {
            *g += v;
        }
        if k == steps {
            let joints = state.configuration.0.iter().zip(&goal.configuration.0);
            for (g, (q, goal)) in turns.chunks_exact_mut(3).zip(joints) {
                // d/dxi of q exp(xi) is q (0, xi / 2).
                let dot = q.coords.dot(&goal.coords);
                let along = (q.quaternion().conjugate() * goal.quaternion()).imag() * 0.5;
                for axis in 0..3 {
                    g[axis] -= 200.0 * dot * along[axis];
                }
            }
        }
    })
    .unwrap();
    let size = 1e-5;
    let mut check = |found: f64, moved: &dyn Fn(f64) -> Rollout, scale: f64| {
        let change = (cost(&moved(size)) - cost(&moved(-size))) / (2.0 * size);
        assert!(
            (found - change).abs() < 1e-6 * scale,
            "{found} {change} of {scale}"
        );
    };
    let largest = |values: &[f64]| values.iter().fold(0.0, |l: f64, v| l.max(v.abs()));
    let scale = largest(&gradient.start);
    for (index, found) in gradient.start.iter().enumerate() {
        let moved = |size| Rollout {
            start: nudged(&robot, &rollout.start, index, size),
            ..rollout.clone()
        };
        check(*found, &moved, scale);
    }
    let scale = largest(&gradient.commands.concat());
    assert!(scale > 0.0);
    for step in [0, 1, 12, steps - 1] {
        for (tendon, found) in gradient.commands[step].iter().enumerate() {
            let moved = |size| {
                let mut moved = rollout.clone();
                moved.commands[step] =
                    nudged_command(&robot, &rollout.commands[step], tendon, size);
                moved
            };
            check(*found, &moved, scale);
        }
    }
}

#[test]
fn rollouts_do_not_depend_on_the_threads() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let robot = Robot::load("3m").unwrap();
    let rollouts: Vec<_> = (0..7)
        .map(|_| random_rollout(&robot, 40, &mut rng))
        .collect();
    let on_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| rollout_batch(&robot, 0.002, Integrator::SemiImplicitEuler, &rollouts))
            .unwrap()
    };
    let one = on_threads(1);
    assert_eq!(one, on_threads(3));
    for (rollout, states) in rollouts.iter().zip(&one) {
        let mut state = rollout.start.clone();
        let mut stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler).unwrap();
        for (command, expected) in rollout.commands.iter().zip(states) {
            stepper.step(&mut state, command, &rollout.loads).unwrap();
            assert_eq!(&state, expected);
        }
    }
}
