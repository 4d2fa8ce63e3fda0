//! Integration of a velocity field from prior to data.

use serde::{Deserialize, Serialize};

use super::{FlowError, require};

/// A velocity field `u(X, t | c)` over whole clouds.
pub trait VelocityField {
    /// Velocities `(N, C)` of `points` `(N, C)`, row-major, at flow time `t` in [0, 1] under `condition`; all in
    /// normalised units.
    fn velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]);
}

/// Where in [0, 1] the steps of an integration lie.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeGrid {
    /// Equal steps, `t_k = k/n` (paper, Alg. tdcr-sampling).
    Uniform,
    /// `t_k = 1 - (1 - k/n)^p`: for `p > 1` denser towards the data, where the learned field bends most.
    Power(f32),
}

impl TimeGrid {
    /// The grid of `steps` steps: `steps + 1` times from 0 to 1.
    pub fn times(&self, steps: usize) -> impl Iterator<Item = f32> {
        let exponent = match self {
            Self::Uniform => 1.0,
            Self::Power(exponent) => f64::from(*exponent),
        };
        (0..=steps).map(move |k| (1.0 - (1.0 - k as f64 / steps as f64).powf(exponent)) as f32)
    }
}

/// How a step of the integration is taken, from `t` to `t' = t + h`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Heun's method (improved Euler, second order; paper, Alg. tdcr-sampling): two evaluations of the field per step.
    #[default]
    Heun,
    /// Euler's method: first order, one evaluation per step.
    Euler,
    /// Adams and Bashforth's method of second order with the last step's velocity: one evaluation per step.
    AdamsBashforth,
    /// The same on the data that the velocity points at, `D = X + (1 - t) u`, one evaluation per step. `D` is extended
    /// linearly in `t` from the last two evaluations, and `dX/dt = (D - X) / (1 - t)` is then solved exactly
    /// (an exponential multistep method, as DPM-Solver++ 2M: Lu et al., 2022). For clouds `D` moves much less than the
    /// velocity near the data.
    Exponential,
}

/// Integration of a field from prior to data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sampler {
    /// How steps are taken.
    #[serde(default)]
    pub method: Method,
    /// Number of steps.
    pub steps: usize,
    /// Where they lie.
    pub grid: TimeGrid,
}

impl Default for Sampler {
    /// [`Sampler::DEFAULT`].
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 4] = [
        Self::Heun,
        Self::Euler,
        Self::AdamsBashforth,
        Self::Exponential,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Heun => "heun",
            Self::Euler => "euler",
            Self::AdamsBashforth => "adams-bashforth",
            Self::Exponential => "exponential",
        }
    }
}

impl Sampler {
    /// 16 steps of the exponential method on the quadratic grid: clouds as good as those of 100 evaluations by Heun's.
    pub const DEFAULT: Self = Self {
        method: Method::Exponential,
        steps: 16,
        grid: TimeGrid::Power(2.0),
    };

    /// The paper's sampler: 100 equal steps of Heun's method.
    pub const PAPER: Self = Self {
        method: Method::Heun,
        steps: 100,
        grid: TimeGrid::Uniform,
    };

    /// Refuses values that make no grid.
    pub fn check(&self) -> Result<(), FlowError> {
        require(
            (1..=100_000).contains(&self.steps),
            "sampler steps",
            self.steps as f64,
            "1 to 100000",
        )?;
        match self.grid {
            TimeGrid::Uniform => Ok(()),
            TimeGrid::Power(p) => require(
                (1.0..=10.0).contains(&p),
                "sampler grid power",
                p.into(),
                "1 to 10",
            ),
        }
    }

    /// Evaluations of the field that an integration takes.
    pub fn evaluations(&self) -> usize {
        match self.method {
            Method::Heun => 2 * self.steps,
            _ => self.steps,
        }
    }

    /// Carries `points` `(N, C)` from `t = 0` to `t = 1`, in place.
    pub fn integrate(&self, field: &impl VelocityField, condition: &[f32], points: &mut [f32]) {
        self.integrate_observed(field, condition, points, |_, _| {});
    }

    /// [`Sampler::integrate`] that shows the points after every step to `observe`, with the number of steps taken.
    pub fn integrate_observed(
        &self,
        field: &impl VelocityField,
        condition: &[f32],
        points: &mut [f32],
        mut observe: impl FnMut(usize, &[f32]),
    ) {
        let times: Vec<f32> = self.grid.times(self.steps).collect();
        let mut velocity = vec![0.0; points.len()];
        let mut last = velocity.clone();
        let mut ahead = match self.method {
            Method::Heun => velocity.clone(),
            _ => Vec::new(),
        };
        for k in 0..self.steps {
            let (start, end) = (times[k], times[k + 1]);
            let h = end - start;
            field.velocity(start, condition, points, &mut velocity);
            // How far a step goes on as the last one changed: 0 in the first.
            let ratio = if k > 0 {
                h / (start - times[k - 1])
            } else {
                0.0
            };
            match self.method {
                Method::Euler => step(points, &velocity, h),
                Method::Heun => {
                    ahead.copy_from_slice(points);
                    step(&mut ahead, &velocity, h);
                    field.velocity(end, condition, &ahead, &mut last);
                    step(points, &velocity, 0.5 * h);
                    step(points, &last, 0.5 * h);
                }
                Method::AdamsBashforth => {
                    step(points, &velocity, h * (1.0 + 0.5 * ratio));
                    step(points, &last, -0.5 * h * ratio);
                    last.copy_from_slice(&velocity);
                }
                Method::Exponential => {
                    // From here on `velocity` and `last` are the data that the velocity points at.
                    let (u, u_end) = (1.0 - start, 1.0 - end);
                    velocity
                        .iter_mut()
                        .zip(&*points)
                        .for_each(|(v, x)| *v = x + u * *v);
                    // Of `D`'s slope in time, the integral over the step.
                    let curved = if u_end > 0.0 {
                        u_end * (u / u_end).ln()
                    } else {
                        0.0
                    };
                    let slope = ratio / h * (h - curved);
                    let keep = u_end / u;
                    for ((x, d), before) in points.iter_mut().zip(&velocity).zip(&last) {
                        *x = keep * *x + (1.0 - keep) * d + slope * (d - before);
                    }
                    last.copy_from_slice(&velocity);
                }
            }
            observe(k + 1, points);
        }
    }
}

/// `x += h v`.
fn step(points: &mut [f32], velocity: &[f32], h: f32) {
    for (x, v) in points.iter_mut().zip(velocity) {
        *x += h * v;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The exact marginal velocity that carries `N(0, a^2)` to `N(0, b^2)` along straight paths.
    ///
    /// `X_t` has deviation `s(t)`, `s^2 = (1-t)^2 a^2 + t^2 b^2`, and `u = x s'/s`, so `X_1 = X_0 b/a`.
    struct Gaussian {
        a: f32,
        b: f32,
    }

    impl VelocityField for Gaussian {
        fn velocity(&self, t: f32, _: &[f32], points: &[f32], velocities: &mut [f32]) {
            let (a, b) = (self.a * self.a, self.b * self.b);
            let rate = (t * b - (1.0 - t) * a) / ((1.0 - t) * (1.0 - t) * a + t * t * b);
            velocities
                .iter_mut()
                .zip(points)
                .for_each(|(v, x)| *v = rate * x);
        }
    }

    fn error(field: &Gaussian, sampler: Sampler) -> f32 {
        let mut points = [0.3, -0.5, 0.7];
        sampler.integrate(field, &[], &mut points);
        (points[1] / -0.5 - field.b / field.a).abs()
    }

    #[test]
    fn methods_converge_with_their_order() {
        let field = Gaussian { a: 0.5, b: 0.2 };
        for (method, expected) in [
            (Method::Heun, 2.0),
            (Method::Euler, 1.0),
            (Method::AdamsBashforth, 2.0),
            (Method::Exponential, 2.0),
        ] {
            for grid in [TimeGrid::Uniform, TimeGrid::Power(2.0)] {
                let sampler = |steps| Sampler {
                    method,
                    steps,
                    grid,
                };
                let [coarse, fine] = [64, 128].map(|steps| error(&field, sampler(steps)));
                let order = (coarse / fine).log2();
                assert!(
                    (order - expected).abs() < 0.3,
                    "{method:?} {grid:?}: {order}"
                );
            }
        }
    }

    /// Where all paths lead to one point, its prediction is right from the first step on.
    #[test]
    fn the_exponential_method_is_exact_for_a_point() {
        let field = Gaussian { a: 0.5, b: 0.0 };
        let at_once = Sampler {
            method: Method::Exponential,
            steps: 2,
            grid: TimeGrid::Uniform,
        };
        assert!(error(&field, at_once) < 1e-6);
    }

    #[test]
    fn evaluations_are_counted() {
        struct Counting(std::sync::atomic::AtomicUsize);
        impl VelocityField for Counting {
            fn velocity(&self, _: f32, _: &[f32], _: &[f32], velocities: &mut [f32]) {
                self.0.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                velocities.fill(0.0);
            }
        }
        for method in Method::ALL {
            let sampler = Sampler {
                method,
                ..Sampler::default()
            };
            let field = Counting(0.into());
            sampler.integrate(&field, &[], &mut [0.0; 3]);
            assert_eq!(field.0.into_inner(), sampler.evaluations());
        }
    }

    #[test]
    fn constant_velocity_is_integrated_exactly() {
        struct Constant;
        impl VelocityField for Constant {
            fn velocity(&self, _: f32, condition: &[f32], _: &[f32], velocities: &mut [f32]) {
                velocities.fill(condition[0]);
            }
        }
        for method in [Method::Heun, Method::Euler, Method::AdamsBashforth] {
            let mut points = [0.25, -0.5, 0.75];
            let sampler = Sampler {
                method,
                steps: 8,
                grid: TimeGrid::Uniform,
            };
            sampler.integrate(&Constant, &[0.5], &mut points);
            assert_eq!(points, [0.75, 0.0, 1.25], "{method:?}");
        }
    }

    #[test]
    fn a_grid_dense_near_the_data_resolves_a_narrow_cloud_better() {
        let field = Gaussian { a: 0.5, b: 0.02 };
        let [uniform, dense] = [TimeGrid::Uniform, TimeGrid::Power(2.0)].map(|grid| {
            error(
                &field,
                Sampler {
                    grid,
                    ..Sampler::default()
                },
            )
        });
        assert!(dense < 0.25 * uniform, "{dense} against {uniform}");
    }

    #[test]
    fn grids_run_from_zero_to_one() {
        for grid in [
            TimeGrid::Uniform,
            TimeGrid::Power(2.0),
            TimeGrid::Power(3.0),
        ] {
            let times: Vec<f32> = grid.times(4).collect();
            assert_eq!((times.len(), times[0], times[4]), (5, 0.0, 1.0));
            assert!(times.is_sorted());
        }
        assert_eq!(TimeGrid::Power(2.0).times(4).nth(1), Some(0.4375));
    }

    #[test]
    fn a_sampler_without_steps_is_refused() {
        let error = Sampler {
            steps: 0,
            ..Sampler::default()
        }
        .check()
        .expect_err("no steps");
        assert_eq!(
            error.to_string(),
            "sampler steps is 0, expected 1 to 100000"
        );
    }
}
