//! Rods in motion: frequencies and internal damping against closed forms.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};
use std::path::Path;

use nalgebra::{DMatrix, DVector};
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::robot::{Loads, Robot, RobotSpec};

const LENGTH: f64 = 0.6;
const RADIUS: f64 = 8e-4;
const YOUNGS: f64 = 200e9;
const POISSON: f64 = 0.33;
const DENSITY: f64 = 7870.0;

/// A clamped steel rod without weight, its relaxation times in bending and torsion (s); discs without mass, joints with an
/// armature (kg m²).
pub fn rod(discs: usize, [bending, torsion]: [f64; 2], armature: f64) -> Robot {
    let spec = format!(
        "name = \"rod\"
        gravity = [0.0, 0.0, 0.0]
        routing = \"base\"
        base = {{ position = [0.0, 0.0, 0.0], holes = [], hole_height = 0.0 }}
        [[modules]]
        discs = {discs}
        length = {LENGTH}
        joint_below = {}
        radius = 0.0008
        half_height = 0.001
        mass = {{ density = 0.0 }}
        holes = []
        damping = 0.0
        armature = {armature:?}
        [modules.rod]
        youngs = {YOUNGS:?}
        poisson = {POISSON}
        radius = {RADIUS}
        density = {DENSITY:?}
        damping = {{ bending = {bending:?}, torsion = {torsion:?} }}",
        LENGTH / discs as f64 / 2.0
    );
    Robot::new(RobotSpec::from_toml(&spec, Path::new("robot.toml")).unwrap()).unwrap()
}

/// Angular frequencies (rad/s), from below, and modes of the straight rod: `K x = omega² M x`, `K` diagonal.
fn modes(robot: &Robot) -> Vec<(f64, DVector<f64>)> {
    let straight = State::straight(robot);
    let mass = (robot.motion_terms(&straight, &Loads::default()).unwrap()).mass;
    let soft: Vec<f64> = (robot.discs().iter())
        .flat_map(|disc| {
            let joint = disc.backbone.unwrap();
            [joint.bending[0], joint.bending[1], joint.torsion].map(|k| 1.0 / k.sqrt())
        })
        .collect();
    let soft = DMatrix::from_diagonal(&DVector::from_vec(soft));
    let eigen = (&soft * mass * &soft).symmetric_eigen();
    let mut modes: Vec<_> = (eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter()))
    .map(|(value, vector)| (1.0 / value.sqrt(), &soft * vector))
    .collect();
    modes.sort_by(|a, b| a.0.total_cmp(&b.0));
    modes
}

/// Whether a mode is of torsion.
fn is_twist(mode: &DVector<f64>) -> bool {
    let about_z: f64 = mode.iter().skip(2).step_by(3).map(|x| x * x).sum();
    about_z > 0.5 * mode.norm_squared()
}

/// Euler and Bernoulli's cantilever, `omega = beta² sqrt(E I / (rho A)) / L²`, and `omega = pi / 2 sqrt(G / rho) / L` in
/// torsion.
#[test]
fn a_rods_first_frequencies_are_those_of_a_cantilever() {
    let section = FRAC_PI_4 * RADIUS.powi(4) / (PI * RADIUS * RADIUS);
    let wave = (YOUNGS * section / DENSITY).sqrt() / LENGTH.powi(2);
    let shear = YOUNGS / (2.0 * (1.0 + POISSON));
    let twist = FRAC_PI_2 * (shear / DENSITY).sqrt() / LENGTH;
    let errors = [25, 50].map(|discs| {
        let modes = modes(&rod(discs, [0.0; 2], 0.0));
        let bending: Vec<f64> = (modes.iter().filter(|mode| !is_twist(&mode.1)))
            .step_by(2)
            .map(|mode| mode.0)
            .collect();
        let exact = [1.875_104_07, 4.694_091_13, 7.854_757_44].map(|beta: f64| beta * beta * wave);
        let mut errors: Vec<f64> = (bending.iter().zip(exact))
            .map(|(found, exact)| (found / exact - 1.0).abs())
            .collect();
        let first = modes.iter().find(|mode| is_twist(&mode.1)).unwrap().0;
        errors.push((first / twist - 1.0).abs());
        assert!(errors.iter().all(|error| *error < 0.01), "{errors:?}");
        errors
    });
    for (coarse, fine) in errors[0].iter().zip(&errors[1]) {
        assert!(coarse / fine > 3.5, "{errors:?}");
    }
}

/// Each mode is a damped oscillator, its damping ratio `tau omega / 2`.
#[test]
fn a_rod_is_damped_in_proportion_to_its_stiffness_in_bending_and_torsion_apart() {
    let times = [2e-3, 3e-6];
    let robot = rod(16, times, 0.0);
    let modes = modes(&robot);
    let bending = modes
        .iter()
        .filter(|mode| !is_twist(&mode.1))
        .step_by(2)
        .take(2);
    let twist = modes.iter().filter(|mode| is_twist(&mode.1)).take(2);
    for (omega, mode) in bending.chain(twist) {
        let ratio = times[usize::from(is_twist(mode))] * omega / 2.0;
        assert!((1e-3..0.9).contains(&ratio), "{ratio}");
        let h = TAU / omega / 400.0;
        let mut stepper = Stepper::new(&robot, h, Integrator::ImplicitMidpoint).unwrap();
        let mut state = State::straight(&robot);
        // Small enough for the modes to stay apart.
        let size = 1e-4 * omega / mode.amax();
        state.velocity.copy_from_slice((mode * size).as_slice());
        let command = robot.mean_command();
        let damped = omega * (1.0 - ratio * ratio).sqrt();
        for step in 1..=800 {
            stepper
                .step(&mut state, &command, &Loads::default())
                .unwrap();
            let time = h * f64::from(step);
            let expected = (-ratio * omega * time).exp() * (damped * time).sin() / damped * size;
            let turns =
                (state.configuration.0.iter()).flat_map(|q| <[f64; 3]>::from(q.scaled_axis()));
            for (found, shape) in turns.zip(mode.iter()) {
                let error = (found - expected * shape).abs();
                assert!(error < 2e-7, "{omega}: {found} {}", expected * shape);
            }
        }
    }
}

/// The energy that the damping takes is `sum tau K rate²`, with explicit and implicit steps alike.
#[test]
fn damping_takes_the_energy_that_it_should() {
    let robot = rod(6, [1e-3, 4e-4], 1e-6);
    let command = robot.mean_command();
    let damping: Vec<f64> = (robot.discs().iter())
        .flat_map(|disc| {
            let joint = disc.backbone.unwrap();
            let alike = disc.extra_damping.add_scalar(disc.damping);
            let [x, y] = joint.bending;
            let expected = [1e-3 * x, 1e-3 * y, 4e-4 * joint.torsion];
            for (found, expected) in alike.iter().zip(expected) {
                assert!((found / expected - 1.0).abs() < 1e-12);
            }
            expected
        })
        .collect();
    for (integrator, h) in [
        (Integrator::RungeKutta4, 2e-6),
        (Integrator::SemiImplicitEuler, 2e-7),
        (Integrator::ImplicitEuler, 2e-7),
        (Integrator::ImplicitMidpoint, 1e-5),
    ] {
        let mut state = State::straight(&robot);
        for (i, rate) in state.velocity.iter_mut().enumerate() {
            *rate = (1.7 * i as f64).cos();
        }
        let mut stepper = Stepper::new(&robot, h, integrator).unwrap();
        let mut energy = |state: &State| {
            let stepper = &mut stepper;
            stepper
                .energy(state, &command, &Loads::default())
                .unwrap()
                .total()
        };
        let rate = |state: &State| -> f64 {
            let pairs = state.velocity.iter().zip(&damping);
            pairs.map(|(v, d)| d * v * v).sum()
        };
        let before = energy(&state);
        let mut taken = 0.0;
        let mut steps = Stepper::new(&robot, h, integrator).unwrap();
        for _ in 0..(2e-3 / h).round() as usize {
            taken += 0.5 * h * rate(&state);
            steps.step(&mut state, &command, &Loads::default()).unwrap();
            taken += 0.5 * h * rate(&state);
        }
        let lost = before - energy(&state);
        assert!(lost > 0.01 * before, "{integrator:?}: {lost} of {before}");
        assert!(
            (lost / taken - 1.0).abs() < 0.01,
            "{integrator:?}: {lost} {taken}"
        );
    }
}
