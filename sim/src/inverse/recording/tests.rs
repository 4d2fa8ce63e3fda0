//! Recordings of simulated robots whose truth is known.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::*;
use crate::robot::{Backbone, Drive, Friction, PerDisc, Pull, Robot, RobotSpec};

const NOISE: f64 = 5e-4;

/// Two modules on an elastic backbone, whose tendons only pull and stretch.
fn robot() -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").expect("a standard robot");
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(0.3)));
        if let Some(tendons) = &mut module.tendons {
            tendons.drive = Drive::Gain(2000.0);
            tendons.pull = Pull::TensionOnly;
        }
    }
    spec
}

/// The servos go round, further and further, and back and forth on the way; the tip and a disc below are measured.
fn recording(spec: &RobotSpec, truth: &Transmission, rows: usize) -> Recording {
    let mut recording = Recording::default();
    for row in 0..rows {
        let t = row as f64;
        let along = 0.13 * t + 0.6 * (0.45 * t).sin();
        let pull = |tendon: usize| {
            let phase = 2.1 * tendon as f64 + if tendon < 3 { along } else { -0.7 * along };
            (0.004 + 0.01 * t / rows as f64) * phase.sin()
        };
        recording.times.push(0.5 * t);
        recording.pulls.push((0..6).map(pull).collect());
        recording.points.push(vec![None; truth.markers.len()]);
    }
    let replay = Replay::new(spec, truth, &recording).expect("a recording of the robot");
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let normal = Normal::new(0.0, NOISE).expect("a deviation above 0");
    for (measured, simulated) in recording.points.iter_mut().zip(replay.points) {
        for (measured, simulated) in measured.iter_mut().zip(simulated.expect("settled")) {
            *measured = Some(simulated + Vector3::from_fn(|_, _| normal.sample(&mut rng)));
        }
    }
    recording
}

fn markers() -> Vec<Marker> {
    let at = |disc, x| Marker {
        disc,
        place: Vector3::new(x, 0.0, 0.0),
    };
    vec![at(9, 0.0), at(4, 0.01)]
}

/// The truth is drawn from about where the priors are.
fn truth(first: &RobotSpec) -> (RobotSpec, Transmission) {
    let mut transmission = Transmission::ideal(6, markers());
    for (t, servo) in transmission.servos.iter_mut().enumerate() {
        servo.offset = [3e-4, -2e-4, 1e-4, 4e-4, 0.0, -1e-4][t];
        servo.backlash = 2e-4;
    }
    transmission.lag = 0.12;
    let mut spec = first.clone();
    for (module, stiffness) in spec.modules.iter_mut().zip([0.34, 0.27]) {
        module.backbone = Some(PerDisc::Uniform(Backbone {
            bending: [stiffness; 2],
            torsion: 0.3,
            rest: [0.0; 3],
        }));
    }
    (spec, transmission)
}

fn settings() -> RecordingSettings {
    RecordingSettings {
        groups: vec![
            Group::Pretension,
            Group::Backlash,
            Group::Lag,
            Group::Stiffness,
        ],
        ..RecordingSettings::default()
    }
}

fn onwards(_: Progress) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Spools that are all smaller than was said, by far more than they may differ from each other.
#[test]
fn a_gain_that_all_servos_share_is_found() {
    let first = robot();
    let (real, mut there) = truth(&first);
    for servo in &mut there.servos {
        servo.gain = 0.75;
    }
    let recording = recording(&real, &there, 240);
    let settings = RecordingSettings {
        groups: [&settings().groups[..], &[Group::SpoolRadius]].concat(),
        ..RecordingSettings::default()
    };
    let given = Transmission::ideal(6, markers());
    let fit = fit_recording(&first, &given, &recording, &settings, &mut onwards, &|| {
        false
    })
    .expect("a fit");
    for servo in &fit.transmission.servos {
        assert!((servo.gain / 0.75 - 1.0).abs() < 0.02, "{servo:?}");
    }
    assert!(
        fit.after.rmse < 1.1 * 3f64.sqrt() * NOISE,
        "{}",
        fit.after.rmse
    );
}

#[test]
fn pretension_backlash_lag_and_stiffness_are_found_within_their_intervals() {
    let first = robot();
    let (real, there) = truth(&first);
    let recording = recording(&real, &there, 240);
    let given = Transmission::ideal(6, markers());
    let fit = fit_recording(
        &first,
        &given,
        &recording,
        &settings(),
        &mut onwards,
        &|| false,
    )
    .expect("a fit");
    let truth: Vec<f64> = (there.servos.iter().map(|servo| servo.offset))
        .chain(there.servos.iter().map(|servo| servo.backlash))
        .chain([there.lag, 0.34 / 0.3, 0.27 / 0.3])
        .collect();
    assert_eq!(fit.unknowns.len(), truth.len());
    // Of fifteen 95 % intervals one may miss.
    let missed: Vec<_> = (fit.unknowns.iter().zip(&truth))
        .filter(|(unknown, truth)| !(unknown.interval[0]..=unknown.interval[1]).contains(truth))
        .collect();
    assert!(missed.len() <= 1, "{missed:?}");
    for (unknown, truth) in fit.unknowns.iter().zip(&truth) {
        let [low, high] = unknown.interval;
        assert!(
            (unknown.value - truth).abs() <= high - low,
            "{unknown:?}, truth {truth}"
        );
    }
    let independent = 3f64.sqrt() * NOISE;
    assert!(
        (fit.after.rmse / independent - 1.0).abs() < 0.1,
        "{}",
        fit.after.rmse
    );
    assert!(fit.before.rmse > 2.0 * fit.after.rmse && fit.correlation_length < 2.0);
}

/// The largest difference between the derivatives by an unknown and the differences of residuals, as a share of the latter.
fn largest_difference(
    first: &RobotSpec,
    real: &RobotSpec,
    there: &Transmission,
    friction: bool,
    h: f64,
) -> (f64, String) {
    let recording = recording(real, there, 8);
    let explicit = explicit::Explicit::new(first).expect("a robot");
    let facts = facts::Facts {
        groups: &Group::ALL,
        explicit: &explicit,
        transmission: there,
        recording: &recording,
    };
    let unknowns = unknowns::unknowns(&facts).expect("all groups");
    let problem = problem::Problem {
        explicit: &explicit,
        transmission: there,
        recording: &recording,
        speeds: recording.speeds(),
        unknowns: &unknowns,
        loss: 2e-3,
        friction,
        stop: &|| false,
    };
    let weighing = problem::Weighing {
        rows: (0..8).collect(),
        error: 1e-3,
    };
    let x = nalgebra::DVector::from_fn(unknowns.len(), |i, _| 0.1 * (i as f64).sin());
    let at = |x: &nalgebra::DVector<f64>| {
        problem
            .evaluate(x, &weighing, &vec![None; 8])
            .expect("settled")
    };
    let here = at(&x);
    let mut largest = (0.0, String::new());
    for i in 0..x.len() {
        let [mut low, mut high] = [x.clone(), x.clone()];
        (low[i], high[i]) = (x[i] - h, x[i] + h);
        let slope = (at(&high).residuals - at(&low).residuals) / (2.0 * h);
        let scale = slope.amax().max(1e-6);
        let difference = (slope - here.jacobian.column(i)).amax() / scale;
        if difference > largest.0 {
            largest = (difference, unknowns[i].sought.name.clone());
        }
    }
    largest
}

/// Tendons that push too: where one goes slack, derivatives jump.
fn pushing() -> RobotSpec {
    let mut first = robot();
    for tendons in first.modules.iter_mut().filter_map(|m| m.tendons.as_mut()) {
        tendons.pull = Pull::Bilateral;
    }
    first
}

/// Derivatives against differences of the residuals of two robots, of every group.
#[test]
fn derivatives_are_those_of_the_residuals() {
    let first = pushing();
    let (real, there) = truth(&first);
    let (difference, name) = largest_difference(&first, &real, &there, false, 1e-3);
    assert!(difference < 5e-3, "{name}: {difference}");
}

/// The same with friction in the holes, along the path that the rows are.
#[test]
fn derivatives_along_a_path_are_those_of_the_residuals() {
    let mut first = robot();
    for tendons in first.modules.iter_mut().filter_map(|m| m.tendons.as_mut()) {
        tendons.friction = Some(Friction {
            coefficient: 0.15,
            contact_stiffness: 1e5,
        });
    }
    let (real, mut there) = truth(&first);
    for servo in &mut there.servos {
        servo.offset += 4e-3;
    }
    // Steps short enough that no contact of these rows sticks on one side of a difference and slips on the other.
    let (difference, name) = largest_difference(&first, &real, &there, true, 2e-4);
    assert!(difference < 1e-2, "{name}: {difference}");
}

/// Two modules whose tendons rub: the truth, and what is first thought of it.
#[test]
fn friction_backlash_and_lag_are_found_along_a_path_within_their_intervals() {
    let first = robot();
    let (mut real, mut there) = truth(&first);
    for (module, coefficient) in real.modules.iter_mut().zip([0.15, 0.3]) {
        if let Some(tendons) = &mut module.tendons {
            tendons.friction = Some(Friction {
                coefficient,
                ..Friction::NONE
            });
        }
    }
    // Tendons that all pull rub.
    let mut given = Transmission::ideal(6, markers());
    for (servo, start) in there.servos.iter_mut().zip(&mut given.servos) {
        servo.offset += 3e-3;
        start.offset += 3e-3;
    }
    let recording = recording(&real, &there, 240);
    let settings = RecordingSettings {
        groups: vec![
            Group::Pretension,
            Group::Backlash,
            Group::Lag,
            Group::Stiffness,
            Group::Friction,
        ],
        ..RecordingSettings::default()
    };
    let fit = fit_recording(&first, &given, &recording, &settings, &mut onwards, &|| {
        false
    })
    .expect("a fit");
    let truth: Vec<f64> = (there.servos.iter().map(|servo| servo.offset))
        .chain(there.servos.iter().map(|servo| servo.backlash))
        .chain([there.lag, 0.34 / 0.3, 0.27 / 0.3, 0.15, 0.3])
        .collect();
    assert_eq!(fit.unknowns.len(), truth.len());
    // Of seventeen 95 % intervals one may miss.
    let missed: Vec<_> = (fit.unknowns.iter().zip(&truth))
        .filter(|(unknown, truth)| !(unknown.interval[0]..=unknown.interval[1]).contains(truth))
        .collect();
    assert!(missed.len() <= 1, "{missed:?}");
    for (unknown, truth) in fit.unknowns.iter().zip(&truth).skip(15) {
        let [low, high] = unknown.interval;
        assert!(
            (unknown.value - truth).abs() < 0.05 && high - low < 0.2,
            "{unknown:?}, truth {truth}"
        );
    }
    let independent = 3f64.sqrt() * NOISE;
    assert!(
        (fit.after.rmse / independent - 1.0).abs() < 0.1,
        "{}",
        fit.after.rmse
    );
}

#[test]
fn a_watcher_stops_a_fit() {
    let first = robot();
    let (real, there) = truth(&first);
    let recording = recording(&real, &there, 20);
    let mut stop = |_| ControlFlow::Break(());
    let stopped = fit_recording(&first, &there, &recording, &settings(), &mut stop, &|| {
        false
    });
    assert_eq!(stopped.err(), Some(RecordingError::Interrupted));
    // Within an iteration, and not at its end alone.
    let asked = AtomicUsize::new(0);
    let stop = || asked.fetch_add(1, Ordering::Relaxed) > 30;
    let stopped = fit_recording(&first, &there, &recording, &settings(), &mut onwards, &stop);
    assert_eq!(stopped.err(), Some(RecordingError::Interrupted));
}

#[test]
fn what_makes_no_sense_is_named() {
    let first = robot();
    let (real, there) = truth(&first);
    let recording = recording(&real, &there, 20);
    let fit = |transmission: &Transmission, recording: &Recording, groups: Vec<Group>| {
        let settings = RecordingSettings {
            groups,
            ..RecordingSettings::default()
        };
        let error = fit_recording(
            &first,
            transmission,
            recording,
            &settings,
            &mut onwards,
            &|| false,
        )
        .expect_err("refused");
        error.to_string()
    };
    let mut far = there.clone();
    far.markers[1].disc = 10;
    assert_eq!(
        fit(&far, &recording, vec![Group::Lag]),
        "marker 1 is on disc 10; the robot has discs 0 to 9"
    );
    let mut late = recording.clone();
    late.times[7] = 0.0;
    assert_eq!(
        fit(&there, &late, vec![Group::Lag]),
        "row 7 of the recording: it is earlier than the row before"
    );
    let mut weightless = first.clone();
    weightless.gravity = [0.0; 3];
    let settings = RecordingSettings {
        groups: vec![Group::Gravity],
        ..RecordingSettings::default()
    };
    let refused = fit_recording(
        &weightless,
        &there,
        &recording,
        &settings,
        &mut onwards,
        &|| false,
    )
    .expect_err("refused");
    assert!(
        refused.to_string().starts_with("cannot fit gravity: "),
        "{refused}"
    );
    // The fourth hole of the first tendon is left out.
    let mut skipping = explicit::Explicit::new(&first).expect("a robot").spec;
    skipping.routes[0].through.remove(3);
    let settings = RecordingSettings {
        groups: vec![Group::Friction],
        ..RecordingSettings::default()
    };
    let refused = fit_recording(
        &skipping,
        &there,
        &recording,
        &settings,
        &mut onwards,
        &|| false,
    );
    let refused = refused.expect_err("refused").to_string();
    assert!(refused.contains("a tendon skips discs"), "{refused}");
    let few = Recording {
        times: recording.times[..1].to_vec(),
        pulls: recording.pulls[..1].to_vec(),
        points: recording.points[..1].to_vec(),
        ..Recording::default()
    };
    assert!(
        fit(&there, &few, settings_groups()).starts_with("6 measured coordinates cannot tell ")
    );
    assert!(Robot::new(weightless).is_ok());
}

fn settings_groups() -> Vec<Group> {
    settings().groups
}
