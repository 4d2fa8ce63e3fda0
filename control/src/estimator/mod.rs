//! What pulls at a robot, and what its servos are off by, from what sensors say.
//!
//! The unknowns `x` drift as Gauss-Markov processes of first order, and a measurement is `z = h(u, x) + noise`, `h` the equilibrium under the command `u`.
//! Each measurement is taken in by Gauss-Newton steps on the sum of squares of the prior and the measurement, the iterated
//! Kalman update (Bell and Cathey, The iterated Kalman filter update as a Gauss-Newton method, IEEE Trans. Autom. Control 38,
//! 1993): with the prior mean `m` and covariance `P`, `H = dh/dx` by the implicit function theorem,
//! `x <- m + K (z - h(x) - H (m - x))`, `K = P H' (H P H' + R)^-1`. Where a measurement is further from what is expected than model and
//! noise explain (its normalised square is `s` times what chi squared hardly exceeds: friction, say, which the model does not have), its variance counts
//! `s`-fold, so that what the model lacks is not made up for by loads that are not there.

mod cloud;

use nalgebra::{Cholesky, DMatrix, DVector};
use tdcr_sim::inverse::recording::Shown;
use tdcr_sim::robot::{CommandUnit, Loads, Robot};
use tdcr_sim::scene::Scene;

use crate::belief::{Belief, BeliefError, Unknown};
use crate::plant::Measurement;

/// Share of its prior deviation above which an unknown was hardly told by the measurements.
const HARDLY: f64 = 0.5;
/// Standard deviations of chi squared above its mean from which a measurement is further off than its noise explains.
const SURPRISING: f64 = 3.0;
/// Gauss-Newton steps of a measurement at most, and the part of a deviation within which a step ends them.
const STEPS: usize = 8;
const CLOSE: f64 = 0.02;

/// Pretension of a tendon that is off by no more than this in most robots (N).
const PRETENSION: f64 = 10.0;

/// What is thought of an unknown before anything is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// The unknown; thought to be 0.
    pub unknown: Unknown,
    /// Standard deviation, in its unit.
    pub deviation: f64,
    /// Time after which it is forgotten (s): without measurements what is known of it decays to this prior by the factor e.
    pub time: f64,
}

/// How measurements are weighed.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatorSettings {
    /// What is unknown.
    pub priors: Vec<Prior>,
    /// Standard deviation of a coordinate of a point (m), the model's own error included.
    pub position: f64,
    /// Of a tension (N).
    pub tension: f64,
    /// Of a length (m).
    pub length: f64,
    /// Of a cloud point's distance from the surface (m).
    pub cloud: f64,
    /// What of the robot clouds show besides the discs.
    pub shown: Shown,
}

impl EstimatorSettings {
    /// A payload and the offset of every tendon's servo, both drifting within minutes. Clouds show the robot without its base.
    pub fn for_robot(robot: &Robot) -> Self {
        let offset = |(t, tendon): (usize, &tdcr_sim::robot::Tendon)| {
            let range = tendon.range[1] - tendon.range[0];
            let deviation = match tendon.unit() {
                // A stiff tendon is never off by as much as a soft one: that would tear it.
                CommandUnit::Metre if tendon.stiffness.is_finite() => {
                    (0.05 * range).min(PRETENSION / tendon.stiffness)
                }
                CommandUnit::Metre => 0.05 * range,
                CommandUnit::Newton => 0.05 * range,
            };
            Prior {
                unknown: Unknown::Offset(t),
                deviation,
                time: 200.0,
            }
        };
        let payload = Prior {
            unknown: Unknown::Payload,
            deviation: 0.05,
            time: 1000.0,
        };
        let offsets = robot.tendons().iter().enumerate().map(offset);
        Self {
            priors: std::iter::once(payload).chain(offsets).collect(),
            position: 3e-4,
            tension: 0.2,
            length: 2e-4,
            cloud: 2e-3,
            shown: Shown::of(robot.spec(), false),
        }
    }
}

/// Estimates the unknowns of a [`Belief`], measurement by measurement.
#[derive(Clone, Debug)]
pub struct Estimator {
    belief: Belief,
    settings: EstimatorSettings,
    covariance: DMatrix<f64>,
    /// Normalised squared innovation of the last measurement and the number of its coordinates.
    innovation: Option<(f64, usize)>,
}

/// What is known of an unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimated {
    /// The unknown.
    pub unknown: Unknown,
    /// Its value, in its unit.
    pub value: f64,
    /// Standard deviation of that.
    pub deviation: f64,
    /// Whether the measurements have told it: its deviation is below half of what it was before any.
    pub is_identified: bool,
}

impl Estimator {
    /// An estimator of `robot` under known loads.
    ///
    /// # Errors
    /// [`BeliefError`] for unknowns and loads that the robot does not have.
    pub fn new(
        robot: &Robot,
        loads: &Loads,
        settings: EstimatorSettings,
    ) -> Result<Self, BeliefError> {
        let unknowns: Vec<Unknown> = settings.priors.iter().map(|prior| prior.unknown).collect();
        let variances = settings.priors.iter().map(|prior| prior.deviation.powi(2));
        let variances = DVector::from_iterator(unknowns.len(), variances);
        Ok(Self {
            belief: Belief::new(robot, loads, &unknowns)?,
            covariance: DMatrix::from_diagonal(&variances),
            settings,
            innovation: None,
        })
    }

    /// The same whose model is among the obstacles of `scene`: [`Belief::among`].
    ///
    /// # Errors
    /// As [`Belief::among`].
    pub fn among(mut self, scene: &Scene) -> Result<Self, BeliefError> {
        self.belief = self.belief.among(scene)?;
        Ok(self)
    }

    /// The model with the estimated values.
    pub fn belief(&mut self) -> &mut Belief {
        &mut self.belief
    }

    /// Covariance of the values, in their order.
    pub fn covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// Squared innovation of the last measurement by its covariance, and its number of coordinates, of which it is distributed
    /// as chi squared where model and noise are right (Bar-Shalom, Li and Kirubarajan, Estimation with Applications, ch. 5.4).
    pub fn innovation(&self) -> Option<(f64, usize)> {
        self.innovation
    }

    /// What is known of each unknown.
    pub fn estimated(&self) -> Vec<Estimated> {
        let each = |(place, prior): (usize, &Prior)| {
            let deviation = self.covariance[(place, place)].max(0.0).sqrt();
            Estimated {
                unknown: prior.unknown,
                value: self.belief.values()[place],
                deviation,
                is_identified: deviation < HARDLY * prior.deviation,
            }
        };
        self.settings.priors.iter().enumerate().map(each).collect()
    }

    /// What the measurements do not identify, by name.
    pub fn unidentified(&self) -> Vec<String> {
        let estimated = self.estimated().into_iter();
        let unidentified = estimated.filter(|estimated| !estimated.is_identified);
        unidentified
            .map(|estimated| estimated.unknown.to_string())
            .collect()
    }

    /// Takes in a measurement `elapsed` (s) after the last one, under `command` (m or N), what the tendons were commanded then.
    /// Where the model does not settle the values stay as they were.
    ///
    /// # Errors
    /// [`BeliefError`] where the model does not settle, or has no derivatives.
    pub fn update(
        &mut self,
        command: &[f64],
        measurement: &Measurement,
        elapsed: f64,
    ) -> Result<(), BeliefError> {
        let prior = self.forget(elapsed);
        let updated = self.gauss_newton(&prior, command, measurement);
        if updated.is_err() {
            self.belief.set_values(&prior);
        }
        updated
    }

    /// Lets the unknowns drift for `elapsed` (s); returns their mean values then.
    fn forget(&mut self, elapsed: f64) -> DVector<f64> {
        let priors = &self.settings.priors;
        let kept = priors
            .iter()
            .map(|prior| (-elapsed.max(0.0) / prior.time).exp());
        let kept = DVector::from_iterator(priors.len(), kept);
        let mean = self.belief.values().component_mul(&kept);
        self.covariance = DMatrix::from_fn(kept.len(), kept.len(), |i, j| {
            let spread = kept[i] * self.covariance[(i, j)] * kept[j];
            match i == j {
                true => spread + (1.0 - kept[i] * kept[i]) * priors[i].deviation.powi(2),
                false => spread,
            }
        });
        self.belief.set_values(&mean);
        mean
    }

    /// The mode of prior and measurement, and the covariance there.
    fn gauss_newton(
        &mut self,
        prior: &DVector<f64>,
        command: &[f64],
        measurement: &Measurement,
    ) -> Result<(), BeliefError> {
        let Some(found) = self.descend(prior, command, measurement, 1.0)? else {
            return self.belief.rest(command);
        };
        self.innovation = Some((found.squared, found.coordinates));
        let degrees = found.coordinates as f64;
        let expected = degrees + SURPRISING * (2.0 * degrees).sqrt();
        let surprise = found.squared / expected;
        let found = match surprise > 1.0 {
            true => self.descend(prior, command, measurement, surprise)?,
            false => Some(found),
        };
        // The values are kept only where the model settles with them.
        self.belief.rest(command)?;
        if let Some(found) = found {
            self.covariance = (&found.covariance + found.covariance.transpose()) / 2.0;
        }
        Ok(())
    }

    /// Gauss-Newton steps, the variances of measurements counting `inflation`-fold; `None` where nothing was measured.
    fn descend(
        &mut self,
        prior: &DVector<f64>,
        command: &[f64],
        measurement: &Measurement,
        inflation: f64,
    ) -> Result<Option<Descended>, BeliefError> {
        let mut last = None;
        for _ in 0..STEPS {
            let residuals = self.residuals(command, measurement)?;
            if residuals.z.is_empty() {
                return Ok(None);
            }
            let Residuals { z, slopes, noise } = residuals;
            let noise = DMatrix::from_diagonal(&(noise * inflation));
            let here = self.belief.values().clone();
            let innovation = z - &slopes * (prior - &here);
            let spread = &slopes * &self.covariance * slopes.transpose() + &noise;
            let Some(factor) = Cholesky::new(spread) else {
                return Ok(None);
            };
            let gain = factor.solve(&(&slopes * &self.covariance)).transpose();
            let next = prior + &gain * &innovation;
            self.belief.set_values(&next);
            // Joseph's form stays positive.
            let left = DMatrix::identity(here.len(), here.len()) - &gain * &slopes;
            let covariance =
                &left * &self.covariance * left.transpose() + &gain * noise * gain.transpose();
            let is_close = |place: usize| {
                let deviation = covariance[(place, place)].max(0.0).sqrt();
                (next[place] - here[place]).abs() <= CLOSE * deviation
            };
            let is_there = (0..here.len()).all(is_close);
            last = Some(Descended {
                squared: innovation.dot(&factor.solve(&innovation)),
                coordinates: innovation.len(),
                covariance,
            });
            if is_there {
                break;
            }
        }
        Ok(last)
    }

    fn residuals(
        &mut self,
        command: &[f64],
        measurement: &Measurement,
    ) -> Result<Residuals, BeliefError> {
        let linear = self.belief.linearise(command)?;
        let mut all = Residuals::new(self.belief.unknowns().len());
        let markers: Vec<_> = measurement
            .sightings
            .iter()
            .map(|seen| seen.marker)
            .collect();
        if !markers.is_empty() {
            let seen = measurement.sightings.iter();
            let off = seen.flat_map(|seen| {
                let off = seen.position - linear.position(&seen.marker);
                [off.x, off.y, off.z]
            });
            let [_, slopes] = linear.marker_jacobians(&markers)?;
            all.add(off.collect(), &slopes, self.settings.position);
        }
        if let Some(points) = &measurement.cloud {
            let spans = self.settings.priors.iter().map(|prior| prior.deviation);
            let spans = DVector::from_iterator(self.settings.priors.len(), spans);
            let (robot, settings) = (self.belief.robot(), &self.settings);
            let told = cloud::reduce(
                &linear,
                robot,
                &settings.shown,
                points,
                settings.cloud,
                &spans,
            )?;
            all.add(told.off, &told.slopes, 1.0);
        }
        let [[_, tensions], [_, lengths]] = linear.tendon_jacobians()?;
        let here = &linear.equilibrium;
        let off = |measured: &[f64], model: &[f64]| -> Vec<f64> {
            measured.iter().zip(model).map(|(a, b)| a - b).collect()
        };
        if let Some(measured) = &measurement.tensions {
            let off = off(measured, &here.tendon_tensions);
            all.add(off, &tensions, self.settings.tension);
        }
        if let Some(measured) = &measurement.lengths {
            let off = off(measured, &here.tendon_lengths);
            all.add(off, &lengths, self.settings.length);
        }
        Ok(all)
    }
}

/// Where Gauss-Newton steps came to.
struct Descended {
    /// Normalised square of the innovation, linearised there, and the number of its coordinates.
    squared: f64,
    coordinates: usize,
    covariance: DMatrix<f64>,
}

/// Measured less modelled, with the model's derivatives by the unknowns.
struct Residuals {
    z: DVector<f64>,
    slopes: DMatrix<f64>,
    /// Variances.
    noise: DVector<f64>,
}

impl Residuals {
    fn new(unknowns: usize) -> Self {
        Self {
            z: DVector::zeros(0),
            slopes: DMatrix::zeros(0, unknowns),
            noise: DVector::zeros(0),
        }
    }

    fn add(&mut self, off: Vec<f64>, slopes: &DMatrix<f64>, deviation: f64) {
        let (before, after) = (self.z.len(), self.z.len() + off.len());
        let extend = |vector: &DVector<f64>, more: &[f64]| {
            DVector::from_iterator(after, vector.iter().chain(more).copied())
        };
        self.z = extend(&self.z, &off);
        self.noise = extend(&self.noise, &vec![deviation.powi(2); off.len()]);
        let mut all = DMatrix::zeros(after, self.slopes.ncols());
        all.rows_mut(0, before).copy_from(&self.slopes);
        all.rows_mut(before, off.len())
            .copy_from(&slopes.rows(0, off.len()));
        self.slopes = all;
    }
}
