//! What the dynamics promise, checked from outside through the public interface.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

#[path = "common/random_robot.rs"]
mod random_robot;

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use random_robot::{Kind, random_robot, random_spec, within};
use tdcr_sim::chain::Configuration;
use tdcr_sim::dynamics::{
    DynamicsError, Integrator, Lineariser, Rollout, State, Stepper, rollout_batch, rollout_gradient,
};
use tdcr_sim::robot::{
    Backbone, Command, Drive, Frame, Loads, Payload, PerDisc, Robot, RobotSpec, Wrench,
};

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

/// `state` with coordinate `index` moved by `size`.
fn nudged(state: &State, index: usize, size: f64) -> State {
    let dof = state.velocity.len();
    let mut nudged = state.clone();
    if index < dof {
        let mut turn = vec![0.0; dof];
        turn[index] = size;
        (state.configuration).retract(&turn, &mut nudged.configuration);
    } else {
        nudged.velocity[index - dof] += size;
    }
    nudged
}

fn nudged_command(robot: &Robot, command: &Command, index: usize, size: f64) -> Command {
    let mut values = command.as_slice().to_vec();
    values[index] += size;
    robot.command(&values).unwrap()
}

/// A command away from the ends of the ranges.
fn inner_command(robot: &Robot, rng: &mut ChaCha8Rng) -> Command {
    let inner = |tendon: &tdcr_sim::robot::Tendon| {
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
            let ahead = step(nudged(&state, column, size), &command);
            let back = step(nudged(&state, column, -size), &command);
            let found = linear.a.column(column);
            for (found, change) in found.iter().zip(difference(&back, &ahead)) {
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
            for (found, change) in found.iter().zip(difference(&back, &ahead)) {
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

/// The largest departure of the energy from its start along a motion in steps of `h` (s).
fn energy_drift(robot: &Robot, start: &State, loads: &Loads, h: f64) -> f64 {
    let mut stepper = Stepper::new(robot, h, Integrator::RungeKutta4).unwrap();
    let command = robot.mean_command();
    let mut state = start.clone();
    let before = stepper.energy(&state, &command, loads).unwrap();
    let (mut drift, mut exchanged) = (0.0_f64, 0.0_f64);
    for _ in 0..(0.2 / h).round() as usize {
        stepper.step(&mut state, &command, loads).unwrap();
        let now = stepper.energy(&state, &command, loads).unwrap();
        drift = drift.max((now.total() - before.total()).abs());
        exchanged = exchanged.max((now.kinetic - before.kinetic).abs());
    }
    assert!(
        before.kinetic > 0.01 && exchanged > 0.005,
        "{exchanged} of {before:?}"
    );
    drift
}

#[test]
fn without_damping_runge_kutta_keeps_the_energy_to_fourth_order() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    for _ in 0..6 {
        let mut spec = random_spec(Kind::Mujoco, &mut rng);
        for module in &mut spec.modules {
            module.damping = PerDisc::Uniform(0.0);
        }
        let robot = Robot::new(spec).unwrap();
        let start = random_state(&robot, &mut rng);
        let loads = dead_loads(&robot, &mut rng);
        let [coarse, fine] = [4e-3, 2e-3].map(|h| energy_drift(&robot, &start, &loads, h));
        assert!(coarse < 1e-7, "{coarse} J");
        assert!((coarse / fine).log2() > 3.7, "{coarse} J and {fine} J");
    }
}

#[test]
fn runge_kutta_converges_to_fourth_order_and_the_euler_methods_to_first() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for robot in random_robots(3, &mut rng) {
        let (start, loads) = (random_state(&robot, &mut rng), all_loads(&robot, &mut rng));
        let robot = without_kinks(&robot);
        let end = |integrator, h: f64| {
            let mut stepper = Stepper::new(&robot, h, integrator).unwrap();
            let mut state = start.clone();
            for _ in 0..(0.02 / h).round() as usize {
                stepper
                    .step(&mut state, &robot.mean_command(), &loads)
                    .unwrap();
            }
            state
        };
        let exact = end(Integrator::RungeKutta4, 0.5e-4);
        for (integrator, order) in [
            (Integrator::RungeKutta4, 4.0),
            (Integrator::SemiImplicitEuler, 1.0),
            (Integrator::ImplicitEuler, 1.0),
        ] {
            let errors = [1e-3, 0.5e-3].map(|h| {
                let apart = difference(&exact, &end(integrator, h));
                apart.iter().map(|d| d * d).sum::<f64>().sqrt()
            });
            let found = (errors[0] / errors[1]).log2();
            assert!(
                (found - order).abs() < 0.3,
                "{integrator:?}: order {found}, {errors:?}"
            );
        }
    }
}

/// The robot with tendons that push as they pull, and joints without limits.
fn without_kinks(robot: &Robot) -> Robot {
    let mut spec = robot.spec().clone();
    for module in &mut spec.modules {
        module.limit = None;
        if let Some(tendon) = &mut module.tendons {
            tendon.pull = tdcr_sim::robot::Pull::Bilateral;
        }
    }
    for route in &mut spec.routes {
        route.tendon.pull = tdcr_sim::robot::Pull::Bilateral;
    }
    Robot::new(spec).unwrap()
}

#[test]
fn damping_takes_energy_at_every_step() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let mut checked = 0;
    for robot in random_robots(6, &mut rng) {
        let mut spec = robot.spec().clone();
        for module in &mut spec.modules {
            module.damping = PerDisc::Uniform(0.05);
        }
        let robot = Robot::new(spec).unwrap();
        let loads = dead_loads(&robot, &mut rng);
        let command = robot.random_command(&mut rng);
        let mut state = random_state(&robot, &mut rng);
        let mut stepper = Stepper::new(&robot, 1e-4, Integrator::RungeKutta4).unwrap();
        let mut last = stepper.energy(&state, &command, &loads).unwrap().total();
        for _ in 0..200 {
            // What damping takes in a step, by the trapezoidal rule.
            let rate = |state: &State| -> f64 { state.velocity.iter().map(|v| 0.05 * v * v).sum() };
            let mut taken = rate(&state);
            stepper.step(&mut state, &command, &loads).unwrap();
            taken += rate(&state);
            let energy = stepper.energy(&state, &command, &loads).unwrap().total();
            let lost = last - energy;
            assert!(lost > 0.0);
            assert!(
                (lost / (0.5e-4 * taken) - 1.0).abs() < 0.02,
                "{lost} {taken}"
            );
            last = energy;
            checked += 1;
        }
    }
    assert_eq!(checked, 1200);
}

#[test]
fn a_settled_robot_stays_where_it_is() {
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    for name in RobotSpec::STANDARD {
        let robot = Robot::load(name).unwrap();
        let command = robot.random_command(&mut rng);
        let loads = Loads::payload(0.01).unwrap();
        let settled = robot.settle(&command, &loads);
        assert!(settled.converged);
        for integrator in [
            Integrator::SemiImplicitEuler,
            Integrator::RungeKutta4,
            Integrator::ImplicitEuler,
        ] {
            let mut stepper = Stepper::new(&robot, 0.002, integrator).unwrap();
            let mut state = State::at_rest(settled.configuration.clone());
            for _ in 0..500 {
                stepper.step(&mut state, &command, &loads).unwrap();
            }
            for (now, then) in state.positions(&robot).iter().zip(&settled.positions) {
                assert!(
                    (now - then).norm() < 1e-8,
                    "{name}, {integrator:?}: {now} {then}"
                );
            }
        }
    }
}

#[test]
fn a_moving_robot_comes_to_rest_where_the_statics_say() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.1)));
    }
    let robot = Robot::new(spec).unwrap();
    let command = robot
        .command(&[0.03, 0.02, 0.01, 0.01, 0.015, 0.02])
        .unwrap();
    let settled = robot.settle(&command, &Loads::default());
    let mut stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler).unwrap();
    let mut state = State::straight(&robot);
    for _ in 0..20_000 {
        stepper
            .step(&mut state, &command, &Loads::default())
            .unwrap();
    }
    let tip = state.positions(&robot)[9];
    assert!((tip - settled.positions[9]).norm() < 1e-9, "{tip}");
    assert!((tip - Vector3::new(0.0, 0.0, tip.z)).norm() > 0.01);
}

#[test]
fn the_implicit_integrator_holds_a_backbone_that_explicit_ones_cannot() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(5e4)));
    }
    let robot = Robot::new(spec).unwrap();
    let command = robot
        .command(&[0.03, 0.02, 0.01, 0.01, 0.015, 0.02])
        .unwrap();
    let settled = robot.settle(&command, &Loads::default());
    let end = |integrator| {
        let mut stepper = Stepper::new(&robot, 0.002, integrator).unwrap();
        let mut state = State::straight(&robot);
        for _ in 0..500 {
            stepper.step(&mut state, &command, &Loads::default())?;
        }
        Ok(state.positions(&robot)[9])
    };
    let implicit = end(Integrator::ImplicitEuler).unwrap();
    assert!(
        (implicit - settled.positions[9]).norm() < 1e-9,
        "{implicit}"
    );
    for explicit in [Integrator::SemiImplicitEuler, Integrator::RungeKutta4] {
        match end(explicit) {
            Err(DynamicsError::Diverged { timestep }) => assert_eq!(timestep, 0.002),
            Err(other) => panic!("{other}"),
            Ok(tip) => assert!(
                (tip - settled.positions[9]).norm() > 1e-3,
                "{explicit:?}: {tip}"
            ),
        }
    }
}

/// A rollout of a random robot, and the same with one number changed.
fn random_rollout(robot: &Robot, steps: usize, rng: &mut ChaCha8Rng) -> Rollout {
    Rollout {
        start: random_state(robot, rng),
        commands: (0..steps).map(|_| inner_command(robot, rng)).collect(),
        loads: all_loads(robot, rng),
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
    let gradient = rollout_gradient(&robot, h, &rollout, &states, |k, state, gradient| {
        let (turns, rates) = gradient.split_at_mut(state.velocity.len());
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
            start: nudged(&rollout.start, index, size),
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

#[test]
fn what_cannot_be_moved_is_refused_with_the_reason() {
    let robot = Robot::load("2m").unwrap();
    let refused = |robot: &Robot, h: f64| {
        Stepper::new(robot, h, Integrator::SemiImplicitEuler)
            .unwrap_err()
            .to_string()
    };
    for h in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(refused(&robot, h).contains("expected a finite number above 0"));
        assert!(Lineariser::new(&robot, h).is_err());
    }
    let mut spec = robot.spec().clone();
    spec.modules[1].tendons.as_mut().unwrap().drive = Drive::Length;
    let inextensible = Robot::new(spec).unwrap();
    assert!(refused(&inextensible, 0.002).starts_with("tendon 3 is inextensible"));
    let mut spec = robot.spec().clone();
    (spec.modules[0].damping, spec.modules[0].armature) =
        (PerDisc::Uniform(0.0), PerDisc::Uniform(0.0));
    spec.modules[0].mass = tdcr_sim::robot::MassSpec::Density(PerDisc::Uniform(0.0));
    let massless = Robot::new(spec).unwrap();
    assert!(refused(&massless, 0.002).starts_with("joint 0 has no armature"));

    let mut stepper = Stepper::new(&robot, 0.002, Integrator::SemiImplicitEuler).unwrap();
    let other = Robot::load("3m").unwrap();
    let mut try_step = |state: &State, command: &Command, loads: &Loads| {
        let mut after = state.clone();
        let message = stepper
            .step(&mut after, command, loads)
            .unwrap_err()
            .to_string();
        assert_eq!(&after, state);
        message
    };
    let (state, command, loads) = (
        State::straight(&robot),
        robot.mean_command(),
        Loads::default(),
    );
    let message = try_step(&State::straight(&other), &command, &loads);
    assert_eq!(
        message,
        "the configuration has 15 entries; robot `2m` needs 10"
    );
    let message = try_step(&state, &other.mean_command(), &loads);
    assert_eq!(message, "the command has 9 entries; robot `2m` needs 6");
    let beyond = loads.with_wrench(Wrench::none(10, Frame::World)).unwrap();
    let message = try_step(&state, &command, &beyond);
    assert!(message.starts_with("a wrench acts on disc 10"), "{message}");
}
