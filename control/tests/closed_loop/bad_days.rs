//! Random robots that are not as modelled, random targets and random faults, all at once: no command leaves its bounds, whatever
//! happens, and a run that holds or ends says why.

use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tdcr_control::controller::{
    Controller, Inverse, Limits, Predictive, PredictiveSettings, ResolvedRate,
};
use tdcr_control::estimator::EstimatorSettings;
use tdcr_control::lag::Delay;
use tdcr_control::plant::{Measurement, Plant, PlantError, SimulatedPlant, Truth};
use tdcr_control::tip_path::{Shape, TipPath};
use tdcr_control::tracking::{Tracking, TrackingSettings, track};
use tdcr_control::watch::WatchSettings;
use tdcr_sim::inverse::recording::Marker;
use tdcr_sim::robot::{Command, Loads, Robot, RobotSpec};
use tdcr_sim::scene::Scene;
use tdcr_sim::simulation::Physics;

use super::PERIOD;

/// What a sensor or a servo does in place of its work.
#[derive(Clone, Copy, Debug)]
enum Fault {
    /// The tip is not seen.
    Lost,
    /// A coordinate of it is no number.
    NotANumber,
    /// It is seen kilometres away.
    FarAway,
    /// It is seen somewhere within 10 cm.
    Elsewhere,
    /// In another frame: axes are exchanged.
    WrongFrame,
    /// Tensions are infinite.
    Infinite,
    /// Or huge.
    Huge,
    /// They are not measured.
    Untold,
    /// Lengths are 0.
    NoLength,
    /// A servo stops where it is.
    Stopped(usize),
}

fn any_fault(rng: &mut ChaCha8Rng, tendons: usize) -> Fault {
    match rng.random_range(0..10) {
        0 => Fault::Lost,
        1 => Fault::NotANumber,
        2 => Fault::FarAway,
        3 => Fault::Elsewhere,
        4 => Fault::WrongFrame,
        5 => Fault::Infinite,
        6 => Fault::Huge,
        7 => Fault::Untold,
        8 => Fault::NoLength,
        _ => Fault::Stopped(rng.random_range(0..tendons)),
    }
}

/// A plant of bad days, which refuses to be commanded beyond the limits.
struct Rough<'a> {
    plant: SimulatedPlant,
    limits: &'a Limits,
    rng: ChaCha8Rng,
    /// How often a fault begins.
    often: f64,
    fault: Option<(Fault, usize)>,
    last: Vec<f64>,
    /// What the tendons got last.
    got: Vec<f64>,
    steps: &'a AtomicUsize,
}

impl Rough<'_> {
    fn spoil(&mut self, fault: Fault, now: &mut Measurement) {
        let tendons = self.last.len();
        let mut nearby = || Vector3::from_fn(|_, _| 0.2 * (self.rng.random::<f64>() - 0.5));
        let each_sighting =
            |now: &mut Measurement, change: &dyn Fn(Vector3<f64>) -> Vector3<f64>| {
                for seen in &mut now.sightings {
                    seen.position = change(seen.position);
                }
            };
        match fault {
            Fault::Lost => now.sightings.clear(),
            Fault::NotANumber => each_sighting(now, &|p| Vector3::new(p.x, f64::NAN, p.z)),
            Fault::FarAway => each_sighting(now, &|p| p * 1e6),
            Fault::Elsewhere => {
                let by = nearby();
                each_sighting(now, &|p| p + by);
            }
            Fault::WrongFrame => each_sighting(now, &|p| Vector3::new(p.z, p.x, -p.y)),
            Fault::Infinite => now.tensions = Some(vec![f64::INFINITY; tendons]),
            Fault::Huge => now.tensions = Some(vec![1e5; tendons]),
            Fault::Untold => now.tensions = None,
            Fault::NoLength => now.lengths = Some(vec![0.0; tendons]),
            Fault::Stopped(_) => {}
        }
    }
}

impl Plant for Rough<'_> {
    fn period(&self) -> f64 {
        PERIOD
    }

    fn measure(&mut self) -> Result<Measurement, PlantError> {
        let mut now = self.plant.measure()?;
        self.fault = match self.fault.take() {
            Some((fault, left)) if left > 0 => Some((fault, left - 1)),
            _ if self.rng.random::<f64>() < self.often => {
                let fault = any_fault(&mut self.rng, self.last.len());
                Some((fault, self.rng.random_range(0..40)))
            }
            _ => None,
        };
        if let Some((fault, _)) = self.fault {
            self.spoil(fault, &mut now);
        }
        Ok(now)
    }

    fn command(&mut self, command: &Command) -> Result<(), PlantError> {
        let next = command.as_slice();
        let [low, high] = self.limits.next(&self.last);
        for (t, &value) in next.iter().enumerate() {
            assert!(
                (low[t]..=high[t]).contains(&value),
                "tendon {t}: {value} after {}, expected {} to {}",
                self.last[t],
                low[t],
                high[t]
            );
        }
        self.last.copy_from_slice(next);
        self.steps.fetch_add(1, Ordering::Relaxed);
        let stopped = match self.fault {
            Some((Fault::Stopped(tendon), _)) => Some(tendon),
            _ => None,
        };
        for (t, got) in self.got.iter_mut().enumerate() {
            if stopped != Some(t) {
                *got = next[t];
            }
        }
        let got = self.plant.robot().command(&self.got);
        self.plant.command(&got.expect("within ranges"))
    }

    fn true_tip(&self) -> Option<Vector3<f64>> {
        self.plant.true_tip()
    }
}

fn any_robot(rng: &mut ChaCha8Rng) -> Robot {
    let name = if rng.random::<f64>() < 0.8 {
        "2m"
    } else {
        "3m"
    };
    let mut spec = RobotSpec::standard(name).unwrap();
    if rng.random::<f64>() < 0.7 {
        spec.gravity[2] = -spec.gravity[2];
    }
    Robot::new(spec).unwrap()
}

fn any_truth(rng: &mut ChaCha8Rng, robot: &Robot) -> Truth {
    let mut truth = Truth::ideal(robot);
    truth.loads = Loads::payload(0.1 * rng.random::<f64>()).unwrap();
    truth.delay = rng.random_range(0..5);
    truth.physics = match rng.random_range(0..10) {
        0 | 1 => Physics::WithFriction {
            coefficient: rng.random_range(0.0..0.5),
        },
        2 => Physics::InMotion {
            timestep: 0.01,
            friction: None,
        },
        _ => Physics::AtRest,
    };
    for servo in &mut truth.servos {
        servo.gain = rng.random_range(0.7..1.3);
        servo.offset = rng.random_range(-0.003..0.003);
        servo.backlash = rng.random_range(0.0..5e-4);
    }
    truth.sensors.position = rng.random_range(0.0..2e-3);
    if rng.random::<bool>() {
        truth.sensors.markers.push(Marker {
            disc: 4,
            place: Vector3::zeros(),
        });
    }
    truth
}

/// A curve of any size about any place, mostly out of reach.
fn any_path(rng: &mut ChaCha8Rng) -> TipPath {
    let shape = match rng.random_range(0..4) {
        0 => Shape::Circle,
        1 => Shape::Eight,
        2 => Shape::Square,
        _ => Shape::Lissajous([3, 2]),
    };
    let mut part = || rng.random::<f64>() - 0.5;
    let level = Isometry3::translation(0.2 * part(), 0.2 * part(), 0.3 + 0.2 * part());
    let (size, time) = (0.2 + 0.38 * part(), 5.0 + 6.0 * part());
    TipPath::closed(shape, &level, size, time).unwrap()
}

/// A predictive controller that looks as far ahead as usual in one of `usual` draws, and two commands ahead else: a horizon's program takes a
/// time that grows with its cube.
fn any_predictive(rng: &mut ChaCha8Rng, usual: u32) -> Predictive {
    let settings = PredictiveSettings::default();
    Predictive::new(match rng.random_range(0..usual) {
        0 => settings,
        _ => PredictiveSettings {
            horizon: 2,
            ..settings
        },
    })
}

/// One bad day; `None` where the robot does not even stand. `usual` is of [`any_predictive`].
fn bad_day(seed: u64, steps: &AtomicUsize, usual: u32) -> Option<Tracking> {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let robot = any_robot(rng);
    let truth = any_truth(rng, &robot);
    let path = any_path(rng);
    let start = robot.mean_command();
    let tension = match rng.random::<bool>() {
        true => [0.0, f64::INFINITY],
        false => [1.0, 12.0],
    };
    let limits = Limits::new(&robot, PERIOD, None, tension).unwrap();
    let mut controller: Box<dyn Controller> = match rng.random_range(0..10) {
        0 => Box::<Inverse>::default(),
        1..4 => Box::new(any_predictive(rng, usual)),
        _ => Box::<ResolvedRate>::default(),
    };
    let mut plant = Rough {
        plant: SimulatedPlant::new(&truth, PERIOD, &start, seed).ok()?,
        limits: &limits,
        often: rng.random_range(0.0..0.1),
        rng: rng.clone(),
        fault: None,
        last: start.as_slice().to_vec(),
        got: start.as_slice().to_vec(),
        steps,
    };
    let settings = TrackingSettings {
        approach: 1.0,
        loads: Loads::default(),
        scene: Scene::default(),
        correction: Vec::new(),
        estimator: EstimatorSettings::for_robot(&robot),
        delay: Delay::Estimated { most: 4 },
        limits: limits.clone(),
        watch: WatchSettings::default(),
    };
    // A simulated robot that cannot go on ends the run by an error, which is a reason said.
    track(
        &mut plant,
        &robot,
        &start,
        &path,
        &mut *controller,
        &settings,
        &mut |_| true,
    )
    .ok()
}

/// Whatever held or ended a run is among its incidents.
fn says_why(run: &Tracking) {
    let mut was_held = false;
    for row in &run.rows {
        let begins = row.held.is_some() && !was_held;
        was_held = row.held.is_some();
        let is_said = run
            .incidents
            .iter()
            .any(|incident| incident.time == row.time);
        assert!(
            !begins || is_said,
            "held at {} s, and not said: {:?}",
            row.time,
            row.held
        );
    }
    let ended = run.incidents.iter().any(|incident| incident.is_end);
    assert_eq!(run.stopped.is_some(), ended, "{:?}", run.stopped);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn no_command_leaves_its_bounds_on_bad_days(seed in any::<u64>()) {
        if let Some(run) = bad_day(seed, &AtomicUsize::new(0), 1) {
            says_why(&run);
        }
    }
}

/// A million steps: 40 minutes of processor time.
#[test]
#[ignore = "takes 40 minutes of processor time"]
fn no_command_of_a_million_leaves_its_bounds() {
    const STEPS: usize = 1_000_000;
    const USUAL: u32 = 20;
    let (steps, days, stopped) = (
        AtomicUsize::new(0),
        AtomicUsize::new(0),
        AtomicUsize::new(0),
    );
    let work = || {
        while steps.load(Ordering::Relaxed) < STEPS {
            let seed = days.fetch_add(1, Ordering::Relaxed) as u64;
            if let Some(run) = bad_day(seed, &steps, USUAL) {
                says_why(&run);
                stopped.fetch_add(usize::from(run.stopped.is_some()), Ordering::Relaxed);
            }
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(work);
        }
    });
    eprintln!(
        "{} steps in {} runs, of which {} were stopped",
        steps.load(Ordering::Relaxed),
        days.load(Ordering::Relaxed),
        stopped.load(Ordering::Relaxed)
    );
}
