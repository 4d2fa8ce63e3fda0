//! What a fit says of its unknowns: estimates with intervals, or that the data do not tell.

use nalgebra::DMatrix;

use crate::inverse::least_squares::Evaluation;
use crate::inverse::priors::LITTLE;
use crate::inverse::student::{NORMAL, two_sided_quantile};

/// Level of the intervals.
const LEVEL: f64 = 0.95;
/// Singular values below this share of the largest are rounding: derivatives have about eight digits.
const ROUNDING: f64 = 1e-7;
/// Share of an unknown's variance that directions without effect bring for it to be undetermined
/// (Belsley, Kuh and Welsch, Regression Diagnostics, ch. 3).
const DOMINANT: f64 = 0.5;
/// Correlation of the errors of undetermined unknowns that depend on each other. Among many in several
/// directions without effect, it may be small.
const LINKED: f64 = 0.1;
/// Correlation of errors from which an uncertain unknown is blurred by another.
const BLURRED: f64 = 0.9;

/// What the observations say of the unknowns.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// Of each unknown, in order.
    pub findings: Vec<Finding>,
    /// Standard deviation of the errors of measurement (m): the root of the residuals' sum of squares, those of priors among
    /// them, over the degrees of freedom. Beside a stated error it says whether that explains the residuals.
    pub noise: f64,
    /// Measured coordinates and priors less directions fitted.
    pub degrees_of_freedom: usize,
    /// Condition number of the Jacobian, the priors' rows included, with columns of length 1 (Belsley, Kuh and Welsch), of the
    /// unknowns that have an effect and are not at a bound. From about 30 on, unknowns blur each other.
    pub condition: f64,
    /// Correlations of the estimates' errors, one row and column for each unknown; zero where either
    /// is not identified.
    pub correlations: DMatrix<f64>,
}

/// What the observations say of one unknown.
#[derive(Clone, Debug, PartialEq)]
pub enum Finding {
    /// Its value, surer than that it differs from zero (the place of a hole: surer than half of the
    /// hole's distance from the axis, either way).
    Identified(Estimate),
    /// Observations like these cannot tell it from others: changes of all together explain them as
    /// well.
    Confounded {
        /// The others, by their place in the list of unknowns.
        with: Vec<usize>,
    },
    /// It has an effect, which is lost in the errors of measurement.
    Undetermined {
        /// Standard error, in the unknown's unit.
        standard_error: f64,
    },
    /// It has no effect on anything that was measured.
    NoEffect,
    /// The best fit is at the bound of what a robot can have, or at one that was given: the model, the data or the bound does
    /// not suit. The other unknowns' errors hold for this value.
    AtBound(f64),
}

/// An estimate, in the unknown's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The least-squares value; with a prior the one of largest posterior density.
    pub value: f64,
    /// Standard error: the root of the diagonal of `s² (J'J)⁻¹`, where `s` is the stated error or else
    /// [`Identification::noise`], and `J` has a row for each prior. With a stated error this is the covariance of the Gaussian
    /// posterior of the linearised model (Bishop, Pattern Recognition and Machine Learning, 2006, Eq. 3.51).
    pub standard_error: f64,
    /// The 95 % confidence interval, by Student's t distribution, or with a stated error by the normal one; no part of it is
    /// beyond a bound.
    pub interval: [f64; 2],
    /// Whether the measurements say little of it: its standard error is nearly its prior's.
    pub prior_only: bool,
}

/// An unknown at the end of a fit.
pub(super) struct Found {
    pub value: f64,
    /// Smallest and largest value.
    pub bounds: [f64; 2],
    /// Whether it is at a bound.
    pub stopped: bool,
    /// The size against which its uncertainty is judged.
    pub scale: f64,
    /// Standard deviation of its prior, if it has one.
    pub spread: Option<f64>,
}

/// `at`: residuals of the `measured` coordinates and of priors, and their derivatives by the unknowns' values; `error`: what is
/// stated of the errors of measurement.
pub(super) fn identify<M>(
    unknowns: &[Found],
    at: &Evaluation<M>,
    measured: usize,
    error: Option<f64>,
) -> Identification {
    let mut findings: Vec<Finding> = (unknowns.iter())
        .map(|unknown| match unknown.stopped {
            true => Finding::AtBound(unknown.value),
            false => Finding::NoEffect,
        })
        .collect();
    // Relative effects on what was measured, so that "no effect" does not depend on units.
    let effects = |i: usize| {
        let effect = at.jacobian.column(i).rows(0, measured).norm();
        effect * unknowns[i].scale.max(f64::MIN_POSITIVE)
    };
    let strongest = (0..unknowns.len()).map(effects).fold(0.0, f64::max);
    let known = |i: usize| unknowns[i].spread.is_some() || effects(i) > ROUNDING * strongest;
    let fitted: Vec<usize> = (0..unknowns.len())
        .filter(|&i| findings[i] == Finding::NoEffect && known(i))
        .collect();
    let directions = Directions::new(&at.jacobian, &fitted);
    let degrees_of_freedom = at.residuals.len().saturating_sub(directions.rank());
    let noise = (at.cost() / degrees_of_freedom.max(1) as f64).sqrt();
    let (unit, reach) = match error {
        Some(error) => (error, NORMAL),
        None => (noise, two_sided_quantile(LEVEL, degrees_of_freedom.max(1))),
    };
    for (place, &unknown) in fitted.iter().enumerate() {
        let standard_error = unit * directions.spread(place);
        let Found {
            value,
            bounds: [low, high],
            scale,
            spread,
            ..
        } = unknowns[unknown];
        let scale = match scale {
            0.0 => f64::INFINITY,
            scale => scale,
        };
        let half_width = reach * standard_error;
        findings[unknown] = if !directions.determines(place) || half_width > scale {
            let with = directions.partners(place);
            let with: Vec<usize> = with.into_iter().map(|other| fitted[other]).collect();
            match with.is_empty() {
                true => Finding::Undetermined { standard_error },
                false => Finding::Confounded { with },
            }
        } else {
            Finding::Identified(Estimate {
                value,
                standard_error,
                interval: [
                    (value - half_width).max(low),
                    (value + half_width).min(high),
                ],
                prior_only: spread.is_some_and(|spread| standard_error > LITTLE * spread),
            })
        };
    }
    let mut correlations = DMatrix::zeros(unknowns.len(), unknowns.len());
    for (i, &row) in fitted.iter().enumerate() {
        for (j, &column) in fitted.iter().enumerate() {
            let both = [row, column].map(|k| matches!(findings[k], Finding::Identified(_)));
            if both == [true, true] {
                correlations[(row, column)] = directions.correlation(i, j);
            }
        }
    }
    Identification {
        findings,
        noise,
        degrees_of_freedom,
        condition: directions.condition(),
        correlations,
    }
}

/// Orthogonal directions in the unknowns that are fitted, scaled to columns of length 1.
struct Directions {
    /// Lengths of the Jacobian's columns.
    lengths: Vec<f64>,
    /// How much each direction moves the residuals, descending; rounding replaced by its size.
    sizes: Vec<f64>,
    /// Directions, one a column.
    vectors: DMatrix<f64>,
}

impl Directions {
    fn new(jacobian: &DMatrix<f64>, fitted: &[usize]) -> Self {
        let mut scaled = jacobian.select_columns(fitted);
        let lengths: Vec<f64> = scaled.column_iter().map(|column| column.norm()).collect();
        for (mut column, length) in scaled.column_iter_mut().zip(&lengths) {
            column /= *length;
        }
        if fitted.is_empty() {
            return Self {
                lengths,
                sizes: Vec::new(),
                vectors: DMatrix::zeros(0, 0),
            };
        }
        // The triangle has the same singular values and right vectors, and is small.
        let svd = scaled.qr().unpack_r().svd(false, true);
        let least = ROUNDING * svd.singular_values.max();
        Self {
            lengths,
            sizes: svd
                .singular_values
                .iter()
                .map(|size| size.max(least))
                .collect(),
            vectors: svd.v_t.expect("asked for").transpose(),
        }
    }

    fn is_null(&self, direction: usize) -> bool {
        self.sizes[direction] <= ROUNDING * self.sizes[0]
    }

    fn rank(&self) -> usize {
        (0..self.sizes.len()).filter(|&k| !self.is_null(k)).count()
    }

    fn condition(&self) -> f64 {
        match self.sizes[..] {
            [first, .., last] if !self.is_null(self.sizes.len() - 1) => first / last,
            [first, .., _] if first > 0.0 => f64::INFINITY,
            _ => 1.0,
        }
    }

    /// A direction's part of an unknown's variance, for unit noise and columns.
    fn part(&self, unknown: usize, direction: usize) -> f64 {
        (self.vectors[(unknown, direction)] / self.sizes[direction]).powi(2)
    }

    fn variance(&self, unknown: usize) -> f64 {
        (0..self.sizes.len()).map(|k| self.part(unknown, k)).sum()
    }

    /// Standard error of an unknown for unit noise.
    fn spread(&self, unknown: usize) -> f64 {
        self.variance(unknown).sqrt() / self.lengths[unknown]
    }

    /// Whether no null direction dominates the unknown's variance.
    fn determines(&self, unknown: usize) -> bool {
        let null = (0..self.sizes.len()).filter(|&k| self.is_null(k));
        let part: f64 = null.map(|k| self.part(unknown, k)).sum();
        part <= DOMINANT * self.variance(unknown)
    }

    /// The others that an unknown cannot be told from.
    fn partners(&self, unknown: usize) -> Vec<usize> {
        let linked = |&other: &usize| {
            let correlation = self.correlation(unknown, other).abs();
            if self.determines(unknown) {
                correlation > BLURRED
            } else {
                !self.determines(other) && correlation > LINKED
            }
        };
        let others = (0..self.lengths.len()).filter(|&other| other != unknown);
        others.filter(linked).collect()
    }

    fn covariance(&self, a: usize, b: usize) -> f64 {
        let part = |k: usize| self.vectors[(a, k)] * self.vectors[(b, k)] / self.sizes[k].powi(2);
        (0..self.sizes.len()).map(part).sum()
    }

    fn correlation(&self, a: usize, b: usize) -> f64 {
        self.covariance(a, b) / (self.variance(a) * self.variance(b)).sqrt()
    }
}
