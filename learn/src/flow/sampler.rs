//! Integration of a velocity field from prior to data.

use serde::{Deserialize, Serialize};

use super::{FlowError, require};

/// A velocity field `u(X, t | c)` over whole clouds.
pub trait VelocityField {
    /// Velocities `(N, 3)` of `points` `(N, 3)`, row-major, at flow time `t` in [0, 1] under `condition`; all in
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

/// Heun's method (improved Euler, second order; paper, Alg. tdcr-sampling): two evaluations of the field per step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Heun {
    /// Number of steps.
    pub steps: usize,
    /// Where they lie.
    pub grid: TimeGrid,
}

impl Default for Heun {
    /// 16 steps of the quadratic grid.
    fn default() -> Self {
        Self {
            steps: 16,
            grid: TimeGrid::Power(2.0),
        }
    }
}

impl Heun {
    /// The paper's sampler: 100 equal steps.
    pub const PAPER: Self = Self {
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

    /// Carries `points` `(N, 3)` from `t = 0` to `t = 1`, in place.
    pub fn integrate(&self, field: &impl VelocityField, condition: &[f32], points: &mut [f32]) {
        let mut first = vec![0.0; points.len()];
        let mut second = first.clone();
        let mut ahead = first.clone();
        let mut start = 0.0;
        for end in self.grid.times(self.steps).skip(1) {
            let h = end - start;
            field.velocity(start, condition, points, &mut first);
            for ((ahead, x), v) in ahead.iter_mut().zip(&*points).zip(&first) {
                *ahead = x + h * v;
            }
            field.velocity(end, condition, &ahead, &mut second);
            for ((x, v1), v2) in points.iter_mut().zip(&first).zip(&second) {
                *x += 0.5 * h * (v1 + v2);
            }
            start = end;
        }
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

    fn error(field: &Gaussian, sampler: Heun) -> f32 {
        let mut points = [0.3, -0.5, 0.7];
        sampler.integrate(field, &[], &mut points);
        (points[1] / -0.5 - field.b / field.a).abs()
    }

    #[test]
    fn heun_converges_with_second_order() {
        let field = Gaussian { a: 0.5, b: 0.2 };
        for grid in [TimeGrid::Uniform, TimeGrid::Power(2.0)] {
            let [coarse, fine] = [16, 32].map(|steps| error(&field, Heun { steps, grid }));
            let order = (coarse / fine).log2();
            assert!((1.8..2.2).contains(&order), "{grid:?}: {order}");
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
        let mut points = [1.0, 2.0, 3.0];
        Heun {
            steps: 8,
            grid: TimeGrid::Uniform,
        }
        .integrate(&Constant, &[0.5], &mut points);
        assert_eq!(points, [1.5, 2.5, 3.5]);
    }

    #[test]
    fn a_grid_dense_near_the_data_resolves_a_narrow_cloud_better() {
        let field = Gaussian { a: 0.5, b: 0.02 };
        let [uniform, dense] = [TimeGrid::Uniform, TimeGrid::Power(2.0)]
            .map(|grid| error(&field, Heun { steps: 16, grid }));
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
        let error = Heun {
            steps: 0,
            grid: TimeGrid::Uniform,
        }
        .check()
        .expect_err("no steps");
        assert_eq!(
            error.to_string(),
            "sampler steps is 0, expected 1 to 100000"
        );
    }
}
