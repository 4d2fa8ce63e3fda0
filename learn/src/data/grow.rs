//! Data sets that grow: the samples of a smaller set are kept.

use std::ops::ControlFlow;
use std::path::PathBuf;

use super::collector::{Collector, State};
use super::meta::{META_FILE, Meta};
use super::shard::{Array, Batch, Sizes};
use super::shard_file::ShardFile;
use super::{DataError, DataSet, Split};

impl Collector {
    /// Stages the samples of the smaller data set in the folder, if there is one, so that
    /// [`missing_blocks`](Self::missing_blocks) are those of the samples to come. It is left to
    /// [`finish`](Self::finish) to replace the smaller set, which can be read until then.
    ///
    /// The splits depend on the number of samples, so samples change places between them. Of a smaller simulated set the
    /// last few samples, less than a block, are to be made again. `progress` is called with the blocks done and the blocks in all,
    /// and may ask to stop. Memory is needed for one shard of each split.
    ///
    /// # Errors
    /// [`DataError`] for what is wrong with the smaller set, by file and dataset; [`DataError::Io`];
    /// [`DataError::Interrupted`] where `progress` asked for it.
    pub fn keep_samples(
        &self,
        mut progress: impl FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Result<(), DataError> {
        if !matches!(self.state, State::Collecting { grows: true, .. }) {
            return Ok(());
        }
        let set = DataSet::open(&self.dir)?;
        let smaller = Meta::load(&self.dir.join(META_FILE))?;
        let smaller = smaller.ok_or_else(|| DataError::Incomplete {
            path: self.dir.clone(),
        })?;
        let splits = smaller.splits()?;
        let meta = &self.blocks.meta;
        let mut readers = vec![];
        for split in Split::ALL {
            readers.push(SplitReader::new(set.shards(split)?.paths, meta));
        }
        let kept = self
            .blocks
            .ranges()
            .take_while(|block| block.end <= smaller.count);
        let kept: Vec<_> = kept.collect();
        for (done, block) in kept.iter().enumerate() {
            let mut batch = Batch::new(meta.sizes(0));
            for index in block.clone() {
                let (batch_of, row) = readers[splits.place_of(index)].next_row()?;
                batch.push_row(batch_of, row);
            }
            if !self.blocks.is_whole(block) {
                self.blocks.write_batch(block, &batch)?;
            }
            if progress(done + 1, kept.len()).is_break() {
                return Err(DataError::Interrupted);
            }
        }
        Ok(())
    }
}

/// Reads the samples of a split one after another, a shard at a time.
struct SplitReader {
    paths: std::vec::IntoIter<PathBuf>,
    dir: PathBuf,
    /// Sizes of a batch of no samples.
    sizes: Sizes,
    batch: Batch,
    row: usize,
}

impl SplitReader {
    fn new(paths: Vec<PathBuf>, meta: &Meta) -> Self {
        let sizes = meta.sizes(0);
        Self {
            dir: paths.first().cloned().unwrap_or_default(),
            paths: paths.into_iter(),
            sizes,
            batch: Batch::new(sizes),
            row: 0,
        }
    }

    /// The next sample: a batch, and its row there.
    fn next_row(&mut self) -> Result<(&Batch, usize), DataError> {
        while self.row == self.batch.sizes.samples {
            let path = self.paths.next().ok_or_else(|| DataError::NoShards {
                path: self.dir.clone(),
            })?;
            self.batch = ShardFile::open(&path, &Array::SHARD)?.read_batch()?;
            self.row = 0;
            let samples = self.batch.sizes.samples;
            let expected = Sizes {
                samples,
                ..self.sizes
            };
            if self.batch.sizes != expected {
                return Err(DataError::WrongShape {
                    path,
                    dataset: Array::Motors.name(),
                    expected: format!("{:?} by meta.json", Array::Motors.shape(expected)),
                    found: Array::Motors.shape(self.batch.sizes),
                });
            }
        }
        self.row += 1;
        Ok((&self.batch, self.row - 1))
    }
}
