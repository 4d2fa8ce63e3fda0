//! Bounds of friction that follow the normal impulses: a fixed point, whose iterates are extrapolated.
//!
//! With bounds `b` the problem has normal impulses that ask for bounds `g(b)`; those wanted are `b = g(b)`. With `f = g - b`, and `dg` and
//! `df` the differences of iterates, the next bounds are `g - sum c dg`, where the factors `c` make `|f - sum c df|` least: Anderson's
//! mixing (J. ACM, 1965; Walker and Ni, SIAM J. Numer. Anal. 2011).
//!
//! Where friction bears much on the normal impulses these iterates may come to no end. Others follow each bound by a share of its
//! residual, which is halved where the residual has changed its sign, and grows where it has not.
//!
//! Among objects the first bounds of a step are the last ones of the step before.

use nalgebra::{SMatrix, SVector};

use super::touch::{Name, Touch};

/// Number of differences that are kept.
const DEPTH: usize = 3;
/// What is added to the diagonal of the normal equations, by differences of unit length.
const RIDGE: f64 = 1e-10;
/// How many times the least residual so far may be had before what is known is taken to be of other contacts.
const WORSE: f64 = 2.0;
/// By how much the share of a damped bound falls and grows.
const LESS: f64 = 0.5;
const MORE: f64 = 1.2;

/// The iterates of one step, and what the last one ended with.
#[derive(Clone, Debug, Default)]
pub(super) struct Bounds {
    /// The last `g` and `f`, and the differences before.
    last: Option<Pair>,
    differences: Vec<Pair>,
    least: f64,
    /// Of each bound that is damped, the share and the last residual.
    damped: Vec<(f64, f64)>,
    /// The bounds at the end of the last step, by their contacts' names.
    known: Vec<(Name, f64)>,
}

#[derive(Clone, Debug, Default)]
struct Pair {
    found: Vec<f64>,
    residual: Vec<f64>,
}

impl Bounds {
    /// Forgets the last step.
    pub fn forget(&mut self) {
        self.known.clear();
    }

    /// Keeps the bounds for the next step.
    pub fn keep(&mut self, touches: &[Touch]) {
        self.known.clear();
        (self.known).extend(touches.iter().map(|touch| (touch.name, touch.bound)));
    }

    /// Starts with the bounds of the last step. Contacts of one name are taken in their order.
    pub fn recall(&self, touches: &mut [Touch]) {
        let mut from = 0;
        for touch in touches {
            let rest = &self.known[from..];
            if let Some(found) = rest.iter().position(|(name, _)| *name == touch.name) {
                touch.bound = rest[found].1;
                from += found + 1;
            }
        }
    }

    /// Begins anew, without iterates.
    pub fn begin(&mut self) {
        self.last = None;
        self.differences.clear();
        self.damped.clear();
        self.least = f64::INFINITY;
    }

    /// The bounds that come after `bounds`, with which those `found` were: nearer to these by a share of each.
    pub fn next_damped(&mut self, bounds: &[f64], found: Vec<f64>) -> Vec<f64> {
        self.damped.resize(bounds.len(), (1.0, 0.0));
        let damped = self.damped.iter_mut();
        let next = bounds.iter().zip(found).zip(damped);
        let next = next.map(|((bound, found), (share, last))| {
            let residual = found - bound;
            *share = match residual * *last < 0.0 {
                true => *share * LESS,
                false => (*share * MORE).min(1.0),
            };
            *last = residual;
            bound + *share * residual
        });
        next.collect()
    }

    /// The bounds that come after `bounds`, with which those `found` were.
    pub fn next(&mut self, bounds: &[f64], found: Vec<f64>) -> Vec<f64> {
        let residual: Vec<f64> = minus(&found, bounds);
        let size = dot(&residual, &residual).sqrt();
        if size > WORSE * self.least {
            self.begin();
        }
        self.least = self.least.min(size);
        let now = Pair { found, residual };
        if let Some(last) = &self.last {
            if self.differences.len() == DEPTH {
                self.differences.remove(0);
            }
            self.differences.push(Pair {
                found: minus(&now.found, &last.found),
                residual: minus(&now.residual, &last.residual),
            });
        }
        let mut next = now.found.clone();
        for (difference, factor) in self.differences.iter().zip(&self.factors(&now.residual)) {
            for (next, change) in next.iter_mut().zip(&difference.found) {
                *next -= factor * change;
            }
        }
        next.iter_mut().for_each(|bound| *bound = bound.max(0.0));
        self.last = Some(now);
        next
    }

    /// Factors of the differences of residuals whose sum is nearest to `residual`.
    fn factors(&self, residual: &[f64]) -> SVector<f64, DEPTH> {
        let mut matrix = SMatrix::<f64, DEPTH, DEPTH>::identity();
        let mut right = SVector::<f64, DEPTH>::zeros();
        let length = |pair: &Pair| dot(&pair.residual, &pair.residual).sqrt();
        let lengths: Vec<f64> = self.differences.iter().map(length).collect();
        if lengths.contains(&0.0) {
            return right;
        }
        for (row, one) in self.differences.iter().enumerate() {
            for (column, other) in self.differences.iter().enumerate() {
                let scale = lengths[row] * lengths[column];
                matrix[(row, column)] = dot(&one.residual, &other.residual) / scale;
            }
            matrix[(row, row)] += RIDGE;
            right[row] = dot(&one.residual, residual) / lengths[row];
        }
        let Some(solved) = matrix.cholesky() else {
            return SVector::zeros();
        };
        let mut factors = solved.solve(&right);
        for (factor, length) in factors.iter_mut().zip(lengths) {
            *factor /= length;
        }
        factors
    }
}

fn minus(one: &[f64], other: &[f64]) -> Vec<f64> {
    one.iter().zip(other).map(|(a, b)| a - b).collect()
}

fn dot(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map whose iterates, extrapolated or not, go away from its fixed point.
    #[test]
    fn the_fixed_point_of_a_steep_map_is_found_by_damped_iterates() {
        for steepness in [5.0, 30.0, 100.0] {
            let map = |b: &[f64]| vec![(1.0 - steepness * b[0]).max(0.0), 0.5 + 0.1 * b[0]];
            let mut bounds = Bounds::default();
            bounds.begin();
            let mut at = vec![0.0; 2];
            let found = (0..100).find(|_| {
                let found = map(&at);
                let error = minus(&found, &at);
                at = bounds.next_damped(&at, found);
                dot(&error, &error).sqrt() < 1e-6
            });
            assert!(found.is_some(), "{steepness}: {at:?}");
        }
    }

    /// A map that takes the error down by 0.85 an iteration, which alone would take 85 iterations.
    #[test]
    fn the_fixed_point_of_a_slow_linear_map_is_found_in_a_few_iterations() {
        let map = |b: &[f64]| vec![1.0 + 0.9 * b[1], 2.0 - 0.8 * b[0], 0.5 * b[2] + 0.1 * b[0]];
        let mut bounds = Bounds::default();
        bounds.begin();
        let mut at = vec![0.0; 3];
        for _ in 0..8 {
            let found = map(&at);
            at = bounds.next(&at, found);
        }
        let error = minus(&map(&at), &at);
        assert!(dot(&error, &error).sqrt() < 1e-6, "{at:?}: {error:?}");
    }
}
