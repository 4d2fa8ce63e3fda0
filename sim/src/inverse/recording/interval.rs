//! What a fit says of each unknown, and what it cannot tell apart.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::Group;
use super::unknowns::Unknown;
use crate::inverse::priors::LITTLE;
use crate::inverse::student::NORMAL;

/// Correlations from here on are told.
const TOLD: f64 = 0.9;
/// Largest number of correlations that are told.
const MOST: usize = 20;

/// What was found of an unknown.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FittedUnknown {
    /// Its name.
    pub name: String,
    /// Its group.
    pub group: Group,
    /// Its unit; empty for a factor.
    pub unit: &'static str,
    /// Its value.
    pub value: f64,
    /// Ends of its 95 % interval, of the linearised model and the prior.
    pub interval: [f64; 2],
    /// Whether the recording says little of it: the interval is nearly as wide as the prior's.
    pub prior_only: bool,
}

/// Two unknowns whose effects are alike.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Correlation {
    /// Their names.
    pub names: [String; 2],
    /// Correlation of their errors.
    pub correlation: f64,
}

/// Covariance of the coordinates: the inverse of `J'J / error²`, in which the priors have rows of their own.
pub(super) fn covariance(jacobian: &DMatrix<f64>, error: f64) -> DMatrix<f64> {
    let information = jacobian.tr_mul(jacobian) / (error * error);
    let n = information.nrows();
    // Each prior has put a 1 on the diagonal.
    (information.cholesky()).map_or_else(|| DMatrix::identity(n, n), |factor| factor.inverse())
}

pub(super) fn fitted(
    unknowns: &[Unknown],
    x: &DVector<f64>,
    covariance: &DMatrix<f64>,
) -> Vec<FittedUnknown> {
    let one = |(i, unknown): (usize, &Unknown)| {
        let deviation = covariance[(i, i)].max(0.0).sqrt();
        let sought = &unknown.sought;
        let [low, high] = sought.limit().range;
        let end = |sign: f64| sought.value((x[i] + sign * NORMAL * deviation).clamp(low, high));
        FittedUnknown {
            name: sought.name.clone(),
            group: unknown.group(),
            unit: sought.unit,
            value: sought.value(x[i]),
            interval: [end(-1.0), end(1.0)],
            prior_only: deviation > LITTLE,
        }
    };
    unknowns.iter().enumerate().map(one).collect()
}

pub(super) fn correlations(unknowns: &[Unknown], covariance: &DMatrix<f64>) -> Vec<Correlation> {
    let mut all = Vec::new();
    for i in 0..unknowns.len() {
        for j in 0..i {
            let correlation = covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt();
            if correlation.abs() >= TOLD {
                let names = [j, i].map(|k| unknowns[k].sought.name.clone());
                all.push(Correlation { names, correlation });
            }
        }
    }
    all.sort_by(|a, b| b.correlation.abs().total_cmp(&a.correlation.abs()));
    all.truncate(MOST);
    all
}
