//! Bad days: sensors that fail, robots that are not as modelled, controllers that diverge.

use nalgebra::Vector3;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_control::controller::{ControlError, Controller, Moment, Predictive, ResolvedRate};
use tdcr_control::plant::{Measurement, Plant, PlantError, SimulatedPlant, Truth};
use tdcr_control::tip_path::TipPath;
use tdcr_control::tracking::{Tracking, track};
use tdcr_sim::robot::{Command, Loads, Robot};

use super::{PERIOD, circle, first_command, hanging, settings};

/// A plant whose measurements are spoilt in some periods.
struct Spoilt<S> {
    plant: SimulatedPlant,
    periods: usize,
    spoil: S,
}

impl<S: FnMut(usize, &mut Measurement)> Plant for Spoilt<S> {
    fn period(&self) -> f64 {
        self.plant.period()
    }

    fn measure(&mut self) -> Result<Measurement, PlantError> {
        let mut measurement = self.plant.measure()?;
        (self.spoil)(self.periods, &mut measurement);
        Ok(measurement)
    }

    fn command(&mut self, command: &Command) -> Result<(), PlantError> {
        self.periods += 1;
        self.plant.command(command)
    }

    fn true_tip(&self) -> Option<Vector3<f64>> {
        self.plant.true_tip()
    }
}

fn run(
    robot: &Robot,
    path: &TipPath,
    start: &Command,
    controller: &mut dyn Controller,
    spoil: impl FnMut(usize, &mut Measurement),
) -> Tracking {
    let plant = SimulatedPlant::new(&Truth::ideal(robot), PERIOD, start, 0).unwrap();
    let mut plant = Spoilt {
        plant,
        periods: 0,
        spoil,
    };
    let settings = settings(robot);
    track(
        &mut plant,
        robot,
        start,
        path,
        controller,
        &settings,
        &mut |_| true,
    )
    .unwrap()
}

/// Every command is within its tendon's range, and near the one before.
fn keeps_bounds(robot: &Robot, start: &Command, run: &Tracking) -> Result<(), TestCaseError> {
    let mut last = start.as_slice().to_vec();
    for row in &run.rows {
        prop_assert!(robot.command(&row.command).is_ok(), "{:?}", row.command);
        for (t, (now, before)) in row.command.iter().zip(&last).enumerate() {
            let [low, high] = robot.tendons()[t].range;
            let most = 0.5 * (high - low) * PERIOD * (1.0 + 1e-9);
            prop_assert!((now - before).abs() <= most, "{now} after {before}");
        }
        last.clone_from(&row.command);
    }
    Ok(())
}

fn spoil(kind: u8, rng: &mut ChaCha8Rng, now: &mut Measurement) {
    let Some(seen) = now.sightings.first_mut() else {
        return;
    };
    match kind {
        0 => seen.position.x = f64::NAN,
        1 => seen.position *= 1e6,
        2 => seen.position += Vector3::from_fn(|_, _| 0.2 * (rng.random::<f64>() - 0.5)),
        3 => now.sightings.clear(),
        4 => now.tensions = Some(vec![f64::INFINITY; 6]),
        5 => now.tensions = Some(vec![1e5; 6]),
        6 => now.tensions = None,
        _ => now.lengths = Some(vec![0.0; 6]),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn no_command_leaves_its_bounds_whatever_sensors_say(
        seed in any::<u64>(), often in 0.0..0.6_f64, delay in 0_usize..5, predictive in any::<bool>(),
        gains in proptest::collection::vec(0.7..1.3_f64, 6), payload in 0.0..0.1_f64
    ) {
        let robot = hanging();
        let start = robot.mean_command();
        let mut truth = Truth::ideal(&robot);
        truth.loads = Loads::payload(payload).unwrap();
        truth.delay = delay;
        for (servo, gain) in truth.servos.iter_mut().zip(gains) {
            servo.gain = gain;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut plant = Spoilt {
            plant: SimulatedPlant::new(&truth, PERIOD, &start, seed).unwrap(),
            periods: 0,
            spoil: |_: usize, now: &mut Measurement| {
                if rng.random::<f64>() < often {
                    let kind = rng.random_range(0..8);
                    spoil(kind, &mut rng, now);
                }
            },
        };
        let mut controller: Box<dyn Controller> = match predictive {
            true => Box::<Predictive>::default(),
            false => Box::<ResolvedRate>::default(),
        };
        let settings = settings(&robot);
        let run = track(
            &mut plant, &robot, &start, &circle(3.0), &mut *controller, &settings, &mut |_| true,
        );
        // A plant that cannot go on is the plant's; up to there commands kept their bounds by their type.
        if let Ok(run) = run {
            keeps_bounds(&robot, &start, &run)?;
        }
    }
}

#[test]
fn a_tip_that_is_lost_for_a_second_is_waited_for() {
    let robot = hanging();
    let path = circle(6.0);
    let start = first_command(&robot, &path);
    let lost = 80..100;
    let hide = |period: usize, now: &mut Measurement| {
        if lost.contains(&period) {
            now.sightings.clear();
        }
    };
    let run = run(&robot, &path, &start, &mut ResolvedRate::default(), hide);
    assert_eq!(run.stopped, None);
    assert_eq!(run.incidents.len(), 1);
    assert_eq!(run.incidents[0].reason, "held: the tip is not seen");
    let held: Vec<_> = run.rows.iter().filter(|row| row.held.is_some()).collect();
    assert_eq!(held.len(), 20);
    assert!(held.iter().all(|row| row.command == held[0].command));
    let last = run.rows.last().unwrap();
    assert!((last.tip.unwrap() - last.target).norm() < 1e-3);
}

#[test]
fn a_tip_that_stays_lost_ends_the_run() {
    let robot = hanging();
    let path = circle(8.0);
    let start = first_command(&robot, &path);
    let blind = |period: usize, now: &mut Measurement| {
        if period > 60 {
            now.sightings[0].position.y = f64::NAN;
        }
    };
    let run = run(&robot, &path, &start, &mut Predictive::default(), blind);
    let stopped = run.stopped.unwrap();
    assert!(
        stopped.starts_with("held for 3.05 s: the tip is not seen"),
        "{stopped}"
    );
}

#[test]
fn a_target_out_of_reach_is_said() {
    let robot = hanging();
    let start = robot.mean_command();
    let far = Vector3::new(0.05, 0.0, 0.6);
    let path = TipPath::table(&[(0.0, far), (6.0, far)]).unwrap();
    let run = run(
        &robot,
        &path,
        &start,
        &mut ResolvedRate::default(),
        |_, _| {},
    );
    let reasons: Vec<_> = run.incidents.iter().map(|i| i.reason.as_str()).collect();
    let is_said =
        |reason: &&str| reason.contains("out of reach") || reason.contains("the error grew from");
    assert!(reasons.iter().any(is_said), "{reasons:?}");
    keeps_bounds(&robot, &start, &run).unwrap();
}

/// Commands that lead away from wherever the tip is to be.
struct Diverging;

impl Controller for Diverging {
    fn name(&self) -> &'static str {
        "diverging"
    }

    fn propose(&mut self, moment: &mut Moment<'_>) -> Result<Vec<f64>, ControlError> {
        let pull = |(t, value): (usize, &f64)| match t % 3 {
            0 => value - 1.0,
            _ => value + 1.0,
        };
        Ok(moment.command.iter().enumerate().map(pull).collect())
    }
}

#[test]
fn a_controller_that_diverges_is_stopped() {
    let robot = hanging();
    let path = circle(8.0);
    let start = first_command(&robot, &path);
    let run = run(&robot, &path, &start, &mut Diverging, |_, _| {});
    let stopped = run.stopped.clone().unwrap();
    assert!(stopped.starts_with("the error grew from"), "{stopped}");
    assert!(run.rows.len() < 120);
    keeps_bounds(&robot, &start, &run).unwrap();
}

/// Numbers that are none become the last command.
struct Nonsense;

impl Controller for Nonsense {
    fn name(&self) -> &'static str {
        "nonsense"
    }

    fn propose(&mut self, _: &mut Moment<'_>) -> Result<Vec<f64>, ControlError> {
        Ok(vec![f64::NAN, f64::INFINITY, -1e300, 0.02, 0.02, 0.02])
    }
}

#[test]
fn a_command_that_is_not_a_number_is_not_given() {
    let robot = hanging();
    let path = circle(2.0);
    let start = first_command(&robot, &path);
    let run = run(&robot, &path, &start, &mut Nonsense, |_, _| {});
    assert!(
        run.rows
            .iter()
            .all(|row| row.command[0] == start.as_slice()[0])
    );
    keeps_bounds(&robot, &start, &run).unwrap();
}
