//! How samples of the prior are coupled to the points of a cloud.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::error::{FlowError, require};
use crate::channels::{Channels, DIM};
use crate::metrics::Matcher;

/// Largest group that is matched: the work grows with its cube.
const MAX_BATCH: usize = 256;

/// Which sample of the prior flows to which point of a cloud. Prior and data are the same under any coupling.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub enum Coupling {
    /// At random (the paper's).
    #[default]
    Independent,
    /// Minibatch optimal transport (Pooladian et al. 2023, Tong et al. 2024): within groups of at most `batch` points, the
    /// one-to-one assignment of least mean squared distance between positions. A group belongs to one cloud, as its points
    /// have one condition. Paths cross less, so the velocity at a place varies less.
    OptimalTransport {
        /// Points in a group.
        batch: usize,
    },
}

impl Coupling {
    /// Optimal transport within groups of 32.
    pub const OPTIMAL_TRANSPORT: Self = Self::OptimalTransport { batch: 32 };

    /// Returns an error for groups that are too small to match, or too large.
    pub fn check(self) -> Result<(), FlowError> {
        match self {
            Self::Independent => Ok(()),
            Self::OptimalTransport { batch } => require(
                (2..=MAX_BATCH).contains(&batch),
                "the coupling's batch",
                batch,
                "2 to 256",
            ),
        }
    }

    /// Reorders `prior`, independent samples `(N, C)`, so that each flows to the same row of `data` `(N, C)`.
    pub(crate) fn couple(
        self,
        channels: Channels,
        prior: &mut [f32],
        data: &[f32],
        matcher: &mut Matcher,
    ) {
        let Self::OptimalTransport { batch } = self else {
            return;
        };
        let row = channels.count();
        let groups = prior.chunks_mut(batch * row);
        for (prior, data) in groups.zip(data.chunks(batch * row)) {
            let square = |from: usize, to: usize| -> f64 {
                let (x, y) = (&prior[from * row..][..DIM], &data[to * row..][..DIM]);
                let axes = x.iter().zip(y);
                axes.map(|(x, y)| f64::from(x - y).powi(2)).sum()
            };
            matcher.solve(prior.len() / row, square);
            matcher.reorder(row, prior);
        }
    }
}

/// As it is read.
impl fmt::Display for Coupling {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Independent => out.write_str("independent"),
            Self::OptimalTransport { batch } => write!(out, "optimal-transport:{batch}"),
        }
    }
}

/// Reads `independent`, `optimal-transport` or `optimal-transport:K`.
impl FromStr for Coupling {
    type Err = FlowError;

    fn from_str(text: &str) -> Result<Self, FlowError> {
        let coupling = match text.split_once(':') {
            None if text == "independent" => Some(Self::Independent),
            None if text == "optimal-transport" => Some(Self::OPTIMAL_TRANSPORT),
            Some(("optimal-transport", batch)) => {
                let batch = batch.parse().ok();
                batch.map(|batch| Self::OptimalTransport { batch })
            }
            _ => None,
        };
        let coupling = coupling.ok_or_else(|| FlowError {
            field: "the coupling",
            found: format!("`{text}`"),
            expected: "independent, optimal-transport or optimal-transport:K",
        })?;
        coupling.check()?;
        Ok(coupling)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::{FlowPath, Stream, rng};
    use crate::metrics::emd_squared;
    use proptest::prelude::*;

    #[test]
    fn a_coupling_is_read_as_it_is_written() {
        for coupling in [Coupling::Independent, Coupling::OPTIMAL_TRANSPORT] {
            assert_eq!(coupling.to_string().parse(), Ok(coupling));
        }
    }

    /// Samples of the prior, and points of a slanted disc: some of them twice, as padded clouds have them.
    fn prior_and_data(points: usize, channels: Channels, seed: u64) -> [Vec<f32>; 2] {
        let rng = &mut rng(seed, Stream::Sample(0));
        let mut prior = vec![0.0; points * channels.count()];
        FlowPath::default().sample_prior(rng, channels, &mut prior);
        let mut data = prior.clone();
        FlowPath::default().sample_prior(rng, channels, &mut data);
        let (repeated, row) = (points / 3, channels.count());
        data.copy_within(0..repeated * row, (points - repeated) * row);
        for point in data.chunks_exact_mut(row) {
            point[2] = 0.3 * point[0];
        }
        [prior, data]
    }

    fn positions(rows: &[f32], channels: Channels) -> Vec<[f32; 3]> {
        let rows = rows.chunks_exact(channels.count());
        rows.map(|row| [row[0], row[1], row[2]]).collect()
    }

    fn mean_square(from: &[[f32; 3]], to: &[[f32; 3]]) -> f64 {
        let square = |(x, y): (&[f32; 3], &[f32; 3])| -> f64 {
            let difference = |k: usize| f64::from(x[k]) - f64::from(y[k]);
            (0..3).map(|k| difference(k).powi(2)).sum()
        };
        from.iter().zip(to).map(square).sum::<f64>() / from.len() as f64
    }

    fn sorted_rows(rows: &[f32], channels: Channels) -> Vec<Vec<u32>> {
        let rows = rows.chunks_exact(channels.count());
        let mut rows: Vec<Vec<u32>> = rows
            .map(|row| row.iter().map(|x| x.to_bits()).collect())
            .collect();
        rows.sort();
        rows
    }

    proptest! {
        #[test]
        fn coupled_groups_have_the_least_mean_squared_distance_and_the_same_prior(
            points in 1..90usize,
            batch in 2..70usize,
            colored in any::<bool>(),
            seed in any::<u64>(),
        ) {
            let channels = if colored { Channels::XyzRgb } else { Channels::Xyz };
            let [prior, data] = prior_and_data(points, channels, seed);
            let (mut coupled, mut matcher) = (prior.clone(), Matcher::default());
            // A matcher's second use is as its first.
            for _ in 0..2 {
                coupled.copy_from_slice(&prior);
                let coupling = Coupling::OptimalTransport { batch };
                coupling.couple(channels, &mut coupled, &data, &mut matcher);
            }
            let group = batch * channels.count();
            let groups = prior.chunks(group).zip(coupled.chunks(group)).zip(data.chunks(group));
            for ((prior, coupled), data) in groups {
                prop_assert_eq!(sorted_rows(prior, channels), sorted_rows(coupled, channels));
                let [prior, coupled, data] = [prior, coupled, data].map(|rows| positions(rows, channels));
                let least = emd_squared(&prior, &data).expect("clouds of equal size").value;
                let reached = mean_square(&coupled, &data);
                // Costs are squares of f32 differences.
                prop_assert!((reached - least).abs() <= 1e-6 * least, "{reached} is not {least}");
            }
        }
    }

    #[test]
    fn an_independent_coupling_leaves_the_noise_where_it_is() {
        let [prior, data] = prior_and_data(20, Channels::Xyz, 1);
        let mut coupled = prior.clone();
        Coupling::default().couple(Channels::Xyz, &mut coupled, &data, &mut Matcher::default());
        assert_eq!(coupled, prior);
    }

    #[test]
    fn groups_too_small_or_too_large_are_refused() {
        for batch in [0, 1, 257] {
            let error = Coupling::OptimalTransport { batch }.check();
            let expected = format!("the coupling's batch is {batch}, expected 2 to 256");
            assert_eq!(error.expect_err("no group").to_string(), expected);
        }
        assert_eq!(Coupling::OPTIMAL_TRANSPORT.check(), Ok(()));
    }
}
