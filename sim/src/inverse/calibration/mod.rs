//! Calibration: the stiffnesses, densities and dimensions that explain measured disc positions.
//!
//! Least squares over any of the robot's [`Parameter`]s, with standard errors and 95 % intervals of
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

mod identify;

pub use identify::{Estimate, Finding, Identification};

use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;
use thiserror::Error;

use super::least_squares::{Evaluation, left_to_gain, minimise};
use crate::robot::{Body, Command, CommandError, LoadError, Loads, Robot, RobotSpec, SpecError};
use crate::sensitivity::{Parameter, SensitivityError};
use crate::statics::{Equilibrium, Settler};

/// Steps of the minimisation at most.
const MAX_STEPS: usize = 200;
/// Times that a fit goes on from the other equilibria of commands that have two.
const MAX_RETURNS: usize = 5;
/// How far the fit may be from the minimum, as a share of the confidence region's radius: the relative
/// offset of Bates and Watts (A relative offset orthogonality convergence criterion, 1981).
const OFFSET: f64 = 1e-3;
/// Residuals (m, root mean square) that settling itself leaves; a fit as good as that is exact.
const EXACT: f64 = 1e-9;
/// Bounds of what must be above zero, relative to its first value.
const WIDEST: [f64; 2] = [1e-6, 1e6];

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

/// A number to be found: one value that one or several parameters share.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknown {
    name: String,
    parameters: Vec<Parameter>,
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

/// Why there is no calibration.
#[derive(Debug, Error)]
pub enum CalibrationError {
    /// Not as many measured coordinates as unknowns and one.
    #[error("{coordinates} coordinates are measured; {unknowns} unknowns take {} at least", unknowns + 1)]
    TooFew {
        /// Measured coordinates.
        coordinates: usize,
        /// Unknowns.
        unknowns: usize,
    },
    /// No unknown, or one without parameters.
    #[error(
        "there is nothing to find: expected one unknown or more, each of one parameter or more"
    )]
    NoUnknown,
    /// Unknowns that are not independent.
    #[error("the unknowns `{0}` and `{1}` set the same thing; give it once")]
    Overlap(String, String),
    /// A parameter that the robot does not have.
    #[error(transparent)]
    Parameter(#[from] SensitivityError),
    /// A robot to start from that is not valid.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// A command of another robot.
    #[error("observation {index}: {source}")]
    Command {
        /// The observation, from 0.
        index: usize,
        /// What is wrong.
        source: CommandError,
    },
    /// Loads of another robot.
    #[error("observation {index}: {source}")]
    Loads {
        /// The observation, from 0.
        index: usize,
        /// What is wrong.
        source: LoadError,
    },
    /// A measurement of no disc, or not of finite numbers.
    #[error(
        "observation {index} measures disc {disc} at {position:?} m; expected a disc below {discs} and finite numbers"
    )]
    Measurement {
        /// The observation, from 0.
        index: usize,
        /// The disc.
        disc: usize,
        /// Number of discs.
        discs: usize,
        /// Where it was measured (m).
        position: [f64; 3],
    },
    /// The robot does not settle stably with the first values.
    #[error(
        "the robot that the calibration starts from does not settle stably under observation {0}"
    )]
    Unsettled(usize),
    /// The minimisation stopped short of a minimum.
    #[error(
        "the fit came to a halt after {steps} steps, at residuals of {residual_rms:e} m: try other first values"
    )]
    Stalled {
        /// Steps tried.
        steps: usize,
        /// Root mean square of the residuals there (m).
        residual_rms: f64,
    },
}

impl Unknown {
    /// One parameter.
    pub fn one(parameter: Parameter) -> Self {
        Self::shared(&parameter.to_string(), [parameter])
    }

    /// Parameters that share one value: for example the gain of all tendons, or the density of all
    /// modules.
    pub fn shared(name: &str, parameters: impl IntoIterator<Item = Parameter>) -> Self {
        Self {
            name: name.to_owned(),
            parameters: parameters.into_iter().collect(),
        }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its parameters.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Its unit.
    pub fn unit(&self) -> &'static str {
        self.parameters.first().map_or("", |p| p.unit())
    }

    /// The robot with this value of the unknown.
    ///
    /// # Errors
    /// As [`RobotSpec::with`].
    pub fn set(&self, spec: &RobotSpec, value: f64) -> Result<RobotSpec, SensitivityError> {
        let values: Vec<_> = self.parameters.iter().map(|&p| (p, value)).collect();
        spec.with(&values)
    }

    /// Mean value of its parameters.
    fn value(&self, spec: &RobotSpec) -> Result<f64, SensitivityError> {
        let values: Result<Vec<f64>, _> = self.parameters.iter().map(|&p| spec.value(p)).collect();
        let values = values?;
        Ok(values.iter().sum::<f64>() / values.len() as f64)
    }

    /// The size against which its uncertainty is large or small: its own, or for the place of a hole
    /// the hole's distance from the axis.
    fn scale(&self, spec: &RobotSpec, value: f64) -> f64 {
        match self.parameters.first() {
            Some(Parameter::Hole(body, hole, _)) => {
                let holes = spec.holes(*body).map(|holes| holes.positions());
                holes.map_or(0.0, |holes| holes[*hole][0].hypot(holes[*hole][1]))
            }
            _ => value.abs(),
        }
    }

    /// Smallest and largest value considered, from a first one.
    fn bounds(&self, first: f64) -> [f64; 2] {
        let bounds = |parameter: &Parameter| match parameter {
            Parameter::Hole(..) => [f64::NEG_INFINITY, f64::INFINITY],
            // A backbone may be limp and a disc weightless; anything else vanishes only with the robot.
            Parameter::Bending(..) | Parameter::Torsion(_) | Parameter::Density(_) => {
                [0.0, f64::INFINITY]
            }
            _ => WIDEST.map(|share| share * first),
        };
        let all = self.parameters.iter().map(bounds);
        all.fold([f64::NEG_INFINITY, f64::INFINITY], |[low, high], [l, h]| {
            [low.max(l), high.min(h)]
        })
    }
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

struct Problem<'a> {
    first: &'a RobotSpec,
    unknowns: &'a [Unknown],
    observations: &'a [Observation],
}

impl Problem<'_> {
    /// Checks the input; returns the first values.
    fn check(&self) -> Result<DVector<f64>, CalibrationError> {
        let robot = Robot::new(self.first.clone())?;
        for (index, observation) in self.observations.iter().enumerate() {
            (robot.command(observation.command.as_slice()))
                .map_err(|source| CalibrationError::Command { index, source })?;
            (observation.loads.check(&robot))
                .map_err(|source| CalibrationError::Loads { index, source })?;
            let discs = robot.discs().len();
            for &(disc, position) in &observation.positions {
                if disc >= discs || position.iter().any(|x| !x.is_finite()) {
                    return Err(CalibrationError::Measurement {
                        index,
                        disc,
                        discs,
                        position: position.into(),
                    });
                }
            }
        }
        if self
            .unknowns
            .iter()
            .any(|unknown| unknown.parameters.is_empty())
            || self.unknowns.is_empty()
        {
            return Err(CalibrationError::NoUnknown);
        }
        self.check_overlap()?;
        let (coordinates, unknowns) = (self.coordinates(), self.unknowns.len());
        if coordinates <= unknowns {
            return Err(CalibrationError::TooFew {
                coordinates,
                unknowns,
            });
        }
        let values: Result<Vec<f64>, _> = (self.unknowns.iter())
            .map(|unknown| unknown.value(self.first))
            .collect();
        Ok(DVector::from_vec(values?))
    }

    fn check_overlap(&self) -> Result<(), CalibrationError> {
        let module = |body: &Body| match body {
            Body::Base => None,
            Body::Disc(disc) => self.first.module_of(*disc),
        };
        let same = |a: &Parameter, b: &Parameter| match (a, b) {
            (Parameter::HoleRadius(a), Parameter::HoleRadius(b) | Parameter::Hole(b, ..))
            | (Parameter::Hole(a, ..), Parameter::HoleRadius(b)) => module(a) == module(b),
            (Parameter::Hole(a, i, x), Parameter::Hole(b, j, y)) => {
                module(a) == module(b) && i == j && x == y
            }
            _ => a == b,
        };
        let all = || {
            self.unknowns
                .iter()
                .flat_map(|u| u.parameters.iter().map(move |p| (u, p)))
        };
        for (place, (unknown, parameter)) in all().enumerate() {
            if let Some((other, _)) = all().take(place).find(|(_, other)| same(other, parameter)) {
                let names = [other, unknown].map(|unknown| unknown.name.clone());
                let [first, second] = names;
                return Err(CalibrationError::Overlap(first, second));
            }
        }
        Ok(())
    }

    fn coordinates(&self) -> usize {
        self.observations
            .iter()
            .map(|o| 3 * o.positions.len())
            .sum()
    }

    fn spec(&self, x: &DVector<f64>) -> Result<RobotSpec, SensitivityError> {
        let shared = self.unknowns.iter().zip(x);
        let values: Vec<_> = shared
            .flat_map(|(unknown, value)| unknown.parameters.iter().map(move |p| (*p, *value)))
            .collect();
        self.first.with(&values)
    }

    /// Residuals and their Jacobian by the unknowns, with every observation's equilibrium.
    ///
    /// # Errors
    /// If there is no such robot, or it does not settle stably under an observation.
    fn evaluate(
        &self,
        x: &DVector<f64>,
        start: Start,
    ) -> Result<Evaluation<Vec<Equilibrium>>, CalibrationError> {
        let robot = Robot::new(self.spec(x)?)?;
        let parts: Vec<Option<Part>> = (0..self.observations.len())
            .into_par_iter()
            .map_init(
                || Settler::new(&robot),
                |settler, index| self.observe(&robot, settler, index, start),
            )
            .collect();
        let mut residuals = DVector::zeros(self.coordinates());
        let mut jacobian = DMatrix::zeros(self.coordinates(), x.len());
        let mut memory = Vec::with_capacity(parts.len());
        let mut row = 0;
        for (index, part) in parts.into_iter().enumerate() {
            let part = part.ok_or(CalibrationError::Unsettled(index))?;
            let rows = part.residuals.len();
            residuals.rows_mut(row, rows).copy_from(&part.residuals);
            jacobian.rows_mut(row, rows).copy_from(&part.jacobian);
            memory.push(part.settled);
            row += rows;
        }
        Ok(Evaluation {
            residuals,
            jacobian,
            memory,
        })
    }

    /// One observation's part of the residuals; `None` if the robot does not settle stably.
    fn observe(
        &self,
        robot: &Robot,
        settler: &mut Settler,
        index: usize,
        start: Start,
    ) -> Option<Part> {
        let observation = &self.observations[index];
        let (command, loads) = (&observation.command, &observation.loads);
        let misses = |settled: &Equilibrium| -> DVector<f64> {
            let mut misses = DVector::zeros(3 * observation.positions.len());
            for (k, (disc, measured)) in observation.positions.iter().enumerate() {
                let miss = settled.positions[*disc] - measured;
                misses.fixed_rows_mut::<3>(3 * k).copy_from(&miss);
            }
            misses
        };
        let settled = match start {
            Start::Straight => settler.settle(command, loads).clone(),
            Start::Last(last) => {
                let near = &last[index].configuration;
                settler.settle_from(near, command, loads).clone()
            }
            Start::Nearer(last) => {
                let straight = settler.settle(command, loads);
                if straight.converged && misses(straight).norm() < misses(&last[index]).norm() {
                    straight.clone()
                } else {
                    last[index].clone()
                }
            }
        };
        let sensitivity = robot.sensitivity(command, loads, &settled).ok()?;
        let residuals = misses(&settled);
        let mut jacobian = DMatrix::zeros(residuals.len(), self.unknowns.len());
        for (mut column, unknown) in jacobian.column_iter_mut().zip(self.unknowns) {
            let direction: Vec<_> = unknown.parameters.iter().map(|&p| (p, 1.0)).collect();
            let poses = sensitivity.jvp(&direction).ok()?;
            for (k, (disc, _)) in observation.positions.iter().enumerate() {
                column
                    .fixed_rows_mut::<3>(3 * k)
                    .copy_from(&poses[*disc].position);
            }
        }
        let finite = jacobian.iter().all(|x| x.is_finite());
        finite.then_some(Part {
            residuals,
            jacobian,
            settled,
        })
    }
}

/// Where the robot settles from.
#[derive(Clone, Copy)]
enum Start<'a> {
    /// The straight pose.
    Straight,
    /// Each observation's last equilibrium.
    Last(&'a [Equilibrium]),
    /// Each observation's last equilibrium, or that which the straight pose leads to: the one nearer
    /// to what was observed.
    Nearer(&'a [Equilibrium]),
}

/// One observation's part of the problem.
struct Part {
    residuals: DVector<f64>,
    jacobian: DMatrix<f64>,
    settled: Equilibrium,
}
