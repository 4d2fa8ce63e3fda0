//! A plant, an estimator and a controller along a path, watched over.

use std::collections::VecDeque;

use nalgebra::Vector3;
use tdcr_sim::robot::{Command, CommandError, Loads, Robot};
use tdcr_sim::scene::Scene;
use thiserror::Error;

use crate::belief::{Belief, BeliefError};
use crate::controller::{Controller, Limits, Moment};
use crate::estimator::{Estimated, Estimator, EstimatorSettings};
use crate::jacobian::JacobianObserver;
use crate::lag::{Delay, Lag};
use crate::plant::{Measurement, Plant, PlantError};
use crate::tip_path::TipPath;
use crate::watch::{Incident, Watch, WatchSettings};

/// How a path is tracked.
#[derive(Clone, Debug)]
pub struct TrackingSettings {
    /// Time before the path's start in which the tip is led to its first point (s); errors count from the start.
    pub approach: f64,
    /// Loads that are known of.
    pub loads: Loads,
    /// Obstacles that the model settles among, without friction; a controller whose model moves does not know of them.
    pub scene: Scene,
    /// What is added to the path for the controller, at each period from its start (m, world frame): learnt in earlier trials
    /// ([`Learning`](crate::learning::Learning)). Errors count from the path itself.
    pub correction: Vec<Vector3<f64>>,
    /// What is estimated, and how measurements are weighed.
    pub estimator: EstimatorSettings,
    /// From a command to when the tendons get it.
    pub delay: Delay,
    /// What commands must keep.
    pub limits: Limits,
    /// When the robot holds or stops.
    pub watch: WatchSettings,
}

/// One period of a run.
#[derive(Clone, Debug)]
pub struct TrackingRow {
    /// Time from the path's start (s); below 0 in the approach.
    pub time: f64,
    /// Where the tip is to be (m, world frame).
    pub target: Vector3<f64>,
    /// Where it was measured (m).
    pub measured: Option<Vector3<f64>>,
    /// Where the controller took it to be: as measured, else where the model has it by what was measured (m).
    pub seen: Option<Vector3<f64>>,
    /// Where it is: in truth where the plant knows it, else as measured (m).
    pub tip: Option<Vector3<f64>>,
    /// The command given (m or N).
    pub command: Vec<f64>,
    /// Tensions as measured (N).
    pub tensions: Option<Vec<f64>>,
    /// What is known of each unknown.
    pub estimated: Vec<Estimated>,
    /// Periods from a command to when the tendons get it, as far as is known.
    pub delay: usize,
    /// Why the last command was held in place of a new one.
    pub held: Option<String>,
}

/// A run along a path.
#[derive(Clone, Debug)]
pub struct Tracking {
    /// Name of the controller.
    pub controller: &'static str,
    /// The periods, the approach's included.
    pub rows: Vec<TrackingRow>,
    /// What went wrong, and when.
    pub incidents: Vec<Incident>,
    /// Why the run ended before the path did.
    pub stopped: Option<String>,
    /// What measurements do not identify, by name.
    pub unidentified: Vec<String>,
    /// The robot's length (m).
    pub length: f64,
}

/// Why a path cannot be tracked.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TrackingError {
    /// The plant failed.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// The model is none.
    #[error(transparent)]
    Model(#[from] BeliefError),
    /// The first command is of another robot.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// An approach of no length.
    #[error("the approach takes {0} s; expected a finite time, 0 or above")]
    Approach(f64),
    /// More periods than anybody waits for.
    #[error("path and approach take {0} periods; expected at most {MOST_PERIODS}")]
    Periods(f64),
    /// Limits of another robot.
    #[error("there are limits of {found} tendons; the robot has {expected}")]
    Limits {
        /// Those given.
        found: usize,
        /// The robot's tendons.
        expected: usize,
    },
}

impl Tracking {
    /// Distance of the tip from its target in each period of the path where it is known: time (s) and distance (m).
    pub fn errors(&self) -> Vec<[f64; 2]> {
        let on_path = self.rows.iter().filter(|row| row.time >= 0.0);
        on_path
            .filter_map(|row| Some([row.time, (row.tip? - row.target).norm()]))
            .collect()
    }

    /// Root mean square of these distances (m); `None` where the path was not begun.
    pub fn rms_error(&self) -> Option<f64> {
        let errors = self.errors();
        let squares: f64 = errors.iter().map(|[_, error]| error * error).sum();
        (!errors.is_empty()).then(|| (squares / errors.len() as f64).sqrt())
    }

    /// The last command that the plant was given (m or N): that of the last row was only chosen. `None` where none was.
    pub fn last_given(&self) -> Option<&[f64]> {
        let given = self.rows.iter().rev().nth(1);
        given.map(|row| row.command.as_slice())
    }

    /// The largest of them (m).
    pub fn largest_error(&self) -> Option<f64> {
        self.errors()
            .into_iter()
            .map(|[_, error]| error)
            .reduce(f64::max)
    }
}

/// The most periods of a run: a week at 20 Hz.
const MOST_PERIODS: f64 = 12_096_000.0;

/// What is said, once, where the tip's motion is another than the model's.
const MISMATCH: &str = "the tip does not answer its commands as the model has it: something that the model does not know of may touch the robot, or its tendons stick";

/// Share of the approach in which the target moves; in the rest it waits at the path's first point.
const LEADING: f64 = 0.5;

/// Leads the tip of `plant`, whose model is `robot` and whose tendons are under `start`, along `path` by `controller`. Each period it
/// measures, estimates, asks the controller, and commands. `each` sees every period, and may end the run by `false`.
///
/// # Errors
/// [`TrackingError`]; sensors and models that fail for a while are no errors but [`Incident`]s.
pub fn track(
    plant: &mut dyn Plant,
    robot: &Robot,
    start: &Command,
    path: &TipPath,
    controller: &mut dyn Controller,
    settings: &TrackingSettings,
    each: &mut dyn FnMut(&TrackingRow) -> bool,
) -> Result<Tracking, TrackingError> {
    let mut run = Run::new(plant, robot, start, controller, settings)?;
    let period = plant.period();
    let all = (settings.approach + path.duration()) / period;
    if !(0.0..=MOST_PERIODS).contains(&all) {
        return Err(TrackingError::Periods(all));
    }
    let periods = |time: f64| (time / period).round() as i64;
    let (first, last) = (-periods(settings.approach), periods(path.duration()));
    let mut lead_from = None;
    for k in first..=last {
        let measurement = plant.measure()?.finite();
        let tip = run.measured_tip(&measurement);
        let from = match lead_from {
            Some(from) => from,
            // Where the tip is not seen, the model says about where it is under the first command.
            None => match tip {
                Some(tip) => tip,
                None => run.given.tip(start.as_slice()).unwrap_or(path.at(0.0)),
            },
        };
        lead_from = Some(from);
        let ahead = Ahead {
            path,
            settings,
            from,
            period,
            now: k,
        };
        let row = run.step(plant, controller, &measurement, tip, &ahead)?;
        let goes_on = each(&row);
        run.tracking.rows.push(row);
        if run.tracking.stopped.is_none() && !goes_on {
            run.tracking.stopped = Some("it was interrupted".to_owned());
        }
        if run.tracking.stopped.is_some() {
            break;
        }
        if k < last {
            plant.command(&run.command(robot)?)?;
        }
    }
    Ok(run.finish())
}

/// Where the tip is to be, from one of the periods on.
struct Ahead<'a> {
    path: &'a TipPath,
    settings: &'a TrackingSettings,
    /// Where the tip was found (m).
    from: Vector3<f64>,
    period: f64,
    /// The period, counted from the path's start.
    now: i64,
}

impl Ahead<'_> {
    /// What time it is (s, from the path's start).
    fn time(&self) -> f64 {
        self.now as f64 * self.period
    }

    /// Where the tip is to be now (m).
    fn wanted(&self) -> Vector3<f64> {
        self.at(self.time(), Vector3::zeros())
    }

    /// Where the controller is to lead it, `periods` from now (m).
    fn target(&self, periods: usize) -> Vector3<f64> {
        let then = self.now + periods as i64;
        let correction = &self.settings.correction;
        let last = correction.len().saturating_sub(1);
        let correction = correction.get((then.max(0) as usize).min(last));
        let correction = correction.copied().unwrap_or_default();
        self.at(then as f64 * self.period, correction)
    }

    /// The path's point at `time` (s) and a correction; before its start, on the way there from where the tip was found, at rest at both ends.
    fn at(&self, time: f64, correction: Vector3<f64>) -> Vector3<f64> {
        let approach = self.settings.approach;
        let goal = self.path.at(time) + correction;
        if time >= 0.0 || approach <= 0.0 {
            return goal;
        }
        let part = ((time + approach) / (LEADING * approach)).clamp(0.0, 1.0);
        // Cubic, without a jump of the speed.
        self.from.lerp(&goal, part * part * (3.0 - 2.0 * part))
    }
}

/// State of a run.
struct Run<'s> {
    settings: &'s TrackingSettings,
    estimator: Estimator,
    /// The estimator before any measurement.
    prior: Estimator,
    given: Belief,
    watch: Watch,
    lag: Lag,
    jacobian: JacobianObserver,
    is_mismatch_said: bool,
    /// The last commands, the newest first: as many as may be on their way, and one more.
    commands: VecDeque<Vec<f64>>,
    tip_disc: usize,
    period: f64,
    tracking: Tracking,
}

impl<'s> Run<'s> {
    fn new(
        plant: &dyn Plant,
        robot: &Robot,
        start: &Command,
        controller: &dyn Controller,
        settings: &'s TrackingSettings,
    ) -> Result<Self, TrackingError> {
        if !(settings.approach.is_finite() && settings.approach >= 0.0) {
            return Err(TrackingError::Approach(settings.approach));
        }
        let tendons = robot.tendons().len();
        let limits = &settings.limits;
        let of_tendons = [&limits.low, &limits.high, &limits.step, &limits.preferred];
        for found in of_tendons.map(Vec::len) {
            if found != tendons {
                return Err(TrackingError::Limits {
                    found,
                    expected: tendons,
                });
            }
        }
        let start = robot.command(start.as_slice())?.as_slice().to_vec();
        let length = robot.arc_lengths().last().copied().unwrap_or(0.0);
        let mut given = Belief::new(robot, &settings.loads, &[])?.among(&settings.scene)?;
        // One that does not settle says so when it is asked.
        let _ = given.rest(&start);
        let estimator = Estimator::new(robot, &settings.loads, settings.estimator.clone())?
            .among(&settings.scene)?;
        Ok(Self {
            settings,
            prior: estimator.clone(),
            estimator,
            given,
            watch: Watch::new(settings.watch, plant.period(), length),
            lag: Lag::new(settings.delay),
            jacobian: JacobianObserver::new(
                (0..tendons).map(|t| limits.width(t)).collect(),
                length,
                settings.estimator.position,
            ),
            is_mismatch_said: false,
            commands: vec![start; settings.delay.most() + 1].into(),
            tip_disc: robot.discs().len() - 1,
            period: plant.period(),
            tracking: Tracking {
                controller: controller.name(),
                rows: Vec::new(),
                incidents: Vec::new(),
                stopped: None,
                unidentified: Vec::new(),
                length,
            },
        })
    }

    /// Where the tip was measured; where other points were, where the model has it after they were taken in is in [`Run::step`].
    fn measured_tip(&self, measurement: &Measurement) -> Option<Vector3<f64>> {
        measurement.origin_of(self.tip_disc)
    }

    /// Takes in where the tip is (m) to tell the delay. Where that changes, measurements so far were taken for answers to other commands than they
    /// are of, and what they told of the model is forgotten.
    fn observe_delay(&mut self, tip: Option<Vector3<f64>>) {
        let before = self.lag.periods();
        self.lag.measure(tip);
        if self.lag.periods() != before {
            self.jacobian.forget();
            self.estimator = self.prior.clone();
        }
    }

    fn command(&self, robot: &Robot) -> Result<Command, CommandError> {
        robot.command(&self.commands[0])
    }

    /// One period up to its command.
    fn step(
        &mut self,
        plant: &dyn Plant,
        controller: &mut dyn Controller,
        measurement: &Measurement,
        measured: Option<Vector3<f64>>,
        ahead: &Ahead<'_>,
    ) -> Result<TrackingRow, TrackingError> {
        let (time, wanted) = (ahead.time(), ahead.wanted());
        let target = |periods: usize| ahead.target(periods);
        let now = self.commands[0].clone();
        if measured.is_some() {
            self.observe_delay(measured);
        }
        let acting = self.commands[self.lag.periods()].clone();
        let estimated = self.estimator.update(&acting, measurement, self.period);
        let mut held = estimated.err().map(|error| error.to_string());
        // Without the tip itself, what else is seen tells where the model has it.
        let tip = match (measured, measurement.shows_robot()) {
            (Some(tip), _) => Some(tip),
            (None, true) => self.estimator.belief().tip(&acting).ok(),
            (None, false) => None,
        };
        if measured.is_none() {
            self.observe_delay(tip);
        }
        let acting = self.commands[self.lag.periods()].clone();
        // A tip that is the model's, told from a cloud, says nothing beside the model.
        let model = self.estimator.belief();
        let is_mismatch = self.jacobian.see(model, &acting, measured, self.period);
        let is_closed_loop = controller.is_closed_loop();
        if tip.is_none() && is_closed_loop {
            held = Some("the tip is not seen".to_owned());
        }
        let mut next = now.clone();
        if held.is_none() || !is_closed_loop {
            let mut moment = Moment {
                time,
                period: self.period,
                tip: tip.unwrap_or_else(|| target(0)),
                target: &target,
                lead: 1 + self.lag.periods(),
                delay: self.settings.delay,
                estimated: self.estimator.belief(),
                given: &mut self.given,
                jacobian_correction: self.jacobian.correction(),
                command: &now,
                acting: &acting,
                limits: &self.settings.limits,
                tensions: measurement.tensions.as_deref(),
            };
            match controller.propose(&mut moment) {
                Ok(proposed) => (next, held) = (proposed, None),
                Err(error) => held = Some(error.to_string()),
            }
        }
        let next = self.settings.limits.admit(&now, next);
        let error = tip.map(|tip| (tip - wanted).norm());
        let moved = (next.iter().zip(&now).enumerate())
            .map(|(t, (a, b))| ((a - b) / self.settings.limits.step[t]).abs())
            .fold(0.0, f64::max);
        let tracking = &mut self.tracking;
        if let Some(incident) = self.watch.see(time, error, moved, held.as_deref()) {
            if incident.is_end {
                tracking.stopped = Some(incident.reason.clone());
            }
            tracking.incidents.push(incident);
        }
        if is_mismatch && !self.is_mismatch_said {
            self.is_mismatch_said = true;
            tracking.incidents.push(Incident {
                time,
                reason: MISMATCH.to_owned(),
                is_end: false,
            });
        }
        let model = self.estimator.belief();
        let ends = [model.tip(&next), model.tip(&now)];
        self.lag.command(match ends {
            [Ok(next), Ok(now)] => next - now,
            _ => Vector3::zeros(),
        });
        self.commands.push_front(next.clone());
        self.commands.truncate(self.settings.delay.most() + 1);
        Ok(TrackingRow {
            time,
            target: wanted,
            measured,
            seen: tip,
            tip: plant.true_tip().or(tip),
            command: next,
            tensions: measurement.tensions.clone(),
            estimated: self.estimator.estimated(),
            delay: (controller.delay()).unwrap_or(self.lag.periods()),
            held,
        })
    }

    fn finish(mut self) -> Tracking {
        self.tracking.unidentified = self.estimator.unidentified();
        self.tracking
    }
}
