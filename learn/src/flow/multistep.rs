//! Linear multistep methods with variable steps: one evaluation of the field per step.

/// What a method extrapolates in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Extended {
    /// The velocity `u`: `dX/dt = u(t)`.
    Velocity,
    /// The data that the velocity points at, `D = X + (1 - t) u`: `dX/dt = (D(t) - X) / (1 - t)`.
    Data,
}

/// Highest order.
const ORDERS: usize = 3;

/// State of a multistep method. From the last evaluation on, the extrapolated quantity is taken to be the polynomial through
/// its last values,
///
/// ```text
/// f(s) = f_0 + (s - t) f_1 + (s - t) (s - t') f_2          t' the previous time; Newton's divided differences
/// ```
///
/// with as many terms as the method's order, or fewer in the first steps; the second step adds the second-order term that the
/// first step lacked. The differential equation with this polynomial is solved exactly (Hairer, Norsett and Wanner, Solving
/// Ordinary Differential Equations I, Sec. III.5; for the data, DPM-Solver++: Lu et al., 2022).
#[derive(Debug)]
pub(super) struct Multistep {
    extended: Extended,
    order: usize,
    /// The differences `f_0, f_1, f_2` at the last evaluation.
    differences: [Vec<f32>; ORDERS],
    /// Times of the last evaluations, the last first.
    times: [f64; ORDERS],
    evaluations: usize,
    /// Weight of the second-order term that the first step lacked, which the second step adds.
    owed: f64,
}

impl Multistep {
    /// Of order 1 to 3, for `len` components.
    pub fn new(extended: Extended, order: usize, len: usize) -> Self {
        let room = |k| vec![0.0; if k < order { len } else { 0 }];
        Self {
            extended,
            order,
            differences: [room(0), room(1), room(2)],
            times: [0.0; ORDERS],
            evaluations: 0,
            owed: 0.0,
        }
    }

    /// Adds the `velocity` of `points` at `t` to the last values.
    pub fn evaluate(&mut self, t: f64, points: &[f32], velocity: &[f32]) {
        self.owed = match (self.evaluations, self.order) {
            (1, 2..) => self.weights(t).terms[1],
            _ => 0.0,
        };
        let known = self.evaluations.min(self.order - 1);
        // f_j = (f_(j-1) - f_(j-1) before) / (t - time of j evaluations ago)
        let per_time = [0, 1].map(|j| (1.0 / (t - self.times[j])) as f32);
        let left = (1.0 - t) as f32;
        let [zeroth, first, second] = &mut self.differences;
        for (i, (x, u)) in points.iter().zip(velocity).enumerate() {
            let value = match self.extended {
                Extended::Velocity => *u,
                Extended::Data => x + left * u,
            };
            let slope = (value - zeroth[i]) * per_time[0];
            if known > 1 {
                second[i] = (slope - first[i]) * per_time[1];
            }
            if known > 0 {
                first[i] = slope;
            }
            zeroth[i] = value;
        }
        self.times = [t, self.times[0], self.times[1]];
        self.evaluations += 1;
    }

    /// Moves `points` from the time of the last evaluation to `end`.
    pub fn step(&self, end: f64, points: &mut [f32]) {
        let Weights { keep, mut terms } = self.weights(end);
        terms[1] += keep * self.owed;
        let (keep, [w0, w1, w2]) = (keep as f32, terms.map(|weight| weight as f32));
        let [f0, f1, f2] = &self.differences;
        match self.terms() {
            1 => {
                for (x, f0) in points.iter_mut().zip(f0) {
                    *x = keep * *x + w0 * f0;
                }
            }
            2 => {
                for (x, (f0, f1)) in points.iter_mut().zip(f0.iter().zip(f1)) {
                    *x = keep * *x + w0 * f0 + w1 * f1;
                }
            }
            _ => {
                for (x, ((f0, f1), f2)) in points.iter_mut().zip(f0.iter().zip(f1).zip(f2)) {
                    *x = keep * *x + w0 * f0 + w1 * f1 + w2 * f2;
                }
            }
        }
    }

    /// End of the longest step, 1 at the most, whose second-order term moves the points by no more than `tolerance` (root mean
    /// square over all components): an estimate of the local error of a first-order step. The first step is as long as if
    /// the flow changed by 1 per unit of time; each other one is at most twice as long as the last.
    pub fn longest_step(&self, tolerance: f64) -> f64 {
        /// Longest first step.
        const LONGEST_FIRST: f64 = 0.125;
        /// Largest ratio of a step to the last one.
        const GROWTH: f64 = 2.0;
        let [t, before, _] = self.times;
        let longest = match self.evaluations {
            1 => tolerance.sqrt().min(LONGEST_FIRST),
            _ => GROWTH * (t - before),
        };
        let end = (t + longest).min(1.0);
        if self.terms() < 2 {
            return end;
        }
        let slope = root_mean_square(&self.differences[1]);
        let moved = |end| self.weights(end).terms[1] * slope;
        if moved(end) <= tolerance {
            return end;
        }
        // Bisection: the second-order term grows with the step.
        let (mut low, mut high) = (t, end);
        for _ in 0..f32::MANTISSA_DIGITS {
            let middle = 0.5 * (low + high);
            if moved(middle) > tolerance {
                high = middle;
            } else {
                low = middle;
            }
        }
        low
    }

    /// Number of terms known.
    fn terms(&self) -> usize {
        self.evaluations.min(self.order)
    }

    /// Weights of points and differences in a step from the last evaluation to `end`.
    fn weights(&self, end: f64) -> Weights {
        let [t, before, _] = self.times;
        let (h, gap) = (end - t, t - before);
        match self.extended {
            Extended::Velocity => Weights {
                keep: 1.0,
                terms: [h, h * h / 2.0, h * h * (h / 3.0 + gap / 2.0)],
            },
            // X(end) = keep X + v' * integral of f(s) / (1 - s)^2, with v and v' the time left before and after the step.
            Extended::Data => {
                let [v, v_end] = [1.0 - t, 1.0 - end];
                let logarithm = if v_end > 0.0 {
                    v_end * (v / v_end).ln()
                } else {
                    0.0
                };
                let first = h - logarithm;
                Weights {
                    keep: v_end / v,
                    terms: [
                        h / v,
                        first,
                        h * (v + v_end) - 2.0 * v * logarithm + gap * first,
                    ],
                }
            }
        }
    }
}

/// Weights of a step.
struct Weights {
    /// Of the points.
    keep: f64,
    /// Of the differences.
    terms: [f64; ORDERS],
}

fn root_mean_square(values: &[f32]) -> f64 {
    let squares = values.iter().map(|value| f64::from(*value).powi(2));
    (squares.sum::<f64>() / values.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Times of very unequal steps.
    const TIMES: [f64; 6] = [0.0, 0.1, 0.15, 0.4, 0.9, 1.0];

    /// The error at the end of each step, from the third on of that step alone.
    fn errors(
        extended: Extended,
        order: usize,
        velocity: impl Fn(f64, f64) -> f64,
        exact: impl Fn(f64) -> f64,
    ) -> Vec<f64> {
        let mut multistep = Multistep::new(extended, order, 1);
        let mut x = [exact(0.0) as f32];
        let steps = TIMES.windows(2).enumerate().map(|(k, ends)| {
            let [start, end] = [ends[0], ends[1]];
            // The second step makes up for the first.
            if k >= 2 {
                x = [exact(start) as f32];
            }
            let u = velocity(start, x[0].into()) as f32;
            multistep.evaluate(start, &x, &[u]);
            multistep.step(end, &mut x);
            (f64::from(x[0]) - exact(end)).abs()
        });
        steps.collect()
    }

    #[test]
    fn a_velocity_that_is_a_polynomial_of_time_is_integrated_exactly() {
        for order in 1..=3 {
            let degree = order as i32 - 1;
            let exact = |t: f64| 0.3 + t.powi(degree + 1) / f64::from(degree + 1);
            let errors = errors(Extended::Velocity, order, |t, _| t.powi(degree), exact);
            assert!(
                errors[degree as usize..].iter().all(|e| *e < 1e-6),
                "{order}: {errors:?}"
            );
        }
    }

    /// `X = D(t) + (1 - t) (g(t) + constant)`, `D` a polynomial: the equation solved by hand.
    #[test]
    fn data_that_are_a_polynomial_of_time_are_followed_exactly() {
        let log = |t: f64| {
            if t < 1.0 {
                (1.0 - t) * (1.0 - t).ln()
            } else {
                0.0
            }
        };
        let left = |t: f64| 0.7 * (1.0 - t);
        // dX/dt = (D - X) / (1 - t).
        let constant = |t: f64| 0.2 + left(t);
        let linear = |t: f64| 1.0 + log(t) + left(t);
        let quadratic = |t: f64| t * (2.0 - t) + 2.0 * log(t) + left(t);
        let velocity = |degree: i32| {
            move |t: f64, x: f64| match degree {
                0 => (0.2 - x) / (1.0 - t),
                _ => (t.powi(degree) - x) / (1.0 - t),
            }
        };
        for (order, errors) in [
            (1, errors(Extended::Data, 1, velocity(0), constant)),
            (2, errors(Extended::Data, 2, velocity(1), linear)),
            (3, errors(Extended::Data, 3, velocity(2), quadratic)),
        ] {
            assert!(
                errors[order - 1..].iter().all(|e| *e < 1e-5),
                "{order}: {errors:?}"
            );
        }
    }

    #[test]
    fn the_longest_step_moves_by_the_tolerance() {
        let mut multistep = Multistep::new(Extended::Data, 2, 2);
        multistep.evaluate(0.0, &[0.5, -0.5], &[0.1, 0.3]);
        assert_eq!(multistep.longest_step(1e-4), 0.01);
        multistep.evaluate(0.25, &[0.5, -0.4], &[0.4, -0.1]);
        let end = multistep.longest_step(1e-3);
        let moved = multistep.weights(end).terms[1] * root_mean_square(&multistep.differences[1]);
        assert!((moved / 1e-3 - 1.0).abs() < 1e-3, "{moved}");
        assert_eq!(
            multistep.longest_step(1.0),
            0.75,
            "no more than twice the last"
        );
    }
}
