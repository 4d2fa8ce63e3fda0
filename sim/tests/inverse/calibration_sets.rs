//! Calibrations of more and of fewer unknowns, and of data that unknowns do not explain.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use tdcr_sim::inverse::calibration::{Finding, FitState, Observation, Unknown};
use tdcr_sim::robot::{Axis, Backbone, Body, Loads, Parameter, PerDisc, Robot, RobotSpec};

use super::fit;

/// Tip positions of a robot under random commands and payloads of up to 30 g, with errors (m).
fn observe(real: &RobotSpec, seed: u64, discs: &[usize], noise: f64) -> Vec<Observation> {
    let robot = Robot::new(real.clone()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let error = Normal::new(0.0, noise).unwrap();
    let mut observe = || {
        let command = robot.random_command(&mut rng);
        let loads = Loads::payload(0.03 * rng.random::<f64>()).unwrap();
        let settled = robot.settle(&command, &loads);
        let mut measure = |&disc: &usize| {
            let error = Vector3::from_fn(|_, _| error.sample(&mut rng));
            (disc, settled.positions[disc] + error)
        };
        let positions = discs.iter().map(&mut measure).collect();
        Observation {
            command,
            loads,
            positions,
        }
    };
    (0..30).map(|_| observe()).collect()
}

/// A 2m robot on a backbone of this stiffness (N m/rad), or on none.
fn nominal(stiffness: f64) -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").unwrap();
    if stiffness > 0.0 {
        for module in &mut spec.modules {
            module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(stiffness)));
        }
    }
    spec
}

/// Every gain, and every module's dimensions, density and stiffnesses.
fn unknowns(spec: &RobotSpec) -> Vec<Unknown> {
    let gains = (0..spec.tendon_count()).map(Parameter::Gain);
    let mut all: Vec<Unknown> = gains.map(Unknown::one).collect();
    all.push(Unknown::one(Parameter::HoleRadius(Body::Base)));
    for module in 0..spec.modules.len() {
        let disc = Body::Disc(5 * module);
        all.push(Unknown::one(Parameter::HoleRadius(disc)));
        all.push(Unknown::one(Parameter::Density(module)));
        all.push(Unknown::one(Parameter::Pitch(module)));
        if spec.modules[module].backbone.is_some() {
            let both = [Axis::X, Axis::Y].map(|axis| Parameter::Bending(module, axis));
            all.push(Unknown::shared("bending", both));
            all.push(Unknown::one(Parameter::Torsion(module)));
        }
    }
    all
}

/// The robot with each unknown off by a random factor of up to `exp(spread)`, lengths less so.
fn altered(spec: &RobotSpec, unknowns: &[Unknown], spread: f64, rng: &mut ChaCha8Rng) -> RobotSpec {
    let alter = |spec: RobotSpec, unknown: &Unknown| {
        let parameter = unknown.parameters()[0];
        let spread = match parameter {
            Parameter::Pitch(_) => 0.3 * spread,
            _ => spread,
        };
        let factor = ((rng.random::<f64>() * 2.0 - 1.0) * spread).exp();
        unknown
            .set(&spec, spec.value(parameter).unwrap() * factor)
            .unwrap()
    };
    unknowns.iter().fold(spec.clone(), alter)
}

/// Equilibria vanish and appear as the robot's parameters change, and a fit that follows the wrong one
/// ends in a minimum of its own. Lists in any order, of robots with and without a backbone.
fn more_unknowns_end_no_worse(trial: u64, stiffness: f64) {
    let nominal = nominal(stiffness);
    let mut rng = ChaCha8Rng::seed_from_u64(trial);
    let mut all = unknowns(&nominal);
    let real = altered(&nominal, &all, 0.5, &mut rng);
    for last in (1..all.len()).rev() {
        all.swap(last, rng.random_range(0..=last));
    }
    let observations = observe(&real, trial, &[9], 5e-4);
    let mut fewer = f64::INFINITY;
    for count in (2..=all.len()).step_by(6) {
        let found = fit(&nominal, &all[..count], &observations).unwrap();
        assert!(
            found.residual_rms <= fewer * (1.0 + 1e-9),
            "trial {trial}, {count} unknowns: {} m, {fewer} m with fewer",
            found.residual_rms
        );
        fewer = found.residual_rms;
    }
}

#[test]
fn more_unknowns_never_end_in_a_worse_fit_than_fewer() {
    more_unknowns_end_no_worse(0, 0.0);
}

#[test]
fn more_unknowns_of_a_backbone_never_end_in_a_worse_fit_than_fewer() {
    more_unknowns_end_no_worse(1, 0.02);
}

/// Sets in each other, each in an order of its own. That these fits end no worse is measured, not guaranteed.
#[test]
fn supersets_in_any_order_explain_no_less() {
    for (trial, stiffness) in [(5, 0.05), (6, 0.0)] {
        let nominal = nominal(stiffness);
        let mut rng = ChaCha8Rng::seed_from_u64(trial + 100);
        let mut all = unknowns(&nominal);
        let spread = if trial % 2 == 0 { 0.3 } else { 0.5 };
        let real = altered(&nominal, &all, spread, &mut rng);
        let mut shuffle = |list: &mut Vec<Unknown>| {
            for last in (1..list.len()).rev() {
                list.swap(last, rng.random_range(0..=last));
            }
        };
        shuffle(&mut all);
        let observations = observe(&real, trial, &[9], 5e-4);
        let mut fewer = f64::INFINITY;
        for count in [3, 8, all.len()] {
            let mut set = all[..count].to_vec();
            shuffle(&mut set);
            let found = fit(&nominal, &set, &observations).unwrap();
            assert!(
                found.residual_rms <= fewer * (1.0 + 1e-3),
                "trial {trial}, {count} unknowns: {} m, {fewer} m with fewer",
                found.residual_rms
            );
            fewer = found.residual_rms;
        }
    }
}

/// Torsion alone does not explain a robot of other dimensions: the fit runs to joints that do not twist
/// at all, which took more steps than there were, one small share of the way after another.
#[test]
fn a_stiffness_that_grows_without_end_comes_to_a_minimum() {
    let nominal = nominal(0.05);
    let all = unknowns(&nominal);
    let mut minima = 0;
    for trial in 0..6 {
        let mut rng = ChaCha8Rng::seed_from_u64(trial);
        let real = altered(&nominal, &all, 0.3, &mut rng);
        let torsion = Unknown::shared("torsion", (0..2).map(Parameter::Torsion));
        let observations = observe(&real, trial, &[4, 9], 5e-4);
        let found = fit(&nominal, &[torsion], &observations).unwrap();
        minima += usize::from(!matches!(found.state, FitState::Halted { .. }));
        if let FitState::AtBound(at) = &found.state {
            assert_eq!(at, &[0]);
            assert!(matches!(
                found.identification.findings[0],
                Finding::AtBound(_)
            ));
        }
    }
    assert!(minima >= 5, "{minima} of 6");
}
