//! Energy, order and rest of the integrators.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::dynamics::{DynamicsError, Integrator, Lineariser, State, Stepper};
use tdcr_sim::robot::{Backbone, Drive, Loads, Parameter, Payload, PerDisc, Robot, RobotSpec};

use super::{all_loads, dead_loads, difference, random_robots, random_state, without_kinks};
use crate::random_robot::{Kind, random_spec};

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

/// Kinetic energy from where discs and payload go in a moment, by central differences.
fn moving_masses(robot: &Robot, state: &State, payload: Payload) -> f64 {
    let size = 1e-5;
    let ahead = |sign: f64| {
        let turn: Vec<f64> = state.velocity.iter().map(|v| sign * size * v).collect();
        let mut moved = state.clone();
        state
            .configuration
            .retract(robot, &turn, &mut moved.configuration);
        let [w, x, y, z] = robot.spec().base.orientation;
        let base = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        let orientations: Vec<_> = (moved.configuration.0.iter())
            .scan(base, |below, q| {
                *below *= q;
                Some(*below)
            })
            .collect();
        (moved.positions(robot), orientations)
    };
    let (before, after) = (ahead(-1.0), ahead(1.0));
    let mut energy = 0.0;
    for (i, disc) in robot.discs().iter().enumerate() {
        let centre = |at: &(Vec<Vector3<f64>>, Vec<UnitQuaternion<f64>>)| {
            at.0[i] + at.1[i] * disc.centre_of_mass
        };
        let velocity = (centre(&after) - centre(&before)) / (2.0 * size);
        let spin = (before.1[i].inverse() * after.1[i]).scaled_axis() / (2.0 * size);
        let rate = Vector3::from_column_slice(&state.velocity[3 * i..3 * i + 3]);
        let armature = match &disc.hinges {
            None => disc.armature * rate.norm_squared(),
            Some(hinges) => rate.dot(&hinges.armature.component_mul(&rate)),
        };
        energy += 0.5 * disc.mass * velocity.norm_squared()
            + 0.5 * spin.dot(&disc.inertia.component_mul(&spin))
            + 0.5 * armature;
    }
    let tip = robot.discs().len() - 1;
    let hung = |at: &(Vec<Vector3<f64>>, Vec<UnitQuaternion<f64>>)| {
        at.0[tip] + at.1[tip] * Vector3::from(payload.offset)
    };
    let velocity = (hung(&after) - hung(&before)) / (2.0 * size);
    energy + 0.5 * payload.mass * velocity.norm_squared()
}

#[test]
fn the_kinetic_energy_is_that_of_the_moving_masses() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    for robot in random_robots(10, &mut rng) {
        let state = random_state(&robot, &mut rng);
        let payload = Payload {
            mass: 0.05,
            offset: [0.03, -0.02, 0.04],
        };
        let loads = Loads::default().with_payload(payload).unwrap();
        let command = robot.mean_command();
        let mut stepper = Stepper::new(&robot, 0.002, Integrator::default()).unwrap();
        let found = stepper.energy(&state, &command, &loads).unwrap().kinetic;
        let expected = moving_masses(&robot, &state, payload);
        assert!((found / expected - 1.0).abs() < 1e-8, "{found} {expected}");
    }
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
        assert!(coarse < 1e-6, "{coarse} J");
        assert!((coarse / fine).log2() > 3.5, "{coarse} J and {fine} J");
    }
}

#[test]
fn integrators_converge_with_their_orders() {
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
            (Integrator::ImplicitMidpoint, 2.0),
        ] {
            let errors = [1e-3, 0.5e-3].map(|h| {
                let apart = difference(&robot, &exact, &end(integrator, h));
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

#[test]
fn damping_takes_energy_at_every_step() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let mut checked = 0;
    for robot in random_robots(6, &mut rng) {
        let mut spec = robot.spec().clone();
        for module in &mut spec.modules {
            module.damping = PerDisc::Uniform(0.05);
            if let Some(PerDisc::Each(joints)) = &mut module.joint {
                let hinges = joints.iter_mut().flat_map(|joint| &mut joint.hinges);
                hinges.for_each(|hinge| hinge.damping = 0.0);
            }
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
    assert_eq!(checked, 1800);
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
            Integrator::ImplicitMidpoint,
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
            Err(error @ DynamicsError::Diverged { .. }) => {
                assert!(error.to_string().contains("implicit integrator"));
            }
            other => panic!("{explicit:?}: {other:?}"),
        }
    }
}

/// A gain of 1e7 N/m with steps of 2 ms: rates stay finite, and joints spin by many turns a step.
#[test]
fn a_motion_that_the_step_does_not_resolve_is_an_error_before_it_is_not_finite() {
    let stiff: Vec<_> = (0..6).map(|t| (Parameter::Gain(t), 1e7)).collect();
    let spec = RobotSpec::standard("2m").unwrap().with(&stiff).unwrap();
    let robot = Robot::new(spec).unwrap();
    let command = robot
        .command(&[0.03, 0.01, 0.01, 0.02, 0.02, 0.02])
        .unwrap();
    let loads = Loads::default();
    for integrator in [
        Integrator::SemiImplicitEuler,
        Integrator::RungeKutta4,
        Integrator::ImplicitEuler,
    ] {
        let mut stepper = Stepper::new(&robot, 0.002, integrator).unwrap();
        let mut state = State::straight(&robot);
        let mut steps = 0..500;
        let error = steps.find_map(|_| stepper.step(&mut state, &command, &loads).err());
        match error {
            Some(DynamicsError::Diverged {
                joint,
                turn,
                timestep,
                integrator: taken,
            }) => {
                assert!(joint < 10 && (turn > 1.0 || turn.is_nan()) && timestep == 0.002);
                assert_eq!(taken, integrator);
            }
            // What is reported as a motion is one that its steps resolve.
            None => assert_ne!(integrator, Integrator::SemiImplicitEuler),
            other => panic!("{other:?}"),
        }
        if let Some(error) = error {
            let says = error.to_string();
            assert_eq!(
                says.contains("implicit integrator"),
                integrator != Integrator::ImplicitEuler
            );
        }
    }
}

#[test]
fn a_derivative_that_is_not_finite_is_an_error() {
    let robot = Robot::load("2m").unwrap();
    let mut state = State::straight(&robot);
    state.velocity[4] = 1e200;
    let command = robot.mean_command();
    let mut lineariser = Lineariser::new(&robot, 0.002).unwrap();
    let refused = lineariser.linearise(&state, &command, &Loads::default());
    assert_eq!(refused.unwrap_err(), DynamicsError::NotDifferentiable);
}

/// The limit that a check tells is the one that steps obey: below it a motion comes to rest.
#[test]
fn steps_that_are_too_long_for_small_motions_are_told_before_they_are_taken() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.tendons.as_mut().unwrap().drive = Drive::Gain(1e7);
    }
    let robot = Robot::new(spec).unwrap();
    let command = robot
        .command(&[0.03, 0.01, 0.01, 0.02, 0.02, 0.02])
        .unwrap();
    let (state, loads) = (State::straight(&robot), Loads::default());
    for integrator in [Integrator::SemiImplicitEuler, Integrator::RungeKutta4] {
        let check = |timestep: f64| {
            let stepper = Stepper::new(&robot, timestep, integrator).unwrap();
            stepper.check_stable(&state, &command, &loads)
        };
        let Err(DynamicsError::Unstable { timestep, longest }) = check(0.002) else {
            panic!("{integrator:?} is told to be stable");
        };
        assert!(
            timestep == 0.002 && longest > 0.0 && longest < 0.002,
            "{longest}"
        );
        assert_eq!(check(0.99 * longest), Ok(()));
        assert!(check(1.01 * longest).is_err());
    }
    let implicit = Stepper::new(&robot, 0.002, Integrator::ImplicitEuler).unwrap();
    assert_eq!(implicit.check_stable(&state, &command, &loads), Ok(()));
}
