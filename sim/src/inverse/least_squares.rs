//! Nonlinear least squares within bounds.
//!
//! Levenberg's and Marquardt's method (Nocedal and Wright, Numerical Optimization, ch. 10) with
//! More's scaling by the largest column norms seen, Nielsen's damping, steps that minimise the damped
//! quadratic model within the bounds, and for large residuals the model's curvature by secants (Dennis,
//! Gay and Welsch, An adaptive nonlinear least-squares algorithm, 1981).

use nalgebra::{DMatrix, DVector};

/// Damping at first, relative to the scaled normal matrix, whose diagonal is 1.
const FIRST_DAMPING: f64 = 1e-3;
const LEAST_DAMPING: f64 = 1e-12;
/// Damping at which no step is worth trying any more.
const LARGEST_DAMPING: f64 = 1e16;
/// Share of the predicted decrease that a step must bring.
const ENOUGH: f64 = 1e-4;
/// Damping with which what is left to gain is judged: directions weaker than its root are left out.
const JUDGING_DAMPING: f64 = 1e-8;
/// Squared column norms below this share of the largest are scaled as if they were that large.
const LEAST_SCALE: f64 = 1e-16;

/// Residuals and their Jacobian at a point, and whatever helps to evaluate near it.
pub(super) struct Evaluation<M> {
    pub residuals: DVector<f64>,
    pub jacobian: DMatrix<f64>,
    pub memory: M,
}

impl<M> Evaluation<M> {
    /// Sum of the squared residuals.
    pub fn cost(&self) -> f64 {
        self.residuals.norm_squared()
    }

    /// Gradient of half the cost.
    pub fn gradient(&self) -> DVector<f64> {
        self.jacobian.tr_mul(&self.residuals)
    }
}

/// Where a minimisation ended.
pub(super) struct Fit<M> {
    pub x: DVector<f64>,
    pub at: Evaluation<M>,
    /// Steps tried.
    pub steps: usize,
}

/// How far an unknown may go.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limit {
    /// Its smallest and largest value.
    pub range: [f64; 2],
    /// Its largest change in one step: about how far its effect is linear.
    pub reach: f64,
}

impl Limit {
    /// A share of something: from 0 to 1, in one step if need be.
    pub const SHARE: Self = Self {
        range: [0.0, 1.0],
        reach: 1.0,
    };

    /// Whether a value is at an end of the range.
    pub fn stops(&self, value: f64) -> bool {
        value <= self.range[0] || value >= self.range[1]
    }
}

/// Goes down from `start`, within the `limits` of each unknown, until `done`, or no step brings
/// anything, or `max_steps` have been tried. A point that `evaluate` has no value for is
/// avoided. `evaluate` also gets the memory of the last point accepted.
pub(super) fn minimise<M>(
    start: DVector<f64>,
    first: Evaluation<M>,
    limits: &[Limit],
    max_steps: usize,
    mut evaluate: impl FnMut(&DVector<f64>, &M) -> Option<Evaluation<M>>,
    mut done: impl FnMut(&DVector<f64>, &Evaluation<M>) -> bool,
) -> Fit<M> {
    let mut fit = Fit {
        x: start,
        at: first,
        steps: 0,
    };
    let mut scale = DVector::zeros(fit.x.len());
    let mut curvature = DMatrix::zeros(fit.x.len(), fit.x.len());
    let (mut damping, mut growth) = (FIRST_DAMPING, 2.0);
    while fit.steps < max_steps && damping < LARGEST_DAMPING && !done(&fit.x, &fit.at) {
        fit.steps += 1;
        enlarge(&mut scale, &fit.at.jacobian);
        let model = Model::new(&fit.x, &fit.at, &curvature, &scale, limits);
        let step = model.step(damping);
        let predicted = model.decrease(&step);
        let mut moved = &fit.x + step.component_div(&scale);
        for (i, (x, limit)) in moved.iter_mut().zip(limits).enumerate() {
            let [low, high] = limit.range;
            // A step to the end of a range is to the end itself, whatever rounding says.
            *x = match step[i] {
                s if s == model.low[i] && low - fit.x[i] >= -limit.reach => low,
                s if s == model.high[i] && high - fit.x[i] <= limit.reach => high,
                _ => x.clamp(low, high),
            };
        }
        if predicted <= f64::EPSILON * fit.at.cost() || moved == fit.x {
            break;
        }
        let trial = evaluate(&moved, &fit.at.memory);
        let ratio = trial.as_ref().map_or(f64::NEG_INFINITY, |trial| {
            (fit.at.cost() - trial.cost()) / predicted
        });
        match trial {
            Some(trial) if ratio > ENOUGH => {
                update_curvature(&mut curvature, &(&moved - &fit.x), &fit.at, &trial);
                (fit.x, fit.at) = (moved, trial);
                let shrink = 1.0 - (2.0 * ratio - 1.0).powi(3);
                damping = (damping * shrink.max(1.0 / 3.0)).max(LEAST_DAMPING);
                growth = 2.0;
            }
            _ => {
                damping *= growth;
                growth *= 2.0;
            }
        }
    }
    fit
}

/// By how much the cost could still fall in one step within the limits, by the linear model at `x`.
pub(super) fn left_to_gain<M>(x: &DVector<f64>, at: &Evaluation<M>, limits: &[Limit]) -> f64 {
    let mut scale = DVector::zeros(x.len());
    enlarge(&mut scale, &at.jacobian);
    let model = Model::new(x, at, &DMatrix::zeros(x.len(), x.len()), &scale, limits);
    model.decrease(&model.step(JUDGING_DAMPING))
}

/// Raises the scale of each unknown to the norm of its column.
fn enlarge(scale: &mut DVector<f64>, jacobian: &DMatrix<f64>) {
    for (scale, column) in scale.iter_mut().zip(jacobian.column_iter()) {
        *scale = scale.max(column.norm());
    }
    let least = (LEAST_SCALE.sqrt() * scale.max()).max(f64::MIN_POSITIVE);
    scale.iter_mut().for_each(|s| *s = s.max(least));
}

/// Makes `curvature`, the residuals' second derivatives weighted by the residuals, agree with the change
/// of the Jacobian over a step, and no larger than that change along it.
fn update_curvature<M>(
    curvature: &mut DMatrix<f64>,
    step: &DVector<f64>,
    from: &Evaluation<M>,
    to: &Evaluation<M>,
) {
    let seen = (&to.jacobian - &from.jacobian).tr_mul(&to.residuals);
    let change = to.gradient() - from.gradient();
    let along = change.dot(step);
    if along <= 0.0 {
        return;
    }
    let known = (&*curvature * step).dot(step);
    let size = (seen.dot(step) / known).abs();
    if known != 0.0 && size < 1.0 {
        *curvature *= size;
    }
    let missing = seen - &*curvature * step;
    let cross = &missing * change.transpose() / along;
    *curvature += &cross + cross.transpose();
    *curvature -= &change * change.transpose() * (missing.dot(step) / (along * along));
}

/// The quadratic model of half the cost in scaled unknowns, about the present point.
struct Model {
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
    low: DVector<f64>,
    high: DVector<f64>,
}

impl Model {
    fn new<M>(
        x: &DVector<f64>,
        at: &Evaluation<M>,
        curvature: &DMatrix<f64>,
        scale: &DVector<f64>,
        limits: &[Limit],
    ) -> Self {
        let unscaled = at.jacobian.tr_mul(&at.jacobian) + curvature;
        let hessian = |i: usize, j: usize| unscaled[(i, j)] / (scale[i] * scale[j]);
        let room = |side: usize| {
            let room = |i: usize, _| {
                let Limit { range, reach } = limits[i];
                (range[side] - x[i]).clamp(-reach, reach) * scale[i]
            };
            DVector::from_fn(x.len(), room)
        };
        Self {
            hessian: DMatrix::from_fn(x.len(), x.len(), hessian),
            gradient: at.gradient().component_div(scale),
            low: room(0),
            high: room(1),
        }
    }

    /// By how much a step makes the cost fall.
    fn decrease(&self, step: &DVector<f64>) -> f64 {
        -(2.0 * self.gradient.dot(step) + (&self.hessian * step).dot(step))
    }

    /// The step within the bounds that minimises the model, damped at least so much, and so much that it
    /// is convex: a primal active-set method (Nocedal
    /// and Wright, ch. 16.5), exact but for rounding.
    fn step(&self, damping: f64) -> DVector<f64> {
        let n = self.gradient.len();
        let softest = self.hessian.symmetric_eigenvalues().min();
        let damping = damping * (1.0 + softest.abs()) + (-softest).max(0.0);
        let mut hessian = self.hessian.clone();
        (0..n).for_each(|i| hessian[(i, i)] += damping);
        let mut step = DVector::zeros(n);
        let stopped = |i: usize, slope: f64| match slope {
            s if s > 0.0 => self.low[i] >= 0.0,
            s if s < 0.0 => self.high[i] <= 0.0,
            _ => false,
        };
        let mut free: Vec<bool> = (0..n).map(|i| !stopped(i, self.gradient[i])).collect();
        // Each round either stops one more unknown or lowers the model for good; sixteen rounds for
        // each are far more than ever seen, and any step on the way is a step down.
        for _ in 0..16 * n {
            let Some(goal) = self.minimiser(&hessian, &step, &free) else {
                return step;
            };
            match self.first_bound(&step, &goal) {
                Some((index, share)) => {
                    step += (&goal - &step) * share;
                    step[index] = if goal[index] < self.low[index] {
                        self.low[index]
                    } else {
                        self.high[index]
                    };
                    free[index] = false;
                }
                None => {
                    step = goal;
                    let slope = &hessian * &step + &self.gradient;
                    // How strongly an unknown at a bound is drawn away from it.
                    let pull = |i: usize| match free[i] {
                        true => 0.0,
                        false if step[i] == self.low[i] => -slope[i],
                        false => slope[i],
                    };
                    let Some(freed) = (0..n).max_by(|&a, &b| pull(a).total_cmp(&pull(b))) else {
                        return step;
                    };
                    if pull(freed) <= 1e-12 * self.gradient.amax() {
                        return step;
                    }
                    free[freed] = true;
                }
            }
        }
        step
    }

    /// The minimiser over the free unknowns, the others as in `step`.
    fn minimiser(
        &self,
        hessian: &DMatrix<f64>,
        step: &DVector<f64>,
        free: &[bool],
    ) -> Option<DVector<f64>> {
        let free: Vec<usize> = (0..free.len()).filter(|&i| free[i]).collect();
        let mut goal = step.clone();
        free.iter().for_each(|&i| goal[i] = 0.0);
        let slope = hessian * &goal + &self.gradient;
        let block = DMatrix::from_fn(free.len(), free.len(), |i, j| hessian[(free[i], free[j])]);
        let rhs = DVector::from_fn(free.len(), |i, _| -slope[free[i]]);
        let solution = block.cholesky()?.solve(&rhs);
        for (value, &i) in solution.iter().zip(&free) {
            goal[i] = *value;
        }
        Some(goal)
    }

    /// The unknown that meets its bound first on the way from `step` to `goal`, and the share of the
    /// way until there.
    fn first_bound(&self, step: &DVector<f64>, goal: &DVector<f64>) -> Option<(usize, f64)> {
        let share = |i: usize| {
            let bound = match goal[i] {
                g if g < self.low[i] => self.low[i],
                g if g > self.high[i] => self.high[i],
                _ => return None,
            };
            Some((i, ((bound - step[i]) / (goal[i] - step[i])).clamp(0.0, 1.0)))
        };
        (0..step.len())
            .filter_map(share)
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit(
        start: [f64; 2],
        bounds: [[f64; 2]; 2],
        residuals: impl Fn(f64, f64) -> ([f64; 2], [f64; 4]),
    ) -> Fit<()> {
        let evaluate = |x: &DVector<f64>| {
            let (residuals, jacobian) = residuals(x[0], x[1]);
            Evaluation {
                residuals: DVector::from_row_slice(&residuals),
                jacobian: DMatrix::from_row_slice(2, 2, &jacobian),
                memory: (),
            }
        };
        let start = DVector::from_row_slice(&start);
        let first = evaluate(&start);
        let never = |_: &DVector<f64>, _: &Evaluation<()>| false;
        let limits = bounds.map(|range| Limit {
            range,
            reach: f64::INFINITY,
        });
        minimise(start, first, &limits, 500, |x, ()| Some(evaluate(x)), never)
    }

    fn rosenbrock(x: f64, y: f64) -> ([f64; 2], [f64; 4]) {
        let residuals = [10.0 * (y - x * x), 1.0 - x];
        (residuals, [-20.0 * x, 10.0, -1.0, 0.0])
    }

    #[test]
    fn the_minimum_in_a_curved_valley_is_found() {
        let free = [[-5.0, 5.0]; 2];
        let found = fit([-1.2, 1.0], free, rosenbrock);
        assert!((found.x - DVector::from_row_slice(&[1.0, 1.0])).amax() < 1e-9);
    }

    /// On the face `x = 0.5` the minimum of Rosenbrock's function is at `y = 0.25`.
    #[test]
    fn a_minimum_on_a_bound_is_found_on_it() {
        let found = fit([-1.2, 1.0], [[-5.0, 0.5], [-5.0, 5.0]], rosenbrock);
        assert_eq!(found.x[0], 0.5);
        assert!((found.x[1] - 0.25).abs() < 1e-9);
    }

    /// Coupled unknowns: clamping the unbounded minimum would not minimise within the bounds.
    #[test]
    fn a_step_minimises_the_model_within_its_bounds() {
        let model = Model {
            hessian: DMatrix::from_row_slice(2, 2, &[2.0, 1.5, 1.5, 2.0]),
            gradient: DVector::from_row_slice(&[-1.0, -3.0]),
            low: DVector::from_element(2, -1.0),
            high: DVector::from_element(2, 0.8),
        };
        let step = model.step(0.0);
        let value = |p: &DVector<f64>| (&model.hessian * p).dot(p) / 2.0 + model.gradient.dot(p);
        let mut best = f64::INFINITY;
        for i in 0..=360 {
            for j in 0..=360 {
                let at = [i, j].map(|k| -1.0 + 1.8 * f64::from(k) / 360.0);
                best = best.min(value(&DVector::from_row_slice(&at)));
            }
        }
        assert!(step.iter().all(|s| (-1.0..=0.8).contains(s)));
        assert!(value(&step) <= best + 1e-12, "{} {best}", value(&step));
    }
}
