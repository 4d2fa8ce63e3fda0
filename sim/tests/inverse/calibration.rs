//! Robots recovered from measured positions.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use tdcr_sim::inverse::calibration::{
    Calibration, CalibrationError, Estimate, Finding, Observation, Unknown,
};
use tdcr_sim::robot::{
    Axis, Backbone, Body, Drive, Loads, MassSpec, Parameter, PerDisc, Robot, RobotSpec,
};

use super::fit;

/// Observations of a robot under random commands and random payloads of up to `payload` kg.
struct Campaign {
    count: usize,
    discs: Vec<usize>,
    payload: f64,
    /// Standard deviation of each coordinate (m).
    noise: f64,
}

impl Campaign {
    fn observe(&self, real: &RobotSpec, seed: u64) -> Vec<Observation> {
        let robot = Robot::new(real.clone()).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let error = Normal::new(0.0, self.noise).unwrap();
        let observe = |_| {
            let command = robot.random_command(&mut rng);
            let loads = Loads::payload(self.payload * rng.random::<f64>()).unwrap();
            let settled = robot.settle(&command, &loads);
            let mut measure = |&disc: &usize| {
                let error = Vector3::from_fn(|_, _| error.sample(&mut rng));
                (disc, settled.positions[disc] + error)
            };
            let positions = self.discs.iter().map(&mut measure).collect();
            Observation {
                command,
                loads,
                positions,
            }
        };
        (0..self.count).map(observe).collect()
    }
}

fn elastic(name: &str, stiffness: f64) -> RobotSpec {
    let mut spec = RobotSpec::standard(name).unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(stiffness)));
    }
    spec
}

/// A short robot of one module.
fn small() -> RobotSpec {
    let mut spec = elastic("2m", 0.3);
    spec.modules.truncate(1);
    spec.modules[0].discs = 4;
    spec
}

fn gain(spec: &RobotSpec) -> Unknown {
    Unknown::shared("gain", (0..spec.tendon_count()).map(Parameter::Gain))
}

fn bending(spec: &RobotSpec) -> Unknown {
    let both = |m| [Axis::X, Axis::Y].map(|axis| Parameter::Bending(m, axis));
    Unknown::shared("bending stiffness", (0..spec.modules.len()).flat_map(both))
}

fn torsion(spec: &RobotSpec) -> Unknown {
    Unknown::shared(
        "torsion stiffness",
        (0..spec.modules.len()).map(Parameter::Torsion),
    )
}

fn density(spec: &RobotSpec) -> Unknown {
    Unknown::shared("density", (0..spec.modules.len()).map(Parameter::Density))
}

fn hole_radius(spec: &RobotSpec) -> Unknown {
    let mut bodies = vec![Body::Base];
    let mut disc = 0;
    for module in &spec.modules {
        bodies.push(Body::Disc(disc));
        disc += module.discs;
    }
    Unknown::shared("hole radius", bodies.into_iter().map(Parameter::HoleRadius))
}

/// The robot with these values of its unknowns.
fn with(spec: &RobotSpec, values: &[(&Unknown, f64)]) -> RobotSpec {
    let set =
        |spec: RobotSpec, (unknown, value): &(&Unknown, f64)| unknown.set(&spec, *value).unwrap();
    values.iter().fold(spec.clone(), set)
}

fn estimates(found: &Calibration) -> Vec<Estimate> {
    let estimate = |finding: &Finding| match finding {
        Finding::Identified(estimate) => *estimate,
        other => panic!("{other:?}"),
    };
    found.identification.findings.iter().map(estimate).collect()
}

#[test]
fn exact_positions_give_exact_values() {
    let nominal = elastic("2m", 0.05);
    let unknowns = [
        gain(&nominal),
        bending(&nominal),
        torsion(&nominal),
        density(&nominal),
        hole_radius(&nominal),
        Unknown::one(Parameter::Pitch(1)),
    ];
    let truth = [430.0, 0.062, 0.041, 31.0, 0.0131, 0.0165];
    let values: Vec<_> = unknowns.iter().zip(truth).collect();
    let real = with(&nominal, &values);
    let campaign = Campaign {
        count: 100,
        discs: (0..10).collect(),
        payload: 0.03,
        noise: 0.0,
    };
    let found = fit(&nominal, &unknowns, &campaign.observe(&real, 81)).unwrap();
    for (estimate, truth) in estimates(&found).iter().zip(truth) {
        assert!(
            (estimate.value / truth - 1.0).abs() < 1e-6,
            "{estimate:?} {truth}"
        );
    }
    assert!(found.residual_rms < 1e-8);
    assert!((found.spec.modules[1].pitch / 0.0165 - 1.0).abs() < 1e-6);
}

/// Each hole by itself, from tip positions alone.
#[test]
fn single_holes_and_gains_are_recovered() {
    let nominal = small();
    let hole = Parameter::Hole(Body::Disc(0), 1, Axis::Y);
    let unknowns = [Unknown::one(hole), Unknown::one(Parameter::Gain(2))];
    let real = nominal
        .with(&[(hole, 0.0113), (Parameter::Gain(2), 620.0)])
        .unwrap();
    let campaign = Campaign {
        count: 30,
        discs: vec![3],
        payload: 0.03,
        noise: 0.0,
    };
    let found = fit(&nominal, &unknowns, &campaign.observe(&real, 82)).unwrap();
    for (estimate, truth) in estimates(&found).iter().zip([0.0113, 620.0]) {
        assert!(
            (estimate.value / truth - 1.0).abs() < 1e-6,
            "{estimate:?} {truth}"
        );
    }
}

/// The small robot of heavier discs, held level, so that weights bend it.
fn level() -> RobotSpec {
    let mut spec = small();
    spec.gravity = [9.81, 0.0, 0.0];
    spec.modules[0].mass = MassSpec::Density(PerDisc::Uniform(2500.0));
    spec
}

/// Of 400 intervals at 95 %, 20 do not hold the true value on average, and 8 to 35 in all but one of a
/// thousand experiments like this (binomial).
#[test]
fn intervals_hold_the_truth_as_often_as_they_say() {
    let nominal = level();
    let unknowns = [
        gain(&nominal),
        bending(&nominal),
        hole_radius(&nominal),
        density(&nominal),
    ];
    let truth = [450.0, 0.35, 0.0130, 2800.0];
    let values: Vec<_> = unknowns.iter().zip(truth).collect();
    let real = with(&nominal, &values);
    let campaign = Campaign {
        count: 20,
        discs: vec![1, 3],
        payload: 0.5,
        noise: 5e-4,
    };
    let mut outside = 0;
    let mut squares = [0.0; 4];
    for seed in 0..50 {
        let found = fit(&nominal, &unknowns, &campaign.observe(&real, 1000 + seed)).unwrap();
        assert!((found.identification.noise / 5e-4 - 1.0).abs() < 0.3);
        for (i, estimate) in estimates(&found).iter().enumerate() {
            let [low, high] = estimate.interval;
            outside += usize::from(!(low..=high).contains(&truth[i]));
            squares[i] += ((estimate.value - truth[i]) / estimate.standard_error).powi(2);
        }
    }
    assert!((3..=21).contains(&outside), "{outside} of 200");
    // Chi-squared of 50 degrees of freedom, 99.95 % on either side.
    assert!(
        squares.iter().all(|s| (23.4..=89.6).contains(s)),
        "{squares:?}"
    );
}

/// All energies but the weight's scale with the gain, so without a known payload only its ratio to the
/// density can be told; a known payload tells both.
#[test]
fn what_cannot_be_told_apart_is_named() {
    let nominal = RobotSpec::standard("2m").unwrap();
    let unknowns = [gain(&nominal), hole_radius(&nominal), density(&nominal)];
    let real = with(
        &nominal,
        &[
            (&unknowns[0], 430.0),
            (&unknowns[1], 0.013),
            (&unknowns[2], 30.0),
        ],
    );
    for noise in [0.0, 5e-4] {
        let bare = Campaign {
            count: 60,
            discs: vec![4, 9],
            payload: 0.0,
            noise,
        };
        let found = fit(&nominal, &unknowns, &bare.observe(&real, 83)).unwrap();
        let findings = &found.identification.findings;
        assert_eq!(findings[0], Finding::Confounded { with: vec![2] });
        assert_eq!(findings[2], Finding::Confounded { with: vec![0] });
        let Finding::Identified(radius) = findings[1] else {
            panic!("{findings:?}");
        };
        assert!((radius.value - 0.013).abs() <= 4.0 * radius.standard_error + 1e-8);
        let ratio = found.spec.value(Parameter::Gain(0)).unwrap()
            / found.spec.value(Parameter::Density(0)).unwrap();
        assert!((ratio / (430.0 / 30.0) - 1.0).abs() < 0.1, "{ratio}");
        let loaded = Campaign {
            payload: 0.03,
            ..bare
        };
        let found = fit(&nominal, &unknowns, &loaded.observe(&real, 83)).unwrap();
        for (estimate, truth) in estimates(&found).iter().zip([430.0, 0.013, 30.0]) {
            let error = (estimate.value - truth).abs();
            assert!(
                error <= 4.0 * estimate.standard_error + 1e-6 * truth,
                "{estimate:?} {truth}"
            );
        }
    }
}

#[test]
fn what_was_not_seen_is_said_to_have_no_effect() {
    let mut nominal = small();
    nominal.gravity = [0.0; 3];
    let unknowns = [bending(&nominal), density(&nominal)];
    let campaign = Campaign {
        count: 10,
        discs: vec![3],
        payload: 0.0,
        noise: 5e-4,
    };
    let found = fit(&nominal, &unknowns, &campaign.observe(&nominal, 84)).unwrap();
    assert!(matches!(
        found.identification.findings[0],
        Finding::Identified(_)
    ));
    assert_eq!(found.identification.findings[1], Finding::NoEffect);
}

/// A disc of this robot weighs half a gram: nothing to be seen of under errors of 5 mm.
#[test]
fn what_is_lost_in_the_noise_is_said_to_be_undetermined() {
    let nominal = small();
    let unknowns = [density(&nominal)];
    let campaign = Campaign {
        count: 20,
        discs: vec![3],
        payload: 0.0,
        noise: 5e-3,
    };
    let (mut undetermined, mut identified) = (0, 0);
    for seed in 0..20 {
        let observations = campaign.observe(&nominal, 200 + seed);
        let found = fit(&nominal, &unknowns, &observations).unwrap();
        match found.identification.findings[0] {
            Finding::Undetermined { standard_error } => {
                assert!(standard_error > 25.0);
                undetermined += 1;
            }
            // At 95 %, one in forty estimates of nothing looks like something.
            Finding::Identified(_) => identified += 1,
            Finding::AtBound(value) => assert_eq!(value, 0.0),
            ref other => panic!("{other:?}"),
        }
    }
    assert!(
        undetermined >= 5 && identified <= 2,
        "{undetermined} {identified}"
    );
}

/// Positions of a robot that is lighter than weightless.
#[test]
fn a_fit_at_the_bound_says_so() {
    let nominal = small();
    let campaign = Campaign {
        count: 10,
        discs: vec![3],
        payload: 0.0,
        noise: 0.0,
    };
    let mut observations = campaign.observe(&nominal, 86);
    let robot = Robot::new(nominal.clone()).unwrap();
    for observation in &mut observations {
        let lifted = observation
            .loads
            .clone()
            .with_line_load([0.0, 0.0, 1.0])
            .unwrap();
        observation.positions[0].1 = robot.settle(&observation.command, &lifted).positions[3];
    }
    let found = fit(&nominal, &[density(&nominal)], &observations).unwrap();
    assert_eq!(found.identification.findings, [Finding::AtBound(0.0)]);
}

#[test]
fn results_do_not_depend_on_threads() {
    let nominal = small();
    let unknowns = [gain(&nominal), bending(&nominal)];
    let campaign = Campaign {
        count: 8,
        discs: vec![3],
        payload: 0.1,
        noise: 5e-4,
    };
    let observations = campaign.observe(&nominal, 87);
    let [one, many] = [1, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| fit(&nominal, &unknowns, &observations))
            .unwrap()
    });
    assert_eq!(one.spec, many.spec);
    assert_eq!(one.identification, many.identification);
}

#[test]
fn input_that_makes_no_sense_is_refused() {
    let nominal = small();
    let campaign = Campaign {
        count: 4,
        discs: vec![3],
        payload: 0.0,
        noise: 0.0,
    };
    let observations = campaign.observe(&nominal, 88);
    let refusal = |unknowns: &[Unknown], observations: &[Observation]| {
        fit(&nominal, unknowns, observations).unwrap_err()
    };
    assert!(matches!(
        refusal(&[], &observations),
        CalibrationError::NoUnknown
    ));
    let gain_twice = [gain(&nominal), Unknown::one(Parameter::Gain(1))];
    let error = refusal(&gain_twice, &observations).to_string();
    assert!(error.contains("`gain` and `gain of tendon 1`"), "{error}");
    let hole = Unknown::one(Parameter::Hole(Body::Disc(2), 0, Axis::X));
    let radius = Unknown::one(Parameter::HoleRadius(Body::Disc(0)));
    assert!(matches!(
        refusal(&[radius, hole], &observations),
        CalibrationError::Overlap(..)
    ));
    let error = refusal(&[gain(&nominal)], &[]);
    assert!(matches!(
        error,
        CalibrationError::TooFew {
            coordinates: 0,
            priors: 0,
            unknowns: 1
        }
    ));
    for wrong in [Parameter::Payload, Parameter::AxialStiffness(0)] {
        let error = refusal(&[Unknown::one(wrong)], &observations);
        assert!(matches!(error, CalibrationError::Parameter(_)), "{error}");
    }
    let mut strange = observations.clone();
    strange[2].positions[0].0 = 4;
    let error = refusal(&[gain(&nominal)], &strange).to_string();
    assert!(
        error.starts_with("observation 2 measures disc 4"),
        "{error}"
    );
    let mut foreign = observations;
    foreign[1].command = Robot::load("2m").unwrap().mean_command();
    let error = refusal(&[gain(&nominal)], &foreign).to_string();
    assert!(
        error.starts_with("observation 1: the command has 6 entries"),
        "{error}"
    );
}

/// One tendon of a module alone: the module's tendons get routes of their own, and nothing else changes.
#[test]
fn a_single_tendon_can_be_changed() {
    let nominal = RobotSpec::standard("2m").unwrap();
    let one = nominal.with(&[(Parameter::Gain(4), 600.0)]).unwrap();
    let gains: Vec<_> = Robot::new(one.clone())
        .unwrap()
        .tendons()
        .iter()
        .map(|t| t.drive)
        .collect();
    let mut expected = [Drive::Gain(500.0); 6];
    expected[4] = Drive::Gain(600.0);
    assert_eq!(gains, expected);
    let back = one.with(&[(Parameter::Gain(4), 500.0)]).unwrap();
    let [a, b] = [nominal.clone(), back].map(|spec| {
        let robot = Robot::new(spec).unwrap();
        let command = robot
            .command(&[0.034, 0.007, 0.001, 0.026, 0.015, 0.019])
            .unwrap();
        robot.settle(&command, &Loads::default())
    });
    assert_eq!(a, b);
    let all: Vec<_> = (0..6).map(|t| (Parameter::Gain(t), 450.0)).collect();
    let softer = nominal.with(&all).unwrap();
    assert!(softer.routes.is_empty());
    assert_eq!(softer.value(Parameter::Gain(5)).unwrap(), 450.0);
}
