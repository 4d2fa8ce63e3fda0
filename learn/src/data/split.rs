//! Which samples train, validate and test.

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::DataError;
use super::sample_count::{MAX_SAMPLES, MIN_SAMPLES};

/// Shares of [`Split::ALL`], in tenths.
const TENTHS: [usize; 3] = [8, 1, 1];

/// A part of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Split {
    /// Fits the network's weights (80 %).
    Train,
    /// Chooses among networks (10 %).
    Val,
    /// Seen once, for the figures that are reported (10 %).
    Test,
}

impl Split {
    /// All splits, in the order of their declaration.
    pub const ALL: [Self; 3] = [Self::Train, Self::Val, Self::Test];

    /// Name of the split's folder in a data set.
    pub fn folder(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::Test => "test",
        }
    }
}

/// Sample indices of each split, each ascending; together they hold `0..count` once.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitIndices {
    /// Indices of [`Split::Train`].
    pub train: Vec<usize>,
    /// Indices of [`Split::Val`].
    pub val: Vec<usize>,
    /// Indices of [`Split::Test`].
    pub test: Vec<usize>,
}

impl SplitIndices {
    /// Indices of one split.
    pub fn of(&self, split: Split) -> &[usize] {
        match split {
            Split::Train => &self.train,
            Split::Val => &self.val,
            Split::Test => &self.test,
        }
    }

    /// The split of `count` samples that go through the commands of this one, `cycle` of them, over and over.
    pub fn repeated(&self, count: usize, cycle: usize) -> Self {
        let of = |split: Split| {
            let rounds = (0..count).step_by(cycle.max(1));
            let all =
                rounds.flat_map(|first| self.of(split).iter().map(move |index| first + index));
            all.filter(|&index| index < count).collect()
        };
        Self {
            train: of(Split::Train),
            val: of(Split::Val),
            test: of(Split::Test),
        }
    }

    /// Says what is wrong with the split of `count` samples, if anything.
    pub(super) fn fault(&self, count: usize) -> Option<String> {
        let mut seen = vec![false; count];
        for split in Split::ALL {
            let indices = self.of(split);
            if indices.is_empty() {
                return Some(format!("without a sample in {}", split.folder()));
            }
            if !indices.is_sorted() {
                return Some(format!("not ascending in {}", split.folder()));
            }
            for &index in indices {
                match seen.get_mut(index) {
                    Some(seen) if !*seen => *seen = true,
                    Some(_) => return Some(format!("with sample {index} twice")),
                    None => return Some(format!("with sample {index} of {count}")),
                }
            }
        }
        let missing = seen.iter().position(|seen| !seen)?;
        Some(format!("without sample {missing}"))
    }

    /// Place in [`Split::ALL`] of the split that sample `index` is in.
    ///
    /// # Panics
    /// If it is in none.
    pub(super) fn place_of(&self, index: usize) -> usize {
        let place = Split::ALL
            .iter()
            .position(|&split| self.of(split).binary_search(&index).is_ok());
        place.expect("every sample is in a split")
    }
}

/// Assigns samples `0..count` to the splits by a random permutation that depends on `seed` alone.
///
/// Sizes are 80/10/10 % rounded by largest remainder (ties to the earlier split), which no integers come closer to. Of fewer than
/// 10 samples one tests and one validates, as long as one is left to train: of two, none validates.
///
/// # Errors
/// [`DataError::TooFewSamples`] for none; [`DataError::TooManySamples`] above 10,000,000.
pub fn split_indices(count: usize, seed: u64) -> Result<SplitIndices, DataError> {
    require_count(count, 1)?;
    let mut indices: Vec<usize> = (0..count).collect();
    indices.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let [train_size, val_size, _] = split_sizes(count);
    let mut test = indices.split_off(train_size + val_size);
    let mut val = indices.split_off(train_size);
    let mut train = indices;
    for split in [&mut train, &mut val, &mut test] {
        split.sort_unstable();
    }
    Ok(SplitIndices { train, val, test })
}

/// Refuses numbers of samples that cannot be split, and fewer than `fewest`.
pub(super) fn require_count(count: usize, fewest: usize) -> Result<(), DataError> {
    match count {
        _ if count < fewest => Err(DataError::TooFewSamples {
            found: count,
            fewest,
        }),
        ..=MAX_SAMPLES => Ok(()),
        _ => Err(DataError::TooManySamples { found: count }),
    }
}

/// Number of samples of a split of `count` samples, which [`require_count`] accepts.
pub(super) fn split_size(count: usize, split: Split) -> usize {
    split_sizes(count)[split as usize]
}

/// Largest-remainder rounding of `count * TENTHS / 10`; of few samples one each, as far as they go.
fn split_sizes(count: usize) -> [usize; 3] {
    if count < MIN_SAMPLES {
        let test = usize::from(count > 1);
        let val = usize::from(count > 2);
        return [count - val - test, val, test];
    }
    let (tens, ones) = (count / 10, count % 10);
    let mut sizes = TENTHS.map(|share| share * tens + share * ones / 10);
    let mut by_remainder = [0, 1, 2];
    by_remainder.sort_by_key(|&k| std::cmp::Reverse(TENTHS[k] * ones % 10));
    let left_over = count - sizes.iter().sum::<usize>();
    for &k in &by_remainder[..left_over] {
        sizes[k] += 1;
    }
    sizes
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn every_sample_is_in_exactly_one_split(count in 10_usize..3000, seed: u64) {
            let splits = split_indices(count, seed).unwrap();
            let mut all: Vec<usize> = Split::ALL.iter().flat_map(|&split| splits.of(split).to_vec()).collect();
            all.sort_unstable();
            prop_assert_eq!(all, (0..count).collect::<Vec<_>>());
            for split in Split::ALL {
                prop_assert!(!splits.of(split).is_empty());
                prop_assert!(splits.of(split).is_sorted());
                prop_assert_eq!(splits.of(split).len(), split_size(count, split));
            }
            prop_assert_eq!(split_indices(count, seed).unwrap(), splits);
        }
    }

    #[test]
    fn no_integers_are_nearer_to_80_10_10() {
        let error = |count: usize, sizes: [usize; 3]| -> usize {
            std::iter::zip(sizes, TENTHS)
                .map(|(size, share)| (10 * size).abs_diff(share * count))
                .sum()
        };
        for count in 10..120 {
            let sizes = split_sizes(count);
            for train in 0..=count {
                for val in 0..=count - train {
                    assert!(
                        error(count, sizes) <= error(count, [train, val, count - train - val]),
                        "{count}: {sizes:?}"
                    );
                }
            }
        }
        assert_eq!(split_sizes(5000), [4000, 500, 500]);
    }

    #[test]
    fn the_seed_chooses_the_split() {
        assert_ne!(
            split_indices(100, 1).unwrap(),
            split_indices(100, 2).unwrap()
        );
    }

    #[test]
    fn more_samples_than_memory_holds_are_refused() {
        for count in [MAX_SAMPLES + 1, 1_000_000_000_000, usize::MAX] {
            assert!(matches!(
                split_indices(count, 0),
                Err(DataError::TooManySamples { found }) if found == count
            ));
        }
    }

    #[test]
    fn few_samples_are_split_as_far_as_they_go() {
        let sizes = [[1, 0, 0], [1, 0, 1], [1, 1, 1], [2, 1, 1]];
        for (count, sizes) in (1..).zip(sizes) {
            assert_eq!(split_sizes(count), sizes);
        }
        assert_eq!(split_sizes(9), [7, 1, 1]);
        let splits = split_indices(2, 3).unwrap();
        assert_eq!(
            [splits.train.len(), splits.val.len(), splits.test.len()],
            [1, 0, 1]
        );
        assert!(matches!(
            split_indices(0, 0),
            Err(DataError::TooFewSamples {
                found: 0,
                fewest: 1
            })
        ));
        assert!(require_count(9, MIN_SAMPLES).is_err());
    }
}
