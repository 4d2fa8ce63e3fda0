//! Samples as they come: files of a few consecutive ones, in a folder.

use std::ops::Range;
use std::path::PathBuf;

use super::meta::Meta;
use super::shard::{Array, Batch, Sizes};
use super::shard_file::ShardFile;
use super::{DataError, Sample};

/// Consecutive samples of a data set, in files of at most [`Origin::block`](super::Origin::block).
#[derive(Clone, Debug)]
pub(super) struct Blocks {
    /// Folder of the files.
    pub(super) dir: PathBuf,
    /// What the data set is made with.
    pub(super) meta: Meta,
    /// Which of its samples.
    samples: Range<usize>,
}

impl Blocks {
    pub(super) fn new(dir: PathBuf, meta: Meta, samples: Range<usize>) -> Self {
        Self { dir, meta, samples }
    }

    /// Number of samples.
    pub(super) fn len(&self) -> usize {
        self.samples.len()
    }

    /// Index ranges of all blocks, ascending.
    pub(super) fn ranges(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let (Range { start, end }, block) = (self.samples.clone(), self.meta.origin.block());
        (start..end)
            .step_by(block)
            .map(move |first| first..end.min(first + block))
    }

    /// Index ranges of the blocks without a file, or with a truncated one.
    pub(super) fn missing(&self) -> Vec<Range<usize>> {
        self.ranges()
            .filter(|block| !self.is_whole(block))
            .collect()
    }

    /// Whether the file of a block is there, and as long as it says.
    pub(super) fn is_whole(&self, block: &Range<usize>) -> bool {
        // What the last value of a condition is, only shards say.
        let sizes = Sizes {
            payload: false,
            ..self.meta.sizes(block.len())
        };
        self.open(block).is_ok_and(|file| file.sizes() == sizes)
    }

    /// Opens the file of a block.
    pub(super) fn open(&self, block: &Range<usize>) -> Result<ShardFile, DataError> {
        ShardFile::open(&self.path(block), &Array::BLOCK)
    }

    /// Writes samples of index `first_index` and following, which form a block.
    pub(super) fn write(&self, first_index: usize, samples: &[Sample]) -> Result<(), DataError> {
        let block = first_index..first_index.saturating_add(samples.len());
        if !self.ranges().any(|known| known == block) {
            return Err(DataError::NotABlock {
                first: block.start,
                end: block.end,
            });
        }
        let mut batch = Batch::new(self.meta.sizes(block.len()));
        for (index, sample) in block.clone().zip(samples) {
            self.check(sample)
                .map_err(|problem| DataError::InvalidSample { index, problem })?;
            batch.push(sample);
        }
        self.write_batch(&block, &batch)
    }

    /// Writes the samples of a block.
    pub(super) fn write_batch(&self, block: &Range<usize>, batch: &Batch) -> Result<(), DataError> {
        batch.write_block(&self.path(block))
    }

    fn path(&self, block: &Range<usize>) -> PathBuf {
        self.dir.join(format!("block-{:08}.h5", block.start))
    }

    /// Says what is wrong with a sample.
    fn check(&self, sample: &Sample) -> Result<(), String> {
        let Meta {
            motors,
            points_per_cloud,
            ..
        } = self.meta;
        let Sample { condition, cloud } = sample;
        let command = &condition.motors;
        if command.len() != motors {
            return Err(format!("{} motors, expected {motors}", command.len()));
        }
        if condition.payload.is_some() != self.meta.has_payload() {
            let [found, expected] = [condition.payload.is_some(), self.meta.has_payload()]
                .map(|payload| if payload { "a payload" } else { "no payload" });
            return Err(format!("{found}, expected {expected}"));
        }
        if [cloud.points.len(), cloud.colors.len()] != [points_per_cloud; 2] {
            let (points, colors) = (cloud.points.len(), cloud.colors.len());
            return Err(format!(
                "{points} points and {colors} colours, expected {points_per_cloud} of each"
            ));
        }
        match condition
            .values()
            .chain(cloud.points.as_flattened().iter().copied())
            .find(|value| !value.is_finite())
        {
            Some(value) => Err(format!("it holds {value}, expected finite numbers")),
            None => Ok(()),
        }
    }
}
