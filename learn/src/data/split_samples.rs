//! Samples of a split that are read when they are wanted, not all at once.

use std::ops::Range;
use std::path::PathBuf;

use super::shard::Array;
use super::shard_file::ShardFile;
use super::{DataError, DataSet, Sample, Split};

/// The samples of a split, on disk.
///
/// It keeps no file open, so it can be shared by threads, and by the processes of a fork.
#[derive(Clone, Debug, PartialEq)]
pub struct SplitSamples {
    /// Each shard, with the indices of its samples.
    shards: Vec<(PathBuf, Range<usize>)>,
    points: usize,
    condition_dim: usize,
}

impl DataSet {
    /// The samples of a split, none of which is read yet.
    ///
    /// # Errors
    /// As [`read_split`](Self::read_split), of what the shards' headers tell.
    pub fn samples(&self, split: Split) -> Result<SplitSamples, DataError> {
        let found = self.shards(split)?;
        let mut end = 0;
        let shards = std::iter::zip(found.paths, found.counts).map(|(path, count)| {
            end += count;
            (path, end - count..end)
        });
        Ok(SplitSamples {
            shards: shards.collect(),
            points: found.sizes.points,
            condition_dim: found.sizes.values,
        })
    }
}

impl SplitSamples {
    /// Number of samples `B`.
    pub fn len(&self) -> usize {
        self.shards.last().map_or(0, |(_, indices)| indices.end)
    }

    /// Whether there is none, as in a data set of fewer than ten.
    pub fn is_empty(&self) -> bool {
        self.shards.is_empty()
    }

    /// Points per cloud `N`.
    pub fn points_per_cloud(&self) -> usize {
        self.points
    }

    /// Values of a condition `D`.
    pub fn condition_dim(&self) -> usize {
        self.condition_dim
    }

    /// Reads samples by their indices in the split, in metres.
    ///
    /// # Errors
    /// [`DataError::NoSample`] for indices beyond the split's; whatever is wrong with a shard, by file and dataset.
    pub fn read(&self, indices: Range<usize>) -> Result<Vec<Sample>, DataError> {
        if indices.end > self.len() {
            return Err(DataError::NoSample {
                index: indices.end - 1,
                count: self.len(),
            });
        }
        let mut samples = Vec::with_capacity(indices.len());
        for (path, held) in &self.shards {
            let wanted = indices.start.max(held.start)..indices.end.min(held.end);
            if !wanted.is_empty() {
                let rows = wanted.start - held.start..wanted.end - held.start;
                let batch = ShardFile::open(path, &Array::SHARD)?.read_rows(rows)?;
                samples.extend(batch.samples());
            }
        }
        Ok(samples)
    }
}
