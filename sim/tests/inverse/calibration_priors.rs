//! Calibrations beside what is known of the unknowns before.

use nalgebra::{Matrix2, RowVector2, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use tdcr_sim::inverse::calibration::{
    Calibration, CalibrationError, CalibrationSettings, Estimate, Finding, FitState, Observation,
    Unknown, calibrate,
};
use tdcr_sim::inverse::{Prior, Priors};
use tdcr_sim::robot::{Backbone, Loads, Parameter, PerDisc, Robot, RobotSpec};

/// Errors of measurement (m).
const ERROR: f64 = 4e-4;

/// A robot of two modules that stands straight without gravity: its tip is at a height that is linear in the pitches.
fn straight() -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.gravity = [0.0; 3];
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.3)));
    }
    spec
}

fn place(spec: &RobotSpec, disc: usize) -> Vector3<f64> {
    let robot = Robot::new(spec.clone()).unwrap();
    robot
        .settle(&robot.mean_command(), &Loads::default())
        .positions[disc]
}

/// The disc of the straight robot off by each of these heights (m), and a bit sideways.
fn heights(spec: &RobotSpec, disc: usize, off: &[f64]) -> Vec<Observation> {
    let command = Robot::new(spec.clone()).unwrap().mean_command();
    let there = place(spec, disc);
    let observe = |(k, &off): (usize, &f64)| Observation {
        command: command.clone(),
        loads: Loads::default(),
        positions: vec![(disc, there + Vector3::new(1e-4 * k as f64, -2e-4, off))],
    };
    off.iter().enumerate().map(observe).collect()
}

fn pitches() -> [Unknown; 2] {
    [0, 1].map(|module| {
        Unknown::shared(
            ["lower pitch", "upper pitch"][module],
            [Parameter::Pitch(module)],
        )
    })
}

fn normal(value: f64, spread: f64) -> Prior {
    Prior {
        value: Some(value),
        spread: Some(spread),
        ..Prior::default()
    }
}

fn known<const N: usize>(entries: [(&str, Prior); N]) -> CalibrationSettings {
    let entries = entries.map(|(name, prior)| (name.to_owned(), prior));
    CalibrationSettings {
        priors: Priors(entries.into()),
        error: Some(ERROR),
    }
}

fn estimate(found: &Calibration, unknown: usize) -> Estimate {
    match found.identification.findings[unknown] {
        Finding::Identified(estimate) => estimate,
        ref other => panic!("{other:?}"),
    }
}

fn near(found: f64, expected: f64, share: f64) {
    let error = (found / expected - 1.0).abs();
    assert!(error < share, "{found}, expected {expected}");
}

/// Mean and covariance of the posterior of a linear model with normal errors and priors (Bishop, Pattern Recognition and Machine
/// Learning, 2006, Eqs. 3.50 and 3.51). The height of a disc is linear in the pitches.
fn posterior(
    spec: &RobotSpec,
    disc: usize,
    off: &[f64],
    priors: [Option<(f64, f64)>; 2],
) -> (Vector2<f64>, Matrix2<f64>) {
    let first = Vector2::new(spec.modules[0].pitch, spec.modules[1].pitch);
    let there = place(spec, disc).z;
    let slope = RowVector2::from_fn(|_, module| {
        let mut changed = spec.clone();
        changed.modules[module].pitch += 1e-3;
        (place(&changed, disc).z - there) / 1e-3
    });
    let mut information = Matrix2::zeros();
    let mut weighted = Vector2::zeros();
    for off in off {
        information += slope.transpose() * slope / ERROR.powi(2);
        // As if the whole height were measured, not its change.
        weighted += slope.transpose() * (off + (slope * first)[0]) / ERROR.powi(2);
    }
    for (module, prior) in priors.iter().enumerate() {
        if let Some((mean, spread)) = prior {
            information[(module, module)] += spread.powi(-2);
            weighted[module] += mean * spread.powi(-2);
        }
    }
    let covariance = information.try_inverse().unwrap();
    (covariance * weighted, covariance)
}

/// Two unknowns of which the tip says only the sum: a prior of one makes both identifiable.
#[test]
fn values_and_errors_are_those_of_the_linear_gaussian_posterior() {
    let nominal = straight();
    let off = [2e-3, 1.5e-3, 2.4e-3, 1.8e-3, 2.2e-3];
    let observations = heights(&nominal, 9, &off);
    let unknowns = pitches();
    let alone = calibrate(
        &nominal,
        &unknowns,
        &observations,
        &CalibrationSettings::default(),
    )
    .unwrap();
    for (place, other) in [(0, 1), (1, 0)] {
        let confounded = Finding::Confounded { with: vec![other] };
        assert_eq!(alone.identification.findings[place], confounded);
    }
    let (lower, upper) = ((0.0172, 1e-4), (0.0169, 3e-4));
    for priors in [[Some(lower), None], [Some(lower), Some(upper)]] {
        let mut settings = known([("lower pitch", normal(lower.0, lower.1))]);
        if let Some((mean, spread)) = priors[1] {
            let entries = &mut settings.priors.0;
            entries.insert("upper pitch".to_owned(), normal(mean, spread));
        }
        let found = calibrate(&nominal, &unknowns, &observations, &settings).unwrap();
        assert_eq!(found.state, FitState::Converged);
        let (mean, covariance) = posterior(&nominal, 9, &off, priors);
        for unknown in 0..2 {
            let estimate = estimate(&found, unknown);
            let deviation = covariance[(unknown, unknown)].sqrt();
            near(estimate.value, mean[unknown], 1e-7);
            near(estimate.standard_error, deviation, 1e-6);
            let width = 1.959963984540054 * deviation;
            near(estimate.interval[0], mean[unknown] - width, 1e-6);
            near(estimate.interval[1], mean[unknown] + width, 1e-6);
            // The tip tells the sum: of the lower pitch, with a prior of its own alone, nothing.
            let own = priors[unknown].is_some_and(|(_, spread)| deviation > 0.7 * spread);
            assert_eq!(estimate.prior_only, own);
        }
        let both = covariance[(0, 1)] / (covariance[(0, 0)] * covariance[(1, 1)]).sqrt();
        near(found.identification.correlations[(0, 1)], both, 1e-6);
        // Rows of measurements and of priors, less two directions; residuals of all of them.
        let count = priors.iter().flatten().count();
        assert_eq!(found.identification.degrees_of_freedom, 15 + count - 2);
        let spec = nominal
            .with(&[
                (Parameter::Pitch(0), mean[0]),
                (Parameter::Pitch(1), mean[1]),
            ])
            .unwrap();
        let there = place(&spec, 9);
        let misses = observations.iter().map(|o| there - o.positions[0].1);
        let squares: f64 = misses.map(|miss| miss.norm_squared()).sum();
        near(found.residual_rms, (squares / 15.0).sqrt(), 1e-6);
        let beliefs = priors.iter().zip(&mean).filter_map(|(prior, value)| {
            let (mean, spread) = (*prior)?;
            Some((ERROR * (value - mean) / spread).powi(2))
        });
        let all = squares + beliefs.sum::<f64>();
        let noise = (all / (13 + count) as f64).sqrt();
        near(found.identification.noise, noise, 1e-6);
    }
}

/// One pitch, of which a disc of the lower module tells all.
#[test]
fn a_sure_prior_holds_its_value_and_an_unsure_one_changes_nothing() {
    let nominal = straight();
    let [lower, _] = pitches();
    let off = [2e-3, 1.5e-3, 2.4e-3];
    let observations = heights(&nominal, 4, &off);
    let fit = |settings: &CalibrationSettings| {
        calibrate(
            &nominal,
            std::slice::from_ref(&lower),
            &observations,
            settings,
        )
        .unwrap()
    };
    let stated = CalibrationSettings {
        error: Some(ERROR),
        ..CalibrationSettings::default()
    };
    let free = estimate(&fit(&stated), 0);
    assert!((free.value - 0.0175).abs() < 1e-4, "{free:?}");
    for spread in [1e-12, 1e-9, 1e-300] {
        let found = fit(&known([("lower pitch", normal(0.018, spread))]));
        assert_eq!(found.state, FitState::Converged);
        let held = estimate(&found, 0);
        near(held.value, 0.018, 1e-7);
        assert!(held.prior_only && held.standard_error < 1e-7, "{held:?}");
    }
    for spread in [1e6, 1e300] {
        let unsure = estimate(&fit(&known([("lower pitch", normal(0.018, spread))])), 0);
        near(unsure.value, free.value, 1e-9);
        near(unsure.standard_error, free.standard_error, 1e-9);
        assert!(!unsure.prior_only);
    }
    // Errors that nobody makes end, too.
    for error in [1e-300, 1e300] {
        let mut settings = known([("lower pitch", normal(0.018, 1e-3))]);
        settings.error = Some(error);
        assert!(fit(&settings).residual_rms.is_finite());
    }
    // With an error of the size that the residuals have, less than the t distribution allows for.
    let found = fit(&CalibrationSettings::default());
    let (noise, t) = (found.identification.noise, estimate(&found, 0));
    near(t.standard_error / noise, free.standard_error / ERROR, 1e-6);
    near(t.interval[1] - t.value, 2.306004 * t.standard_error, 1e-6);
}

#[test]
fn bounds_hold_and_are_said_to_stop_the_fit() {
    let nominal = straight();
    let unknowns = pitches();
    let mut observations = heights(&nominal, 4, &[2e-3, 1.5e-3, 2.4e-3]);
    observations.extend(heights(&nominal, 9, &[2e-3, 1.5e-3, 2.4e-3]));
    let within = |low: f64, high: f64| Prior {
        bounds: Some([low, high]),
        ..Prior::default()
    };
    let fit = |priors| calibrate(&nominal, &unknowns, &observations, &known(priors)).unwrap();
    let free = fit([("lower pitch", within(0.01, 0.03))]);
    assert_eq!(free.state, FitState::Converged);
    let bounded = fit([("lower pitch", within(0.0169, 0.0172))]);
    assert_eq!(bounded.state, FitState::AtBound(vec![0]));
    let Finding::AtBound(value) = bounded.identification.findings[0] else {
        panic!("{:?}", bounded.identification.findings);
    };
    assert!(value <= 0.0172 && value > 0.0172 - 1e-12, "{value}");
    assert_eq!(bounded.spec.modules[0].pitch, value);
    // The upper module then has what is missing in the lower one.
    let upper = [&free, &bounded].map(|found| estimate(found, 1).value);
    assert!(upper[1] > upper[0] + 1e-5, "{upper:?}");
    // An interval ends at a bound, too.
    let value = estimate(&free, 0).value;
    let near_it = fit([("lower pitch", within(0.0169, value + 1e-6))]);
    assert_eq!(estimate(&near_it, 0).interval[1], value + 1e-6);
}

/// Without payloads, gains and densities are known by their ratio only. Of 120 intervals at 95 %, where the truth is drawn from the
/// priors, 6 do not hold it on average, and 1 to 14 in all but one of five hundred experiments like this (binomial).
#[test]
fn intervals_hold_a_truth_that_is_drawn_from_the_priors() {
    let mut nominal = RobotSpec::standard("2m").unwrap();
    nominal.modules.truncate(1);
    // Held level, so that the weight bends it.
    nominal.gravity = [9.81, 0.0, 0.0];
    let unknowns = [
        Unknown::shared("gain", (0..3).map(Parameter::Gain)),
        Unknown::one(Parameter::Density(0)),
    ];
    let density = unknowns[1].name();
    let priors = [(500.0, 40.0), (2500.0, 250.0)];
    let settings = known([
        ("gain", normal(priors[0].0, priors[0].1)),
        (density, normal(priors[1].0, priors[1].1)),
    ]);
    let mut rng = ChaCha8Rng::seed_from_u64(71);
    let error = Normal::new(0.0, ERROR).unwrap();
    let (mut outside, mut squares) = (0, 0.0);
    for _ in 0..60 {
        let truth =
            priors.map(|(mean, spread)| Normal::new(mean, spread).unwrap().sample(&mut rng));
        let real = (unknowns.iter().zip(truth)).fold(nominal.clone(), |spec, (unknown, value)| {
            unknown.set(&spec, value).unwrap()
        });
        let robot = Robot::new(real).unwrap();
        let observe = |_| {
            let command = robot.random_command(&mut rng);
            let settled = robot.settle(&command, &Loads::default());
            let mut measure = |disc: usize| {
                let error = Vector3::from_fn(|_, _| error.sample(&mut rng));
                (disc, settled.positions[disc] + error)
            };
            Observation {
                positions: [2, 4].map(&mut measure).to_vec(),
                loads: Loads::default(),
                command,
            }
        };
        let observations: Vec<Observation> = (0..10).map(observe).collect();
        let found = calibrate(&nominal, &unknowns, &observations, &settings).unwrap();
        near(found.identification.noise, ERROR, 0.35);
        for (unknown, truth) in truth.into_iter().enumerate() {
            let estimate = estimate(&found, unknown);
            let [low, high] = estimate.interval;
            outside += usize::from(!(low..=high).contains(&truth));
            squares += ((estimate.value - truth) / estimate.standard_error).powi(2);
        }
    }
    assert!((1..=14).contains(&outside), "{outside} of 120");
    // Chi-squared of 120 degrees of freedom, 99.95 % on either side.
    assert!((75.0..=177.0).contains(&squares), "{squares}");
}

#[test]
fn priors_that_cannot_be_are_refused() {
    let nominal = straight();
    let unknowns = pitches();
    let observations = heights(&nominal, 9, &[2e-3, 1.5e-3]);
    let refusal = |settings: &CalibrationSettings| {
        let refused = calibrate(&nominal, &unknowns, &observations, settings);
        refused.unwrap_err().to_string()
    };
    let of = |prior| refusal(&known([("lower pitch", prior)]));
    for (prior, says) in [
        (
            normal(0.017, -1.0),
            "\"lower pitch\".spread: -1 is no spread; expected a finite number above 0",
        ),
        (
            normal(0.0, 1.0),
            "\"lower pitch\".value: 0 cannot be its value; expected a finite number above 0",
        ),
        (
            Prior {
                unit: Some("mm".to_owned()),
                ..Prior::default()
            },
            "\"lower pitch\".unit: \"mm\" is not its unit, which is \"m\"",
        ),
        (
            Prior {
                bounds: Some([0.02, 0.01]),
                ..Prior::default()
            },
            "\"lower pitch\".bounds: [0.02, 0.01] are no bounds; expected the lower and the higher one, each a finite number above 0",
        ),
        (
            Prior {
                bounds: Some([0.018, 0.02]),
                ..Prior::default()
            },
            "\"lower pitch\".bounds: 0.017, where the fit of `lower pitch` starts, is not within [0.018, 0.02]",
        ),
    ] {
        assert_eq!(of(prior), says);
    }
    assert_eq!(
        refusal(&known([("pitch", Prior::default())])),
        "pitch: nothing of this name is fitted; expected one of lower pitch, upper pitch"
    );
    let mut settings = known([("lower pitch", normal(0.017, 1e-3))]);
    settings.error = None;
    assert_eq!(
        refusal(&settings),
        "\"lower pitch\".spread: it is weighed against the errors of measurement, whose size is not known; expected `error`, their \
         standard deviation (m), beside it"
    );
    for error in [0.0, -1e-4, f64::NAN, f64::INFINITY] {
        settings.error = Some(error);
        let says = refusal(&settings);
        assert!(says.starts_with(&format!(
            "error is {error}; expected a finite number above 0"
        )));
    }
    // Bounds alone need no error.
    let mut settings = known([("lower pitch", Prior::default())]);
    settings.error = None;
    assert!(calibrate(&nominal, &unknowns, &observations, &settings).is_ok());
    // A prior with a spread counts as a measurement.
    let mut few = observations[..1].to_vec();
    let three = [&unknowns[..], &[Unknown::one(Parameter::Gain(0))]].concat();
    let settings = known([("lower pitch", normal(0.017, 1e-3))]);
    assert!(calibrate(&nominal, &three, &few, &settings).is_ok());
    few.clear();
    let error = calibrate(&nominal, &three, &few, &settings).unwrap_err();
    assert!(matches!(
        error,
        CalibrationError::TooFew {
            coordinates: 0,
            priors: 1,
            unknowns: 3
        }
    ));
    assert_eq!(
        error.to_string(),
        "0 coordinates are measured (priors with a spread: 1); 3 unknowns take 4 at least"
    );
}
