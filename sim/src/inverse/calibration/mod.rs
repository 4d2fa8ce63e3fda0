//! Calibration: the stiffnesses, densities and dimensions that explain measured disc positions.
//!
//! Least squares over any of the robot's [`Parameter`](crate::robot::Parameter)s, with standard errors and 95 % intervals of
//! the linearised model (Seber and Wild, Nonlinear Regression, ch. 5). What the data cannot tell is
//! said, not estimated: see [`Finding`].
//!
//! ```
//! use rand::SeedableRng;
//! use tdcr_sim::inverse::calibration::{Finding, Observation, Unknown, calibrate};
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
//! let found = calibrate(&nominal, &[gains], &observations)?;
//! let Finding::Identified(gain) = &found.identification.findings[0] else { panic!("the gain is identified") };
//! assert!((gain.value - 430.0).abs() < 1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The errors of measurement are taken to be independent, all of the same unknown size, and to have
//! no mean; the commands and loads to be known. Frames of cameras and robot must agree.

mod coordinate;
mod error;
mod identify;
mod problem;
mod unknown;

pub use error::CalibrationError;
pub use identify::{Estimate, Finding, Identification};
pub use unknown::Unknown;

use nalgebra::{DVector, Vector3};

use super::least_squares::{Evaluation, Limit, left_to_gain, minimise};
use crate::robot::{Command, Loads, RobotSpec};
use crate::statics::Equilibrium;
use problem::{Problem, Start};

/// Steps of the minimisation at most.
const MAX_STEPS: usize = 200;
/// Times that a fit goes on from the other equilibria of commands that have two.
const MAX_RETURNS: usize = 5;
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

/// How a fit ended. Whatever it is, the values are the best that were found.
#[derive(Clone, Debug, PartialEq)]
pub enum FitState {
    /// At a minimum, to a thousandth of the errors of measurement; all unknowns within their bounds.
    Converged,
    /// At a minimum within the bounds of what a robot can have, with these unknowns, by their place in
    /// the list, at a bound.
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
    /// Root mean square of the residuals, over all coordinates (m).
    pub residual_rms: f64,
    /// Steps tried.
    pub steps: usize,
}

/// Finds the values of `unknowns` that explain `observations` best, starting from those of `first`.
///
/// Where a command has two equilibria, the one nearer to its observation counts. The first unknown is
/// fitted by itself, then the first two, and so on: unknowns added at the end of the list never end in
/// a worse fit. List those that matter most first.
///
/// # Errors
/// [`CalibrationError`] for input that makes no sense, and a robot that does not settle with the first
/// values. A fit that does not come to a minimum is none: see [`Calibration::state`].
pub fn calibrate(
    first: &RobotSpec,
    unknowns: &[Unknown],
    observations: &[Observation],
) -> Result<Calibration, CalibrationError> {
    let (problem, start) = Problem::new(first, unknowns, observations)?;
    let limits = problem.limits();
    let Fitted { x, mut at, steps } = best(&problem, &start, &limits)?;
    let state = state(&x, &at, &limits);
    let values = problem.values(&x);
    let spec = problem.spec(&x)?;
    let scales: Vec<f64> = (unknowns.iter().zip(&values))
        .map(|(unknown, value)| unknown.scale(&spec, *value))
        .collect();
    problem.by_values(&x, &mut at.jacobian);
    let stopped: Vec<bool> = (x.iter().zip(&limits))
        .map(|(x, limit)| limit.stops(*x))
        .collect();
    let identification = identify::identify(&values, &at, &stopped, &scales);
    Ok(Calibration {
        spec,
        identification,
        state,
        residual_rms: rms(&at),
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

/// The fit of the first unknown, then of the first two, and so on to all. Each starts at the first values;
/// where that ends worse than the fit with one unknown less, at the latter: so no fit is worse than
/// that of the unknowns at the head of its list.
fn best(
    problem: &Problem,
    start: &DVector<f64>,
    limits: &[Limit],
) -> Result<Fitted, CalibrationError> {
    let mut last: Option<Fitted> = None;
    for count in 1..=start.len() {
        let (problem, limits) = (problem.head(count), &limits[..count]);
        let first = start.rows(0, count).into_owned();
        let at = problem.evaluate(&first, Start::Straight)?;
        let mut found = descend(&problem, first, at, limits);
        if let Some(fewer) = last {
            found.steps += fewer.steps;
            if found.at.cost() > fewer.at.cost() {
                let x = fewer.x.push(start[count - 1]);
                if let Ok(at) = problem.evaluate(&x, Start::Last(&fewer.at.memory)) {
                    let more = descend(&problem, x, at, limits);
                    found.steps += more.steps;
                    if more.at.cost() < found.at.cost() {
                        (found.x, found.at) = (more.x, more.at);
                    }
                }
            }
        }
        last = Some(found);
    }
    last.ok_or(CalibrationError::NoUnknown)
}

/// Descends from `x`; goes on where a command's other equilibrium is nearer to what was observed.
fn descend(problem: &Problem, mut x: DVector<f64>, mut at: Evaluated, limits: &[Limit]) -> Fitted {
    let mut steps = 0;
    for _ in 0..MAX_RETURNS {
        let evaluate =
            |x: &DVector<f64>, last: &Vec<Equilibrium>| problem.evaluate(x, Start::Last(last)).ok();
        let done = |_: &DVector<f64>, at: &Evaluation<_>| at.cost() == 0.0;
        let found = minimise(x, at, limits, MAX_STEPS, evaluate, done);
        steps += found.steps;
        (x, at) = (found.x, found.at);
        match problem.evaluate(&x, Start::Nearer(&at.memory)) {
            Ok(nearer) if nearer.cost() < at.cost() * (1.0 - 1e-6) => at = nearer,
            _ => break,
        }
    }
    Fitted { x, at, steps }
}

/// How a fit that ended at `x` did.
fn state(x: &DVector<f64>, at: &Evaluated, limits: &[Limit]) -> FitState {
    let freedom = (at.residuals.len() - x.len()) as f64;
    let noise = (at.cost() / freedom).sqrt();
    let offset = (left_to_gain(x, at, limits) / x.len() as f64).sqrt() / noise;
    if rms(at) > EXACT && offset > OFFSET {
        return FitState::Halted { offset };
    }
    let stopped: Vec<usize> = (0..x.len()).filter(|&i| limits[i].stops(x[i])).collect();
    match stopped.is_empty() {
        true => FitState::Converged,
        false => FitState::AtBound(stopped),
    }
}

/// Root mean square of the residuals (m).
fn rms(at: &Evaluated) -> f64 {
    (at.cost() / at.residuals.len() as f64).sqrt()
}
