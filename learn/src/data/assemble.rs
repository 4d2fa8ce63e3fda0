//! From blocks to a complete data set.

use std::fs;
use std::ops::ControlFlow;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::blocks::Blocks;
use super::folder::remove_file;
use super::meta::{META_FILE, Meta};
use super::normalisation::NormalisationFit;
use super::shard::{Array, Batch};
use super::{DataError, Normalisation, Split};

/// Threads that write shards: one computes while another waits for the disk.
const SHARD_WRITERS: usize = 2;

/// Makes the data set `meta` in the folder `dir`: fits the normalisation, and writes the shards of each split in index
/// order. `sources` hold all samples, in index order. `meta.json` comes last; that of a smaller set in the folder goes first.
///
/// `progress` is called with the steps done and the steps in all.
pub(super) fn assemble(
    dir: &Path,
    meta: &Meta,
    sources: &[Blocks],
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<(), DataError> {
    let mut done = 0;
    let steps = 2 * sources
        .iter()
        .map(|source| source.ranges().count())
        .sum::<usize>();
    let mut step = || {
        done += 1;
        match progress(done, steps) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(DataError::Interrupted),
        }
    };
    let normalisation = fit_normalisation(meta, sources, &mut step)?;
    remove_file(&dir.join(META_FILE))?;
    write_shards(dir, meta, sources, &normalisation, &mut step)?;
    normalisation.save(dir)?;
    meta.save(dir)
}

fn fit_normalisation(
    meta: &Meta,
    sources: &[Blocks],
    step: &mut dyn FnMut() -> Result<(), DataError>,
) -> Result<Normalisation, DataError> {
    let mut fit = NormalisationFit::new(meta.condition_dim());
    for blocks in sources {
        for block in blocks.ranges() {
            let file = blocks.open(&block)?;
            fit.include(
                &file.read_floats(Array::Motors)?,
                &file.read_floats(Array::Data)?,
            );
            step()?;
        }
    }
    Ok(fit.finish())
}

fn write_shards(
    dir: &Path,
    meta: &Meta,
    sources: &[Blocks],
    normalisation: &Normalisation,
    step: &mut dyn FnMut() -> Result<(), DataError>,
) -> Result<(), DataError> {
    // A shard is written while the next is gathered. Nobody waits in the channel: that would take more memory.
    let (full, shards) = sync_channel(0);
    let shards = Mutex::new(shards);
    std::thread::scope(|scope| {
        let writers: [_; SHARD_WRITERS] =
            std::array::from_fn(|_| scope.spawn(|| write_shards_of(&shards, normalisation)));
        let gathered = gather_shards(dir, meta, sources, full, step);
        // A writer that failed is why the gathering did, if both did.
        for writer in writers {
            writer.join().unwrap_or_else(|panic| resume_unwind(panic))?;
        }
        gathered
    })
}

/// Hands the samples over as full shards, each split in index order. Ends early when nobody takes them.
fn gather_shards(
    dir: &Path,
    meta: &Meta,
    sources: &[Blocks],
    full: SyncSender<(PathBuf, Batch)>,
    step: &mut dyn FnMut() -> Result<(), DataError>,
) -> Result<(), DataError> {
    let splits = meta.splits()?;
    let mut gatherers = vec![];
    for split in Split::ALL {
        let dir = dir.join(split.folder());
        gatherers.push(SplitGatherer::create(&dir, meta, full.clone())?);
    }
    for blocks in sources {
        for block in blocks.ranges() {
            let batch = blocks.open(&block)?.read_batch()?;
            for (row, index) in block.enumerate() {
                gatherers[splits.place_of(index)].push_row(&batch, row);
            }
            step()?;
        }
    }
    gatherers.iter_mut().for_each(SplitGatherer::flush);
    Ok(())
}

/// Writes shards as they come, until no more are to come.
fn write_shards_of(
    shards: &Mutex<Receiver<(PathBuf, Batch)>>,
    normalisation: &Normalisation,
) -> Result<(), DataError> {
    loop {
        // One writer at a time waits for a shard; the lock is free again while it is written.
        let shard = match shards.lock() {
            Ok(shards) => shards.recv(),
            Err(_) => return Ok(()),
        };
        match shard {
            Ok((path, batch)) => batch.write_shard(&path, normalisation)?,
            Err(_) => return Ok(()),
        }
    }
}

/// Gathers the samples of one split into shards.
struct SplitGatherer {
    dir: PathBuf,
    shards: usize,
    pending: Batch,
    samples_per_shard: usize,
    full: SyncSender<(PathBuf, Batch)>,
}

impl SplitGatherer {
    fn create(
        dir: &Path,
        meta: &Meta,
        full: SyncSender<(PathBuf, Batch)>,
    ) -> Result<Self, DataError> {
        fs::create_dir_all(dir).map_err(DataError::io("create", dir))?;
        Ok(Self {
            dir: dir.to_owned(),
            shards: 0,
            pending: Batch::new(meta.sizes(0)),
            samples_per_shard: meta.samples_per_shard,
            full,
        })
    }

    fn push_row(&mut self, batch: &Batch, row: usize) {
        self.pending.push_row(batch, row);
        if self.pending.sizes.samples == self.samples_per_shard {
            self.flush();
        }
    }

    /// Hands over the pending samples, if any, as the next shard.
    fn flush(&mut self) {
        if self.pending.sizes.samples > 0 {
            let path = self.dir.join(format!("shard-{:05}.h5", self.shards));
            let empty = Batch::new(self.pending.sizes);
            let shard = std::mem::replace(&mut self.pending, empty);
            self.shards += 1;
            // It is refused when every writer has failed, and then they say so.
            let _ = self.full.send((path, shard));
        }
    }
}
