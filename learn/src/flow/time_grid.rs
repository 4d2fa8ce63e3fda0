//! Time grids of an integration.

use serde::{Deserialize, Serialize};

use super::error::{FlowError, require};

/// Time grid of an integration over [0, 1].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum TimeGrid {
    /// Equal steps, `t_k = k/n` (paper, Alg. tdcr-sampling).
    Uniform,
    /// `t_k = 1 - (1 - k/n)^p`: for `p > 1` denser towards the data, where the learned field bends most.
    Power(f32),
    /// Adaptive steps with this local error tolerance (root mean square over all components, normalised units), estimated
    /// from the change of what the method extrapolates. The sampler's number of steps is the most that are taken.
    Adaptive(f32),
}

impl TimeGrid {
    /// The `steps + 1` times of a grid of `steps` steps, from 0 to 1; `None` if the grid is adaptive.
    pub fn times(self, steps: usize) -> Option<Vec<f32>> {
        let exponent = match self {
            Self::Uniform => 1.0,
            Self::Power(exponent) => f64::from(exponent),
            Self::Adaptive(_) => return None,
        };
        let time = |k| (1.0 - (1.0 - k as f64 / steps as f64).powf(exponent)) as f32;
        Some((0..=steps).map(time).collect())
    }

    /// Returns an error for values that do not describe a grid.
    pub(super) fn check(self) -> Result<(), FlowError> {
        let number = |field, found: f32, accepted: [f32; 2], expected| {
            let [low, high] = accepted;
            require((low..=high).contains(&found), field, found, expected)
        };
        match self {
            Self::Uniform => Ok(()),
            Self::Power(p) => number("sampler grid power", p, [1.0, 10.0], "1 to 10"),
            Self::Adaptive(tolerance) => {
                number("sampler tolerance", tolerance, [1e-6, 1.0], "1e-6 to 1")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_run_from_zero_to_one() {
        for grid in [
            TimeGrid::Uniform,
            TimeGrid::Power(2.0),
            TimeGrid::Power(3.0),
        ] {
            let times = grid.times(4).expect("a fixed grid");
            assert_eq!((times.len(), times[0], times[4]), (5, 0.0, 1.0));
            assert!(times.is_sorted());
        }
        assert_eq!(
            TimeGrid::Power(2.0).times(4).map(|times| times[1]),
            Some(0.4375)
        );
    }
}
