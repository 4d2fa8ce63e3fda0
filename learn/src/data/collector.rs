//! Making a data set on disk, a block of samples at a time.

use std::fs::{self, File};
use std::io;
use std::ops::Range;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use tdcr_sim::files::{TEMPORARY, write_atomically};

use super::meta::{META_FILE, Meta};
use super::normalisation::NormalisationFit;
use super::shard::{Array, Batch, Sizes};
use super::shard_file::ShardFile;
use super::{DataError, Normalisation, Sample, Split};
use crate::lock::try_lock;

/// Samples in a block, the last excepted: what is made, and at worst lost, at once.
const BLOCK: usize = 8;

/// Folder of the blocks, inside the data set's.
pub(super) const STAGING: &str = ".partial";
const LOCK_FILE: &str = "lock";

/// Threads that write shards: one computes while another waits for the disk.
const SHARD_WRITERS: usize = 2;

/// A data set being made.
///
/// Samples are written as they come, in blocks of consecutive indices and in any order, to a staging folder; when
/// all are there, [`finish`](Self::finish) writes the shards. `meta.json` comes last: a folder that holds it holds a
/// complete data set. Every file appears whole or not at all, so collecting may be killed at any time; opening the
/// folder again with the same [`Meta`] takes it up where it stopped, and the files come out the same, byte for byte.
///
/// A data set grows where the [`Meta`] asks for more samples of the same kind, complete or not: see
/// [`keep_samples`](Self::keep_samples). Its files come out as if it had been of that size from the start.
///
/// The largest need of disk space, while finishing, is 42 bytes a point: 15 staged and 27 in the shards.
#[derive(Debug)]
pub struct Collector {
    pub(super) dir: PathBuf,
    pub(super) meta: Meta,
    pub(super) state: State,
}

#[derive(Debug)]
pub(super) enum State {
    Complete,
    Collecting {
        /// Keeps other collectors out.
        _lock: File,
        /// Whether the folder holds a complete, smaller set.
        grows: bool,
    },
}

impl Collector {
    /// Opens the data set `meta` in the folder `dir`, which is made if it is not there, or resumed where collecting
    /// was interrupted, or where the set was smaller.
    ///
    /// # Errors
    /// [`DataError::InvalidMeta`] and [`DataError::TooFewSamples`]; [`DataError::OtherSet`] if `dir` holds a data set
    /// with another meta, [`DataError::OtherCount`] if that set cannot grow to this one, [`DataError::ForeignFolder`] if it
    /// holds anything else; [`DataError::InUse`] while another collector has it open; [`DataError::Io`] if it cannot be
    /// written.
    pub fn open(dir: &Path, meta: &Meta) -> Result<Self, DataError> {
        meta.validate()?;
        let staging = dir.join(STAGING);
        let complete = Meta::load(&dir.join(META_FILE))?;
        let grows = match &complete {
            Some(found) => meta.grows_from(found, dir)?,
            None => false,
        };
        let state = if complete.is_some() && !grows {
            remove_leftovers(&staging, meta)?;
            State::Complete
        } else {
            match Meta::load(&staging.join(META_FILE))? {
                Some(staged) => {
                    meta.grows_from(&staged, dir)?;
                }
                None if complete.is_none() => require_fresh(dir)?,
                None => {}
            }
            fs::create_dir_all(&staging).map_err(DataError::io("create", &staging))?;
            let lock = lock(dir)?;
            // Another collector may have come to its end before it let go of the lock.
            if Meta::load(&dir.join(META_FILE))? != complete {
                drop(lock);
                return Self::open(dir, meta);
            }
            if Meta::load(&staging.join(META_FILE))?.as_ref() != Some(meta) {
                write_meta(&staging, meta)?;
            }
            State::Collecting { _lock: lock, grows }
        };
        Ok(Self {
            dir: dir.to_owned(),
            meta: meta.clone(),
            state,
        })
    }

    /// Index ranges of the blocks that are still to be made, in ascending order.
    ///
    /// A block whose file is there but truncated counts as missing.
    pub fn missing_blocks(&self) -> Vec<Range<usize>> {
        match self.state {
            State::Complete => vec![],
            State::Collecting { .. } => self
                .blocks()
                .filter(|block| !self.is_whole(block))
                .collect(),
        }
    }

    /// Stores one block: `samples` are those of index `first_index` and following. May be called from several
    /// threads at once, for different blocks. When it returns, the block is on the disk.
    ///
    /// # Errors
    /// [`DataError::NotABlock`] unless the indices are one of [`missing_blocks`](Self::missing_blocks)' ranges;
    /// [`DataError::InvalidSample`] for a sample of other sizes than the meta's, or one that is not finite;
    /// [`DataError::Complete`]; [`DataError::Io`], in which case all earlier blocks remain usable.
    pub fn write_block(&self, first_index: usize, samples: &[Sample]) -> Result<(), DataError> {
        if let State::Complete = self.state {
            return Err(DataError::Complete {
                path: self.dir.clone(),
            });
        }
        let block = first_index..first_index.saturating_add(samples.len());
        if !self.blocks().any(|known| known == block) {
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
        batch.write_block(&self.block_path(&block))
    }

    /// Completes the data set: fits the normalisation, writes the shards of each split in index order, and removes
    /// the staging folder. Nothing is to be done for a data set that is complete already.
    ///
    /// `progress` is called with the steps done and the steps in all. Memory is needed for one shard of each split, and
    /// three times for two more.
    ///
    /// # Errors
    /// [`DataError::Incomplete`] while blocks are missing; [`DataError::Io`] and what reading a damaged block brings.
    /// After an error the blocks are still there, and finishing can be tried again. A damaged block is made again once
    /// its file is removed.
    pub fn finish(self, mut progress: impl FnMut(usize, usize)) -> Result<(), DataError> {
        if let State::Complete = self.state {
            return Ok(());
        }
        if !self.missing_blocks().is_empty() {
            return Err(DataError::Incomplete { path: self.dir });
        }
        let mut done = 0;
        let steps = 2 * self.blocks().count();
        let mut step = || {
            done += 1;
            progress(done, steps);
        };
        let normalisation = self.fit_normalisation(&mut step)?;
        // From here on the files of a smaller set are replaced.
        remove_file(&self.dir.join(META_FILE))?;
        self.write_shards(&normalisation, &mut step)?;
        normalisation.save(&self.dir)?;
        write_meta(&self.dir, &self.meta)?;
        let staging = self.dir.join(STAGING);
        // Not every system removes an open file, and the lock is one.
        drop(self.state);
        remove_staging(&staging)
    }

    fn fit_normalisation(&self, step: &mut impl FnMut()) -> Result<Normalisation, DataError> {
        let mut fit = NormalisationFit::new(self.meta.condition_dim());
        for block in self.blocks() {
            let file = self.open_block(&block)?;
            fit.include(
                &file.read_floats(Array::Motors)?,
                &file.read_floats(Array::Data)?,
            );
            step();
        }
        Ok(fit.finish())
    }

    fn write_shards(
        &self,
        normalisation: &Normalisation,
        step: &mut impl FnMut(),
    ) -> Result<(), DataError> {
        // A shard is written while the next is gathered. Nobody waits in the channel: that would take more memory.
        let (full, shards) = sync_channel(0);
        let shards = Mutex::new(shards);
        std::thread::scope(|scope| {
            let writers: [_; SHARD_WRITERS] =
                std::array::from_fn(|_| scope.spawn(|| write_shards_of(&shards, normalisation)));
            let gathered = self.gather_shards(full, step);
            // A writer that failed is why the gathering did, if both did.
            for writer in writers {
                writer.join().unwrap_or_else(|panic| resume_unwind(panic))?;
            }
            gathered
        })
    }

    /// Hands the samples over as full shards, each split in index order. Ends early when nobody takes them.
    fn gather_shards(
        &self,
        full: SyncSender<(PathBuf, Batch)>,
        step: &mut impl FnMut(),
    ) -> Result<(), DataError> {
        let splits = self.meta.splits()?;
        let mut gatherers = vec![];
        for split in Split::ALL {
            let dir = self.dir.join(split.folder());
            gatherers.push(SplitGatherer::create(&dir, &self.meta, full.clone())?);
        }
        for block in self.blocks() {
            let batch = self.open_block(&block)?.read_batch()?;
            for (row, index) in block.enumerate() {
                gatherers[splits.place_of(index)].push_row(&batch, row);
            }
            step();
        }
        gatherers.iter_mut().for_each(SplitGatherer::flush);
        Ok(())
    }

    /// Index ranges of all blocks.
    pub(super) fn blocks(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let count = self.meta.count;
        (0..count)
            .step_by(BLOCK)
            .map(move |first| first..count.min(first + BLOCK))
    }

    pub(super) fn block_path(&self, block: &Range<usize>) -> PathBuf {
        self.dir
            .join(STAGING)
            .join(format!("block-{:08}.h5", block.start))
    }

    fn open_block(&self, block: &Range<usize>) -> Result<ShardFile, DataError> {
        ShardFile::open(&self.block_path(block), &Array::BLOCK)
    }

    pub(super) fn is_whole(&self, block: &Range<usize>) -> bool {
        // What the last value of a condition is, only shards say.
        let sizes = Sizes {
            payload: false,
            ..self.meta.sizes(block.len())
        };
        self.open_block(block)
            .is_ok_and(|file| file.sizes() == sizes)
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

/// Refuses a folder that holds anything, except what an interrupted [`Collector::open`] leaves.
fn require_fresh(dir: &Path) -> Result<(), DataError> {
    let leftovers = [LOCK_FILE.to_owned(), format!("{META_FILE}.{TEMPORARY}")];
    let foreign = match foreign_entry(dir, &[STAGING.to_owned()])? {
        None => foreign_entry(&dir.join(STAGING), &leftovers)?,
        foreign => foreign,
    };
    match foreign {
        None => Ok(()),
        Some(found) => Err(DataError::ForeignFolder {
            path: dir.to_owned(),
            found,
        }),
    }
}

/// Name of the first entry of `dir`, in name order, that is not `known`; none where there is no such folder.
pub(super) fn foreign_entry(dir: &Path, known: &[String]) -> Result<Option<String>, DataError> {
    let entries = match fs::read_dir(dir) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        entries => entries.map_err(DataError::io("list", dir))?,
    };
    let mut foreign = vec![];
    for entry in entries {
        let name = entry.map_err(DataError::io("list", dir))?.file_name();
        foreign.push(name.to_string_lossy().into_owned());
    }
    foreign.retain(|name| !known.contains(name));
    Ok(foreign.into_iter().min())
}

/// Keeps other collectors out of `dir` for as long as the file is open.
fn lock(dir: &Path) -> Result<File, DataError> {
    let path = dir.join(STAGING).join(LOCK_FILE);
    let file = try_lock(&path).map_err(DataError::io("create", &path))?;
    file.ok_or_else(|| DataError::InUse {
        path: dir.to_owned(),
    })
}

fn write_meta(dir: &Path, meta: &Meta) -> Result<(), DataError> {
    let path = dir.join(META_FILE);
    write_atomically(&path, |file| io::Write::write_all(file, &meta.to_json()))
        .map_err(DataError::io("write", &path))
}

/// Removes the staging folder of the complete set `meta`, unless that is to grow there.
fn remove_leftovers(staging: &Path, meta: &Meta) -> Result<(), DataError> {
    match Meta::load(&staging.join(META_FILE)) {
        Ok(Some(staged)) if staged != *meta => Ok(()),
        _ => remove_staging(staging),
    }
}

fn remove_file(path: &Path) -> Result<(), DataError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(DataError::io("remove", path)(error))
        }
        _ => Ok(()),
    }
}

pub(super) fn remove_staging(staging: &Path) -> Result<(), DataError> {
    match fs::remove_dir_all(staging) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(DataError::io("remove", staging)(error))
        }
        _ => Ok(()),
    }
}
