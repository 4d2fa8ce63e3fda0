//! Calibration: the stiffnesses, densities and dimensions that explain measured disc positions.
//!
//! Least squares over any of the robot's [`Parameter`](crate::sensitivity::Parameter)s, with standard errors and 95 % intervals of
//! the linearised model (Seber and Wild, Nonlinear Regression, ch. 5). What the data cannot tell is
//! said, not estimated: see [`Finding`].
//!
//! ```
//! use rand::SeedableRng;
//! use tdcr_sim::inverse::calibration::{Finding, Observation, Unknown, calibrate};
//! use tdcr_sim::robot::{Loads, Robot, RobotSpec};
//! use tdcr_sim::sensitivity::Parameter;
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
//! let observations = (0..20).map(observe).collect::<Result<Vec<_>, tdcr_sim::robot::LoadError>>()?;
//!
//! let found = calibrate(&nominal, &[gains], &observations)?;
//! let Finding::Identified(gain) = &found.identification.findings[0] else { panic!("the gain is identified") };
//! assert!((gain.value - 430.0).abs() < 1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The errors of measurement are taken to be independent, all of the same unknown size, and to have
//! no mean; the commands and loads to be known. Frames of cameras and robot must agree.

mod error;
mod identify;
mod problem;
mod unknown;

pub use error::CalibrationError;
pub use identify::{Estimate, Finding, Identification};
pub use unknown::Unknown;

use nalgebra::{DVector, Vector3};

use super::least_squares::{Evaluation, left_to_gain, minimise};
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

/// A calibrated robot.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The robot with the values found. Where unknowns are not identified, it is one of many that
    /// explain the observations as well.
    pub spec: RobotSpec,
    /// What the observations say of the unknowns.
    pub identification: Identification,
    /// Root mean square of the residuals, over all coordinates (m).
    pub residual_rms: f64,
    /// Steps tried.
    pub steps: usize,
}

/// Finds the values of `unknowns` that explain `observations` best, starting from those of `first`.
///
/// Where a command has two equilibria, the one nearer to its observation counts.
///
/// # Errors
/// [`CalibrationError`] for input that makes no sense, a robot that does not settle, and a fit that
/// does not come to a minimum.
pub fn calibrate(
    first: &RobotSpec,
    unknowns: &[Unknown],
    observations: &[Observation],
) -> Result<Calibration, CalibrationError> {
    let problem = Problem {
        first,
        unknowns,
        observations,
    };
    let start = problem.check()?;
    let bounds: Vec<[f64; 2]> = (unknowns.iter().zip(&start))
        .map(|(unknown, value)| unknown.bounds(*value))
        .collect();
    let mut x = start;
    let mut at = problem.evaluate(&x, Start::Straight)?;
    let mut steps = 0;
    for _ in 0..MAX_RETURNS {
        let evaluate =
            |x: &DVector<f64>, last: &Vec<Equilibrium>| problem.evaluate(x, Start::Last(last)).ok();
        let done = |_: &DVector<f64>, at: &Evaluation<_>| at.cost() == 0.0;
        let found = minimise(x, at, &bounds, MAX_STEPS, evaluate, done);
        steps += found.steps;
        (x, at) = (found.x, found.at);
        match problem.evaluate(&x, Start::Nearer(&at.memory)) {
            Ok(nearer) if nearer.cost() < at.cost() * (1.0 - 1e-6) => at = nearer,
            _ => break,
        }
    }
    let residual_rms = (at.cost() / at.residuals.len() as f64).sqrt();
    let freedom = (at.residuals.len() - x.len()) as f64;
    let offset = (left_to_gain(&x, &at, &bounds) / x.len() as f64).sqrt();
    if residual_rms > EXACT && offset > OFFSET * (at.cost() / freedom).sqrt() {
        return Err(CalibrationError::Stalled {
            steps,
            residual_rms,
        });
    }
    let spec = problem.spec(&x)?;
    let scales: Vec<f64> = (unknowns.iter().zip(&x))
        .map(|(unknown, value)| unknown.scale(&spec, *value))
        .collect();
    let identification = identify::identify(&x, &at, &bounds, &scales);
    Ok(Calibration {
        spec,
        residual_rms,
        steps,
        identification,
    })
}
