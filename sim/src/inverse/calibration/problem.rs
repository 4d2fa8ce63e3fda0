//! The residuals of observed positions and their derivatives by the unknowns.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{CalibrationError, CalibrationSettings, Observation, Unknown};
use crate::inverse::PriorError;
use crate::inverse::least_squares::{Evaluation, Limit};
use crate::inverse::sought::Sought;
use crate::robot::{Parameter, ParameterError, Robot, RobotSpec, Values};
use crate::statics::{Equilibrium, Settler};

/// The smallest standard deviation of a prior that counts, relative to its unknown's scale: rows of smaller ones would hide all
/// others in rounding.
const FINEST: f64 = 1e-6;
/// Smallest and largest weight of a prior (m over the unknown's unit), whose squares are numbers.
const WEIGHTS: [f64; 2] = [1e-100, 1e100];

/// What is to be explained, by which unknowns.
pub(super) struct Problem<'a> {
    pub first: &'a RobotSpec,
    pub unknowns: &'a [Unknown],
    pub observations: &'a [Observation],
    /// Of each unknown, in order.
    pub sought: Vec<Sought>,
    /// Rows of the residuals below those of the observations.
    priors: Vec<PriorRow>,
}

/// A normal distribution of an unknown's value before the fit.
struct PriorRow {
    /// The unknown, by its place in the list.
    unknown: usize,
    mean: f64,
    /// Its standard deviation.
    spread: f64,
    /// The errors of measurement over the standard deviation: residuals of all rows then have the former's size (m).
    weight: f64,
}

impl<'a> Problem<'a> {
    /// The problem, and the unknowns' first coordinates.
    pub fn new(
        first: &'a RobotSpec,
        unknowns: &'a [Unknown],
        observations: &'a [Observation],
        settings: &CalibrationSettings,
    ) -> Result<(Self, DVector<f64>), CalibrationError> {
        let mut problem = Self {
            first,
            unknowns,
            observations,
            sought: Vec::new(),
            priors: Vec::new(),
        };
        let values = problem.check()?;
        let seek = |(unknown, &value): (&Unknown, &f64)| unknown.sought(value);
        problem.sought = unknowns.iter().zip(&values).map(seek).collect();
        problem.believe(settings)?;
        let (coordinates, priors) = (problem.coordinates(), problem.priors.len());
        if coordinates + priors <= unknowns.len() {
            return Err(CalibrationError::TooFew {
                coordinates,
                priors,
                unknowns: unknowns.len(),
            });
        }
        let starts = problem.sought.iter();
        let starts = starts.map(|sought| sought.coordinate.of(sought.first));
        let start = DVector::from_vec(starts.collect());
        Ok((problem, start))
    }

    /// Gives the unknowns what is known of them.
    fn believe(&mut self, settings: &CalibrationSettings) -> Result<(), CalibrationError> {
        let CalibrationSettings { priors, error } = settings;
        if let Some(error) = *error
            && !Values::Positive.contain(error)
        {
            return Err(CalibrationError::Error(error));
        }
        priors.check_names(&self.sought.iter().collect::<Vec<_>>())?;
        for (place, unknown) in self.unknowns.iter().enumerate() {
            let given = priors.of(&self.sought[place])?;
            if let Some(value) = given.value {
                self.sought[place] = unknown.sought(value);
            }
            let sought = &mut self.sought[place];
            given.confine(sought)?;
            let Some(spread) = given.spread else { continue };
            let Some(error) = *error else {
                let reason = "it is weighed against the errors of measurement, whose size is not known; expected `error`, their \
                              standard deviation (m), beside it";
                return Err(PriorError::of(&sought.name, "spread", reason).into());
            };
            let mean = sought.first;
            // A value of 0 has no scale: its prior weighs a million (m over its unit) at most.
            let least = match unknown.scale(self.first, mean) {
                0.0 => FINEST * error,
                scale => FINEST * scale,
            };
            let [lightest, heaviest] = WEIGHTS;
            self.priors.push(PriorRow {
                unknown: place,
                mean,
                spread,
                weight: (error / spread.max(least)).clamp(lightest, heaviest),
            });
        }
        Ok(())
    }

    /// The unknowns' values at `x`.
    pub fn values(&self, x: &DVector<f64>) -> Vec<f64> {
        let pairs = self.sought.iter().zip(x);
        pairs.map(|(sought, &u)| sought.value(u)).collect()
    }

    /// How far each unknown's coordinate may go.
    pub fn limits(&self) -> Vec<Limit> {
        self.sought.iter().map(Sought::limit).collect()
    }

    /// Standard deviation of an unknown's prior, if it has one.
    pub fn spread(&self, unknown: usize) -> Option<f64> {
        let mut priors = self.priors.iter();
        let prior = priors.find(|prior| prior.unknown == unknown)?;
        Some(prior.spread)
    }

    /// Takes derivatives by coordinates at `x` to those by the values.
    pub fn by_values(&self, x: &DVector<f64>, jacobian: &mut DMatrix<f64>) {
        let pairs = self.sought.iter().zip(x);
        for (mut column, (sought, &u)) in jacobian.column_iter_mut().zip(pairs) {
            column /= sought.coordinate.slope(u);
        }
    }

    /// Checks the input; returns the first values.
    fn check(&self) -> Result<Vec<f64>, CalibrationError> {
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
            .any(|unknown| unknown.parameters().is_empty())
            || self.unknowns.is_empty()
        {
            return Err(CalibrationError::NoUnknown);
        }
        self.check_overlap()?;
        let values: Result<Vec<f64>, _> = (self.unknowns.iter())
            .map(|unknown| unknown.value(self.first))
            .collect();
        Ok(values?)
    }

    fn check_overlap(&self) -> Result<(), CalibrationError> {
        for unknown in self.unknowns {
            self.first.check_parameters(unknown.parameters())?;
        }
        let all = || {
            self.unknowns
                .iter()
                .flat_map(|u| u.parameters().iter().map(move |p| (u, p)))
        };
        for (place, (unknown, parameter)) in all().enumerate() {
            let same = |other: &Parameter| self.first.parameters_overlap(*other, *parameter);
            if let Some((other, _)) = all().take(place).find(|(_, other)| same(other)) {
                let names = [other, unknown].map(|unknown| unknown.name().to_owned());
                let [first, second] = names;
                return Err(CalibrationError::Overlap(first, second));
            }
        }
        Ok(())
    }

    /// Number of measured coordinates.
    pub fn coordinates(&self) -> usize {
        self.observations
            .iter()
            .map(|o| 3 * o.positions.len())
            .sum()
    }

    pub fn spec(&self, x: &DVector<f64>) -> Result<RobotSpec, ParameterError> {
        let shared = self.unknowns.iter().zip(self.values(x));
        let values: Vec<_> = shared
            .flat_map(|(unknown, value)| unknown.parameters().iter().map(move |p| (*p, value)))
            .collect();
        self.first.with(&values)
    }

    /// Residuals (m) of the measured coordinates, then of the priors, and their Jacobian by the coordinates of the unknowns in
    /// `free`, with every observation's equilibrium.
    ///
    /// # Errors
    /// If there is no such robot, or it does not settle stably under an observation.
    pub fn evaluate(
        &self,
        x: &DVector<f64>,
        free: &[usize],
        start: Start,
    ) -> Result<Evaluation<Vec<Equilibrium>>, CalibrationError> {
        let robot = Robot::new(self.spec(x)?)?;
        let parts: Vec<Option<Part>> = (0..self.observations.len())
            .into_par_iter()
            .map_init(
                || Settler::new(&robot),
                |settler, index| self.observe(&robot, settler, index, free, start),
            )
            .collect();
        let rows = self.coordinates() + self.priors.len();
        let mut residuals = DVector::zeros(rows);
        let mut jacobian = DMatrix::zeros(rows, free.len());
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
        for (row, prior) in (row..).zip(&self.priors) {
            let value = self.sought[prior.unknown].value(x[prior.unknown]);
            residuals[row] = prior.weight * (value - prior.mean);
            if let Some(column) = free.iter().position(|&i| i == prior.unknown) {
                jacobian[(row, column)] = prior.weight;
            }
        }
        for (mut column, &i) in jacobian.column_iter_mut().zip(free) {
            column *= self.sought[i].coordinate.slope(x[i]);
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
        free: &[usize],
        start: Start,
    ) -> Option<Part> {
        let observation = &self.observations[index];
        let (command, loads) = (&observation.command, &observation.loads);
        let residuals = |settled: &Equilibrium| -> DVector<f64> {
            let mut residuals = DVector::zeros(3 * observation.positions.len());
            for (k, (disc, measured)) in observation.positions.iter().enumerate() {
                let residual = settled.positions[*disc] - measured;
                residuals.fixed_rows_mut::<3>(3 * k).copy_from(&residual);
            }
            residuals
        };
        let linearise = |settled: Equilibrium| {
            let sensitivity = robot.sensitivity(command, loads, &settled).ok()?;
            Some((settled, sensitivity))
        };
        let (settled, sensitivity) = match start {
            Start::Straight => linearise(settler.settle(command, loads).clone())?,
            Start::Last(last) => {
                let near = &last[index].configuration;
                let found = linearise(settler.settle_from(near, command, loads).clone());
                match found {
                    Some(found) => found,
                    None => linearise(settler.settle(command, loads).clone())?,
                }
            }
            Start::Nearest(last, others) => {
                let mut best = linearise(last[index].clone())?;
                let mut smallest = residuals(&best.0).norm();
                let mut consider = |settled: &Equilibrium| {
                    if settled.converged
                        && residuals(settled).norm() < smallest
                        && let Some(found) = linearise(settled.clone())
                    {
                        smallest = residuals(&found.0).norm();
                        best = found;
                    }
                };
                consider(settler.settle(command, loads));
                for other in others {
                    let near = &other[index].configuration;
                    consider(settler.settle_from(near, command, loads));
                }
                best
            }
        };
        let residuals = residuals(&settled);
        let mut jacobian = DMatrix::zeros(residuals.len(), free.len());
        for (mut column, &i) in jacobian.column_iter_mut().zip(free) {
            let unknown = &self.unknowns[i];
            let direction: Vec<_> = unknown.parameters().iter().map(|&p| (p, 1.0)).collect();
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
pub(super) enum Start<'a> {
    /// The straight pose.
    Straight,
    /// Each observation's last equilibrium; the straight pose where that leads to none.
    Last(&'a [Equilibrium]),
    /// Of each observation's last equilibrium, that which the straight pose leads to, and those that other
    /// equilibria of it lead to, the one nearest to what was observed.
    Nearest(&'a [Equilibrium], &'a [&'a [Equilibrium]]),
}

/// One observation's part of the problem.
struct Part {
    residuals: DVector<f64>,
    jacobian: DMatrix<f64>,
    settled: Equilibrium,
}
