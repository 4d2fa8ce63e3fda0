//! The straight path from prior to data.

use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use super::coupling::Coupling;
use super::error::{FlowError, require};
use crate::channels::{Channels, DIM};

/// Prior, coupling, path and distribution of flow times (paper, Sec. Method).
///
/// Positions start at `X_0 ~ N(0, sigma^2 I)`, colours uniform in [0, 1]; `X_t = (1 - t) X_0 + t X_1`
/// (Eq. linear_path_tdcr), velocity `X_1 - X_0`, `t ~ Beta(alpha, 1)`.
///
/// Two settings go beyond the paper. What is wrong with a cloud, points beside the surface, arises where `1 - t` is a few
/// hundredths, where the path's noise is as small as the surface's details: `late_times` draws more of the times there. And a
/// network sees the prior's tail so seldom that points that start there fly off: `prior_cut` cuts it off, in training and
/// prediction alike.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlowPath {
    /// Standard deviation of the positions' prior `sigma`, in normalised units.
    pub prior_deviation: f32,
    /// `alpha` of the flow times' Beta distribution; above 1 it favours times near the data: importance sampling of the loss
    /// over uniform times with the weight `alpha t^(alpha - 1)`.
    pub time_exponent: f32,
    /// Share of the flow times that are drawn near the data, with `1 - t` log-uniform in [`LATE_TIMES`]; the others are
    /// `Beta(alpha, 1)`. 0 in older files, which do not say.
    #[serde(default)]
    pub late_times: f32,
    /// Distance from its centre at which the positions' prior is cut, in units of `sigma`; `None`, and older files: nowhere.
    #[serde(default)]
    pub prior_cut: Option<f32>,
    /// Which sample of the prior flows to which point; independent in older files, which do not say.
    #[serde(default)]
    pub coupling: Coupling,
}

/// Range of `1 - t` for late flow times.
pub const LATE_TIMES: [f32; 2] = [0.003, 0.15];

impl Default for FlowPath {
    /// [`FlowPath::DEFAULT`].
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl FlowPath {
    /// The paper's: `sigma = 0.5`, `alpha = 3`, independent.
    pub const PAPER: Self = Self {
        prior_deviation: 0.5,
        time_exponent: 3.0,
        late_times: 0.0,
        prior_cut: None,
        coupling: Coupling::Independent,
    };

    /// The paper's with half of the times near the data and a prior without its tail, a tenth of all points.
    pub const DEFAULT: Self = Self {
        late_times: 0.5,
        prior_cut: Some(2.5),
        ..Self::PAPER
    };

    /// Returns an error for values that do not describe a path.
    pub fn check(&self) -> Result<(), FlowError> {
        let Self {
            prior_deviation,
            time_exponent,
            late_times,
            prior_cut,
            coupling,
        } = *self;
        let positive = |x: f32| x.is_finite() && x > 0.0;
        require(
            positive(prior_deviation),
            "prior_deviation",
            prior_deviation,
            "a positive length",
        )?;
        require(
            positive(time_exponent),
            "time_exponent",
            time_exponent,
            "a positive number",
        )?;
        require(
            (0.0..=1.0).contains(&late_times),
            "late_times",
            late_times,
            "a share, 0 to 1",
        )?;
        // Below one deviation, most draws would be in vain.
        if let Some(cut) = prior_cut {
            let expected = "1 or more deviations";
            require(cut.is_finite() && cut >= 1.0, "prior_cut", cut, expected)?;
        }
        coupling.check()
    }

    /// A flow time: `u^(1/alpha)` with `u` uniform in [0, 1) has the distribution `Beta(alpha, 1)`; or a late one.
    pub fn sample_time(&self, rng: &mut impl Rng) -> f32 {
        if self.late_times > 0.0 && rng.random::<f32>() < self.late_times {
            let [least, most] = LATE_TIMES.map(f32::ln);
            return 1.0 - (least + (most - least) * rng.random::<f32>()).exp();
        }
        rng.random::<f32>().powf(1.0 / self.time_exponent)
    }

    /// Fills `points`, row-major `(N, C)`, with samples of the prior, point by point.
    pub fn sample_prior(&self, rng: &mut impl Rng, channels: Channels, points: &mut [f32]) {
        for point in points.chunks_exact_mut(channels.count()) {
            let (position, color) = point.split_at_mut(DIM);
            let normal = self.sample_normal(rng);
            for (x, normal) in position.iter_mut().zip(normal) {
                *x = self.prior_deviation * normal;
            }
            color.fill_with(|| rng.random());
        }
    }

    /// A standard normal vector, of those within the cut.
    fn sample_normal(&self, rng: &mut impl Rng) -> [f32; DIM] {
        loop {
            let normal = [(); DIM].map(|()| StandardNormal.sample(rng));
            let square: f32 = normal.iter().map(|x: &f32| x * x).sum();
            if self.prior_cut.is_none_or(|cut| square <= cut * cut) {
                return normal;
            }
        }
    }

    /// Turns `points`, samples `X_0` of the prior, into `X_t`, and `targets`, data `X_1`, into the velocity `X_1 - X_0`.
    pub fn follow(&self, t: f32, points: &mut [f32], targets: &mut [f32]) {
        for (x, target) in points.iter_mut().zip(targets) {
            let (start, end) = (*x, *target);
            *x = (1.0 - t) * start + t * end;
            *target = end - start;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::{Stream, rng};

    #[test]
    fn path_starts_at_the_prior_and_ends_at_the_data() {
        let path = FlowPath::default();
        for (t, expected) in [(0.0, 2.0), (1.0, 5.0), (0.5, 3.5)] {
            let (mut x, mut target) = ([2.0], [5.0]);
            path.follow(t, &mut x, &mut target);
            assert_eq!((x, target), ([expected], [3.0]));
        }
    }

    #[test]
    fn flow_times_have_the_moments_of_beta() {
        for time_exponent in [1.0, 2.0, 3.0, 5.0] {
            let rng = &mut rng(1, Stream::Step(0));
            let path = FlowPath {
                time_exponent,
                ..FlowPath::PAPER
            };
            let (mean, square) = moments((0..100_000).map(|_| path.sample_time(rng)));
            // Beta(a, 1): E[t] = a/(a + 1), E[t^2] = a/(a + 2); standard errors at most 1e-3.
            let a = f64::from(time_exponent);
            assert!((mean - a / (a + 1.0)).abs() < 4e-3, "{mean} at {a}");
            assert!((square - a / (a + 2.0)).abs() < 4e-3, "{square} at {a}");
        }
    }

    #[test]
    fn late_times_are_log_uniform_near_the_data() {
        let path = FlowPath {
            late_times: 0.25,
            time_exponent: 1.0,
            ..FlowPath::PAPER
        };
        let rng = &mut rng(1, Stream::Step(0));
        let times: Vec<f32> = (0..100_000).map(|_| path.sample_time(rng)).collect();
        let share = |least: f32, most: f32| {
            let within = |t: &&f32| (least..most).contains(&(1.0 - **t));
            times.iter().filter(within).count() as f64 / times.len() as f64
        };
        // A quarter, half of it below the range's geometric mean, beside the uniform times; standard errors 1.5e-3.
        let [least, most] = LATE_TIMES;
        let middle = (least * most).sqrt();
        for (least, most) in [(least, middle), (middle, most)] {
            let expected = 0.25 / 2.0 + 0.75 * f64::from(most - least);
            let found = share(least, most);
            assert!((found - expected).abs() < 6e-3, "{found}, {expected}");
        }
        assert!((share(most, 1.0) - 0.75 * f64::from(1.0 - most)).abs() < 6e-3);
    }

    #[test]
    fn a_cut_prior_is_the_normal_one_within_the_cut() {
        let path = FlowPath {
            prior_cut: Some(1.5),
            ..FlowPath::PAPER
        };
        let mut points = vec![0.0; 99_999];
        path.sample_prior(&mut rng(1, Stream::Sample(0)), Channels::Xyz, &mut points);
        let (points, _) = points.as_chunks::<DIM>();
        let square = |point: &[f32; DIM]| -> f32 { point.iter().map(|x| 4.0 * x * x).sum() };
        assert!(points.iter().all(|point| square(point) <= 1.5 * 1.5));
        // Chi-squared with 3 degrees of freedom: P(r < 1) / P(r < 1.5) = 0.198748 / 0.477832.
        let near = points.iter().filter(|point| square(point) < 1.0).count();
        let share = near as f64 / points.len() as f64;
        assert!((share - 0.198748 / 0.477832).abs() < 0.011, "{share}");
    }

    #[test]
    fn prior_has_its_deviation() {
        let points = prior(Channels::Xyz);
        let (mean, square) = moments(points.iter().copied());
        assert!(mean.abs() < 8e-3 && (square - 0.25).abs() < 5e-3);
    }

    #[test]
    fn colours_start_uniform_and_positions_as_without_them() {
        let points = prior(Channels::XyzRgb);
        let part = |from: usize| {
            let points = points.chunks_exact(Channels::XyzRgb.count());
            points.flat_map(move |point| point[from..from + DIM].to_vec())
        };
        let (mean, square) = moments(part(0));
        assert!(mean.abs() < 8e-3 && (square - 0.25).abs() < 5e-3);
        // Uniform in [0, 1]: E[x] = 1/2, E[x^2] = 1/3; standard errors 1.3e-3.
        let (mean, square) = moments(part(DIM));
        assert!((mean - 0.5).abs() < 6e-3 && (square - 1.0 / 3.0).abs() < 6e-3);
        assert!(part(DIM).all(|x| (0.0..=1.0).contains(&x)));
        let differing = |k: usize| points[k] != points[k + 1];
        assert!((3..5).all(differing), "channels are independent");
    }

    fn prior(channels: Channels) -> Vec<f32> {
        let mut points = vec![0.0; 99_996];
        let rng = &mut rng(1, Stream::Sample(0));
        FlowPath::PAPER.sample_prior(rng, channels, &mut points);
        points
    }

    /// Means of the values and of their squares.
    fn moments(values: impl Iterator<Item = f32>) -> (f64, f64) {
        let values: Vec<f64> = values.map(f64::from).collect();
        let mean = |power: i32| {
            let sum: f64 = values.iter().map(|x| x.powi(power)).sum();
            sum / values.len() as f64
        };
        (mean(1), mean(2))
    }

    #[test]
    fn a_prior_without_width_is_refused() {
        let path = FlowPath {
            prior_deviation: 0.0,
            ..FlowPath::default()
        };
        let error = path.check().expect_err("no width").to_string();
        assert_eq!(error, "prior_deviation is 0, expected a positive length");
    }

    #[test]
    fn shares_and_cuts_that_are_none_are_refused() {
        for (path, expected) in [
            (
                FlowPath {
                    late_times: 1.5,
                    ..FlowPath::PAPER
                },
                "late_times is 1.5, expected a share, 0 to 1",
            ),
            (
                FlowPath {
                    prior_cut: Some(0.1),
                    ..FlowPath::PAPER
                },
                "prior_cut is 0.1, expected 1 or more deviations",
            ),
        ] {
            let error = path.check().expect_err("no path").to_string();
            assert_eq!(error, expected);
        }
    }
}
