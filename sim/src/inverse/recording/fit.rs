//! The fit of a recording.

use std::ops::ControlFlow;

use nalgebra::{DVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::explicit::Explicit;
use super::facts::{Facts, length};
use super::interval::{Correlation, FittedUnknown, correlations, fitted};
use super::path::has_friction;
use super::problem::{Memory, Problem, Weighing};
use super::unknowns::{believe, unknowns};
use super::{Group, Order, Recording, RecordingError, Replay, Residuals, Transmission, check};
use crate::inverse::Priors;
use crate::inverse::least_squares::{Evaluation, minimise};
use crate::robot::{Robot, RobotSpec};
use crate::tendon_friction::Tangents;

/// Rows of the first fit.
const FEW_ROWS: usize = 300;
/// Iterations of the first fit and of the second, at most.
const STEPS: [usize; 2] = [40, 25];
/// Decrease of the cost in one iteration that ends a fit, as a share of the cost.
const ENOUGH: f64 = 1e-4;
/// What a model is first taken to miss, as a share of the robot's length.
const FIRST_ERROR: f64 = 0.04;
/// Spread of other starts, in standard deviations of the priors.
const START_SPREAD: f64 = 1.0;
/// Rows over which residuals may be correlated, as a share of all.
const LONGEST: f64 = 0.2;

/// How a recording is fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingSettings {
    /// What is unknown.
    pub groups: Vec<Group>,
    /// What is known of them, where it is not what the robot file and the table of unknowns say.
    pub priors: Priors,
    /// Distance beyond which a marker's or a point's residual counts less than by its square (m); none for a fortieth of the robot's
    /// length, infinite for least squares.
    pub loss: Option<f64>,
    /// Starts of the first fit: the robot file's values, then others at random. The best goes on.
    pub starts: usize,
    /// Seed of the random starts.
    pub seed: u64,
}

impl Default for RecordingSettings {
    fn default() -> Self {
        Self {
            groups: vec![
                Group::Pretension,
                Group::SpoolRadius,
                Group::Backlash,
                Group::Lag,
                Group::HoleAngles,
                Group::Twist,
                Group::Stiffness,
                Group::Torsion,
                Group::RestBend,
                Group::TendonStiffness,
                Group::BasePose,
                Group::MarkerOffset,
                Group::Gravity,
                Group::Mass,
            ],
            priors: Priors::default(),
            loss: None,
            starts: 1,
            seed: 0,
        }
    }
}

impl RecordingSettings {
    /// The default, without the groups that a robot, or a recording whose rows are in `order`, does not have: of tendons that do not
    /// stretch, of joints without elasticity, of weight where there is no gravity, and of motion where each row is at rest.
    pub fn of(robot: &RobotSpec, order: Order) -> Self {
        let mut settings = Self::default();
        let groups = &mut settings.groups;
        groups.retain(|group| group.missing(robot, order).is_none());
        settings
    }
}

/// How far a fit is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Iterations done, of all that there can be.
    pub done: usize,
    /// See `done`.
    pub most: usize,
    /// Root mean square of the residuals in this iteration (m), large ones counted less.
    pub rms: f64,
}

/// A robot calibrated on a recording.
#[derive(Clone, Debug)]
pub struct RecordingFit {
    /// The robot, with routes and holes of its own for each tendon.
    pub spec: RobotSpec,
    /// What lies between it and the recording.
    pub transmission: Transmission,
    /// What was found of each unknown.
    pub unknowns: Vec<FittedUnknown>,
    /// Pairs of unknowns that the recording hardly makes identifiable one by one, the most correlated first.
    pub correlations: Vec<Correlation>,
    /// Correlation length of the residuals (rows).
    pub correlation_length: f64,
    /// Residuals of the robot as given.
    pub before: Residuals,
    /// Residuals of the calibrated robot.
    pub after: Residuals,
    /// Iterations done.
    pub steps: usize,
}

/// Finds the unknowns of `settings` on a recording, starting from a robot and a transmission; tells `watch` after each iteration,
/// and stops where that says so, or within an iteration where `stop`, which every thread asks at every row, does.
///
/// The result is the same for any number of threads.
///
/// # Errors
/// [`RecordingError`] for input that makes no sense, a robot that settles in less than half of the rows, and
/// [`RecordingError::Interrupted`] where `watch` or `stop` stopped it.
pub fn fit_recording(
    first: &RobotSpec,
    transmission: &Transmission,
    recording: &Recording,
    settings: &RecordingSettings,
    watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<RecordingFit, RecordingError> {
    check(first, transmission, recording)?;
    let explicit = Explicit::new(first)?;
    let before = Replay::new(first, transmission, recording)?.residuals(recording);
    let (rows, settled) = (recording.len(), recording.len() - before.unsettled.len());
    if 2 * settled < rows || rows == 0 {
        return Err(RecordingError::Unsettled { settled, rows });
    }
    let facts = Facts {
        groups: &settings.groups,
        explicit: &explicit,
        transmission,
        recording,
    };
    let mut unknowns = unknowns(&facts)?;
    believe(&settings.priors, &mut unknowns, &facts)?;
    let coordinates = recording.coordinates();
    if coordinates <= unknowns.len() {
        return Err(RecordingError::TooFew {
            coordinates,
            unknowns: unknowns.len(),
        });
    }
    let length = length(first);
    let robot = Robot::new(explicit.spec.clone())?;
    let paths = settings.groups.contains(&Group::Friction) || has_friction(&robot);
    let friction = paths && recording.order == Order::Motion;
    if friction && Tangents::new(&robot, Vec::new()).is_none() {
        return Err(RecordingError::Group {
            group: Group::Friction,
            reason: "a tendon skips discs, along which derivatives of paths with friction are not carried",
        });
    }
    let problem = Problem {
        explicit: &explicit,
        transmission,
        recording,
        speeds: recording.speeds(),
        unknowns: &unknowns,
        loss: settings.loss.unwrap_or(length / 40.0),
        friction: false,
        stop,
    };
    let starts = settings.starts.max(1);
    let mut fitting = Fitting {
        problem: &problem,
        watch,
        progress: Progress {
            done: 0,
            most: starts * STEPS[0] + STEPS[1],
            rms: f64::NAN,
        },
    };
    // Few rows show where the minimum is; all of them then say how well the model does.
    let stride = rows.div_ceil(FEW_ROWS);
    let few = Weighing {
        rows: (0..rows).step_by(stride).collect(),
        error: FIRST_ERROR * length,
    };
    let mut best: Option<Found> = None;
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    for start in 0..starts {
        let x = DVector::from_iterator(
            unknowns.len(),
            unknowns.iter().map(|unknown| {
                let [low, high] = unknown.sought.limit().range;
                let away = if start == 0 {
                    0.0
                } else {
                    START_SPREAD * (2.0 * rng.random::<f64>() - 1.0)
                };
                away.clamp(low, high)
            }),
        );
        let found = fitting.descend(x, &few, &vec![None; rows], STEPS[0])?;
        if best
            .as_ref()
            .is_none_or(|best| found.at.cost() < best.at.cost())
        {
            best = Some(found);
        }
    }
    let Some(found) = best else {
        return Err(RecordingError::Unsettled { settled: 0, rows });
    };
    fitting.progress.done = starts * STEPS[0];
    let (spec, there) = problem.values(&found.x);
    let residuals = Replay::new(&spec, &there, recording)?.residuals(recording);
    let length_of_rows = correlation_length(&residuals);
    // Per coordinate, in so many rows that count as one; residuals of one row are correlated too.
    let error = (residuals.squares() / 3.0 * length_of_rows / rows as f64).sqrt();
    let all = Weighing {
        rows: (0..rows).collect(),
        error: error.max(1e-9 * length),
    };
    let along = Problem {
        friction,
        ..problem.clone()
    };
    fitting.problem = &along;
    let found = fitting.descend(found.x, &all, &found.at.memory, STEPS[1])?;
    let steps = fitting.progress.done;
    let (spec, there) = problem.values(&found.x);
    let after = Replay::new(&spec, &there, recording)?.residuals(recording);
    let covariance = super::interval::covariance(&found.at.jacobian, all.error);
    let spec = with_ranges(spec, first, &problem, &found.x)?;
    Ok(RecordingFit {
        unknowns: fitted(&unknowns, &found.x, &covariance),
        correlations: correlations(&unknowns, &covariance),
        spec,
        transmission: there,
        correlation_length: length_of_rows,
        before,
        after,
        steps,
    })
}

struct Found {
    x: DVector<f64>,
    at: Evaluation<Memory>,
}

struct Fitting<'a> {
    problem: &'a Problem<'a>,
    watch: &'a mut dyn FnMut(Progress) -> ControlFlow<()>,
    progress: Progress,
}

impl Fitting<'_> {
    fn descend(
        &mut self,
        x: DVector<f64>,
        weighing: &Weighing,
        memory: &Memory,
        steps: usize,
    ) -> Result<Found, RecordingError> {
        let rows = self.problem.recording.len();
        let stop = self.problem.stop;
        let first = self.problem.evaluate(&x, weighing, memory);
        if stop() {
            return Err(RecordingError::Interrupted);
        }
        let Some(first) = first else {
            return Err(RecordingError::Unsettled { settled: 0, rows });
        };
        let measured = self.problem.measured(&weighing.rows) as f64;
        let mut last = f64::INFINITY;
        let mut stopped = false;
        let (progress, watch) = (&mut self.progress, &mut self.watch);
        let done = |_: &DVector<f64>, at: &Evaluation<Memory>| {
            let cost = at.cost();
            progress.rms = (cost / measured).sqrt();
            if stop() || watch(*progress).is_break() {
                stopped = true;
                return true;
            }
            progress.done += 1;
            let ended = cost < last && last - cost < ENOUGH * cost;
            last = cost;
            ended
        };
        let limits = self.problem.limits();
        let evaluate =
            |x: &DVector<f64>, memory: &Memory| self.problem.evaluate(x, weighing, memory);
        let fit = minimise(x, first, &limits, steps, evaluate, done);
        match stopped || stop() {
            true => Err(RecordingError::Interrupted),
            false => Ok(Found {
                x: fit.x,
                at: fit.at,
            }),
        }
    }
}

/// Correlation length of the residuals (rows): `1 + 2 sum rho_k` over the lags `k` until the autocorrelation `rho_k` of the
/// residuals vanishes. Of errors that are independent it is 1.
fn correlation_length(residuals: &Residuals) -> f64 {
    let rows = residuals.markers.len();
    let product = |a: &[Option<Vector3<f64>>], b: &[Option<Vector3<f64>>]| -> Option<f64> {
        let pairs = a
            .iter()
            .zip(b)
            .filter_map(|(a, b)| Some(a.as_ref()?.dot(b.as_ref()?)));
        pairs.reduce(|a, b| a + b)
    };
    let covariance = |lag: usize| {
        let all: Vec<f64> = (lag..rows)
            .filter_map(|row| product(&residuals.markers[row], &residuals.markers[row - lag]))
            .collect();
        all.iter().sum::<f64>() / all.len().max(1) as f64
    };
    let variance = covariance(0);
    if variance <= 0.0 {
        return 1.0;
    }
    let longest = (LONGEST * rows as f64) as usize;
    let lags = (1..longest).map(|lag| covariance(lag) / variance);
    1.0 + 2.0 * lags.take_while(|rho| *rho > 0.05).sum::<f64>()
}

/// The robot with ranges that hold its own commands, and those of the recording.
fn with_ranges(
    mut spec: RobotSpec,
    first: &RobotSpec,
    problem: &Problem,
    x: &DVector<f64>,
) -> Result<RobotSpec, RecordingError> {
    let model = problem.model(x)?;
    for (t, (route, first)) in spec.routes.iter_mut().zip(first.tendons()).enumerate() {
        let commands = model.commands.iter().map(|command| command[t]);
        let [low, high] = first.range;
        route.tendon.range = commands.fold([low, high], |[low, high], c| [low.min(c), high.max(c)]);
    }
    Ok(spec)
}
