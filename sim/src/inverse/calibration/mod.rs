//! Calibration: the stiffnesses, densities and dimensions that explain measured disc positions.
//!
//! Least squares over any of the robot's [`Parameter`](crate::robot::Parameter)s, with standard errors and 95 % intervals of
//! the linearised model (Seber and Wild, Nonlinear Regression, ch. 5). What the data cannot tell is
//! said, not estimated: see [`Finding`].
//!
//! ```
//! use rand::SeedableRng;
//! use tdcr_sim::inverse::calibration::{CalibrationSettings, Finding, Observation, Unknown, calibrate};
//! use tdcr_sim::robot::{Loads, Parameter, Robot, RobotSpec};
//!
//! // The robot as it is, and 20 positions of its tip under known commands and payloads.
//! let nominal = RobotSpec::load("2m")?;
//! let gains = Unknown::shared("gain", (0..6).map(Parameter::Gain));
//! let real = Robot::new(gains.set(&nominal, 430.0)?)?;
//! let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
//! let observe = |_| {
//!     let (command, loads) = (real.random_command(&mut rng), Loads::payload(0.02)?);
//!     let tip = real.settle(&command, &loads).positions[9];
//!     Ok(Observation { command, loads, positions: vec![(9, tip)] })
//! };
//! let observations = (0..20).map(observe).collect::<Result<Vec<_>, tdcr_sim::robot::LoadsError>>()?;
//!
//! let found = calibrate(&nominal, &[gains], &observations, &CalibrationSettings::default())?;
//! let Finding::Identified(gain) = &found.identification.findings[0] else { panic!("the gain is identified") };
//! assert!((gain.value - 430.0).abs() < 1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The errors of measurement are taken to be independent, all of the same size, and to have no mean; the commands and loads to be
//! known. Frames of cameras and robot must agree. How large the errors are is found from the residuals, unless it is stated.
//!
//! What is known of unknowns before the fit are normal [priors](CalibrationSettings::priors): each is a measurement of its unknown,
//! with the prior's standard deviation as its error. The values are then those of largest posterior density, and standard errors
//! those of the posterior of the linearised model (Bishop, Pattern Recognition and Machine Learning, 2006, ch. 3.3).

mod error;
mod identify;
mod problem;
mod unknown;

pub use error::CalibrationError;
pub use identify::{Estimate, Finding, Identification};
pub use unknown::Unknown;

use nalgebra::{DVector, Vector3};

use super::Priors;
use super::least_squares::{Evaluation, Limit, left_to_gain, minimise};
use crate::robot::{Command, Loads, RobotSpec};
use crate::statics::Equilibrium;
use identify::{Found, identify};
use problem::{Problem, Start};

/// Steps of the minimisation at most.
const MAX_STEPS: usize = 200;
/// Times that a fit goes on from nearer equilibria of commands that have several.
const MAX_RETURNS: usize = 5;
/// Length of the steps of the fit with short steps, relative to how far the unknowns' effects are about linear.
const SHORT: f64 = 0.2;
/// How far the fit may be from the minimum, as a share of the confidence region's radius: the relative
/// offset of Bates and Watts (A relative offset orthogonality convergence criterion, 1981).
const OFFSET: f64 = 1e-3;
/// Residuals (m, root mean square) that settling itself leaves; a fit as good as that is exact.
const EXACT: f64 = 1e-9;

/// What was measured of the robot at rest under one command.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// The command.
    pub command: Command,
    /// The loads.
    pub loads: Loads,
    /// Discs, from 0 at the base, and where their origins were measured (m, world frame).
    pub positions: Vec<(usize, Vector3<f64>)>,
}

/// What is known beside the observations.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CalibrationSettings {
    /// Priors and bounds, by the unknowns' names. A [value](super::Prior::value) replaces the robot's as the first one, and as the
    /// mean of the prior; a [spread](super::Prior::spread) is a standard deviation in the unknown's unit, and one below a
    /// millionth of the value counts as so much.
    pub priors: Priors,
    /// Standard deviation of the errors of a measured coordinate (m), which spreads are weighed against; none, and no spread, to
    /// find it from the residuals.
    pub error: Option<f64>,
}

/// How a fit ended. Whatever it is, the values are the best that were found.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq)]
pub enum FitState {
    /// At a minimum, to a thousandth of the errors of measurement; all unknowns within their bounds.
    Converged,
    /// At a minimum within the bounds of what a robot can have, or those given, with these unknowns, by their place in the list,
    /// at a bound.
    AtBound(Vec<usize>),
    /// Short of a minimum: no step brought anything, for example where the equilibrium of an
    /// observation vanishes, or the steps were used up. The values explain the observations as well as
    /// [`Calibration::residual_rms`] says; standard errors and intervals do not hold. Other first
    /// values, or fewer unknowns first, may lead further.
    Halted {
        /// What the linear model says is left to gain, relative to the confidence region's radius
        /// (Bates and Watts' relative offset); 0.001 or less would be a minimum.
        offset: f64,
    },
}

/// A calibrated robot.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The robot with the values found. Where unknowns are not identified, it is one of many that
    /// explain the observations as well.
    pub spec: RobotSpec,
    /// What the observations say of the unknowns.
    pub identification: Identification,
    /// How the fit ended.
    pub state: FitState,
    /// Root mean square of the residuals, over all measured coordinates (m).
    pub residual_rms: f64,
    /// Steps tried.
    pub steps: usize,
}

/// Finds the values of `unknowns` that explain `observations` best, starting from those of `first`.
///
/// Where a command has several equilibria, the nearest to its observation counts, of those that the fits have met.
///
/// A fit ends in a local minimum, and which one depends on its way: after long steps an observation may follow another
/// equilibrium. Therefore four fits start from the first values, and the best one is the result: of all unknowns at once with
/// long steps; with short steps; of one unknown after another, the one with the largest decrease by the linear model first;
/// and of one after another in the order of the list. For `n` unknowns these are `2 n + 2` minimisations, most of which
/// start near their end.
///
/// The result is never worse than any of the four. That unknowns added to a list never end in a worse fit is not
/// guaranteed, as the search for the best minimum is not exhaustive. Measured on ten altered 2m robots, half of which have
/// holes out of place that no unknown explains: of 150 pairs of sets of 3 to 9 unknowns in random orders, one in the other, one
/// ended worse with more unknowns by more than 0.1 %, by 15 % (62 mm instead of 54 mm, with 4 unknowns and with 3).
///
/// # Errors
/// [`CalibrationError`] for input that makes no sense, and a robot that does not settle with the first
/// values. A fit that stops before a minimum is not an error: see [`Calibration::state`].
pub fn calibrate(
    first: &RobotSpec,
    unknowns: &[Unknown],
    observations: &[Observation],
    settings: &CalibrationSettings,
) -> Result<Calibration, CalibrationError> {
    let (problem, start) = Problem::new(first, unknowns, observations, settings)?;
    let limits = problem.limits();
    let Fitted { x, mut at, steps } = best(&problem, &start, &limits)?;
    let residual_rms = rms(&at, problem.coordinates());
    let state = state(&x, &at, &limits, residual_rms, settings.error);
    let spec = problem.spec(&x)?;
    let values = problem.values(&x);
    let found = |(place, unknown): (usize, &Unknown)| Found {
        value: values[place],
        bounds: problem.sought[place].bounds,
        stopped: limits[place].stops(x[place]),
        scale: unknown.scale(&spec, values[place]),
        spread: problem.spread(place),
    };
    let found: Vec<Found> = unknowns.iter().enumerate().map(found).collect();
    problem.by_values(&x, &mut at.jacobian);
    let measured = problem.coordinates();
    Ok(Calibration {
        identification: identify(&found, &at, measured, settings.error),
        spec,
        state,
        residual_rms,
        steps,
    })
}

/// Residuals and derivatives, with every observation's equilibrium.
type Evaluated = Evaluation<Vec<Equilibrium>>;

/// Where a descent ended.
struct Fitted {
    x: DVector<f64>,
    at: Evaluated,
    steps: usize,
}

/// The best of four fits from the first values, continued with the equilibria that the others found.
fn best(
    problem: &Problem,
    start: &DVector<f64>,
    limits: &[Limit],
) -> Result<Fitted, CalibrationError> {
    let all: Vec<usize> = (0..start.len()).collect();
    let shorten = |limit: &Limit| Limit {
        reach: SHORT * limit.reach,
        ..*limit
    };
    let short: Vec<Limit> = limits.iter().map(shorten).collect();
    let mut fits = Vec::new();
    for limits in [limits, &short] {
        let at = problem.evaluate(start, &all, Start::Straight)?;
        fits.push(descend(problem, &all, start.clone(), at, limits, &[]));
    }
    if start.len() > 1 {
        for order in [Order::Gain, Order::Given] {
            let at = problem.evaluate(start, &all, Start::Straight)?;
            fits.extend(staged(problem, start.clone(), at, limits, order));
        }
    }
    let steps: usize = fits.iter().map(|fit| fit.steps).sum();
    fits.sort_by(|a, b| a.at.cost().total_cmp(&b.at.cost()));
    let best = fits.remove(0);
    let others: Vec<&[Equilibrium]> = fits.iter().map(|fit| &fit.at.memory[..]).collect();
    let mut best = descend(problem, &all, best.x, best.at, limits, &others);
    best.steps += steps;
    Ok(best)
}

/// Which unknown is freed next.
#[derive(Clone, Copy)]
enum Order {
    /// The one with which the linear model promises the largest decrease.
    Gain,
    /// The next of the list.
    Given,
}

/// Frees one unknown after another, each where the fit of those before has ended. `None` where the robot does not settle
/// there.
fn staged(
    problem: &Problem,
    mut x: DVector<f64>,
    mut at: Evaluated,
    limits: &[Limit],
    order: Order,
) -> Option<Fitted> {
    let all: Vec<usize> = (0..x.len()).collect();
    let (mut free, mut held) = (Vec::new(), all.clone());
    let mut steps = 0;
    while !held.is_empty() {
        let gain = |&unknown: &usize| {
            let with = [&free[..], &[unknown]].concat();
            let limits: Vec<Limit> = with.iter().map(|&i| limits[i]).collect();
            left_to_gain(&x.select_rows(&with), &columns(&at, &with), &limits)
        };
        let place = match order {
            Order::Given => 0,
            Order::Gain => {
                let gains: Vec<f64> = held.iter().map(gain).collect();
                // The first of equal ones.
                (0..held.len())
                    .rev()
                    .max_by(|&a, &b| gains[a].total_cmp(&gains[b]))?
            }
        };
        free.push(held.remove(place));
        let found = descend(problem, &free, x, columns(&at, &free), limits, &[]);
        steps += found.steps;
        let last = Start::Last(&found.at.memory);
        at = problem.evaluate(&found.x, &all, last).ok()?;
        x = found.x;
    }
    Some(Fitted { x, at, steps })
}

/// The part of an evaluation that these unknowns have.
fn columns(at: &Evaluated, unknowns: &[usize]) -> Evaluated {
    Evaluation {
        residuals: at.residuals.clone(),
        jacobian: at.jacobian.select_columns(unknowns),
        memory: at.memory.clone(),
    }
}

/// Descends over the unknowns in `free` from `x`; goes on where another equilibrium of a command is nearer to what was
/// observed.
fn descend(
    problem: &Problem,
    free: &[usize],
    x: DVector<f64>,
    at: Evaluated,
    limits: &[Limit],
    others: &[&[Equilibrium]],
) -> Fitted {
    let limits: Vec<Limit> = free.iter().map(|&i| limits[i]).collect();
    let whole = |part: &DVector<f64>| {
        let mut whole = x.clone();
        free.iter()
            .zip(part)
            .for_each(|(&i, &value)| whole[i] = value);
        whole
    };
    let mut part = DVector::from_fn(free.len(), |k, _| x[free[k]]);
    let (mut at, mut steps) = (at, 0);
    for _ in 0..MAX_RETURNS {
        let evaluate = |part: &DVector<f64>, last: &Vec<Equilibrium>| {
            problem.evaluate(&whole(part), free, Start::Last(last)).ok()
        };
        let done = |_: &DVector<f64>, at: &Evaluation<_>| at.cost() == 0.0;
        let found = minimise(part, at, &limits, MAX_STEPS, evaluate, done);
        steps += found.steps;
        (part, at) = (found.x, found.at);
        match problem.evaluate(&whole(&part), free, Start::Nearest(&at.memory, others)) {
            Ok(nearer) if nearer.cost() < at.cost() * (1.0 - 1e-6) => at = nearer,
            _ => break,
        }
    }
    let x = whole(&part);
    Fitted { x, at, steps }
}

/// How a fit that ended at `x` did, by the root mean square of its residuals and the errors of measurement where they are stated.
fn state(
    x: &DVector<f64>,
    at: &Evaluated,
    limits: &[Limit],
    rms: f64,
    error: Option<f64>,
) -> FitState {
    let freedom = (at.residuals.len() - x.len()) as f64;
    let noise = error.unwrap_or_else(|| (at.cost() / freedom).sqrt());
    let offset = (left_to_gain(x, at, limits) / x.len() as f64).sqrt() / noise;
    if rms > EXACT && offset > OFFSET {
        return FitState::Halted { offset };
    }
    let stopped: Vec<usize> = (0..x.len()).filter(|&i| limits[i].stops(x[i])).collect();
    match stopped.is_empty() {
        true => FitState::Converged,
        false => FitState::AtBound(stopped),
    }
}

/// Root mean square of the residuals of the `measured` coordinates (m).
fn rms(at: &Evaluated, measured: usize) -> f64 {
    (at.residuals.rows(0, measured).norm_squared() / measured as f64).sqrt()
}
