//! Making a data set on disk, a block of samples at a time.

use std::fs::{self, File};
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};

use tdcr_base::Part;
use tdcr_base::files::TEMPORARY;
use tdcr_base::lock::try_lock;

use super::assemble::assemble;
use super::blocks::Blocks;
use super::folder::{STAGING, foreign_entry, remove_folder};
use super::meta::{META_FILE, Meta};
use super::part::PartFolder;
use super::{DataError, Sample};

const LOCK_FILE: &str = "lock";

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
/// Parts of a data set are collected apart ([`open_part`](Self::open_part)), on as many machines as one likes, and put
/// together by [`merge`](super::merge()).
///
/// The largest need of disk space, while finishing, is 42 bytes a point: 15 staged and 27 in the shards.
#[derive(Debug)]
pub struct Collector {
    pub(super) dir: PathBuf,
    pub(super) blocks: Blocks,
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
    /// A part, whose blocks stay.
    Part {
        /// Keeps other collectors out.
        _lock: File,
    },
}

impl Collector {
    /// Opens the data set `meta` in the folder `dir`, which is made if it is not there, or resumed where collecting
    /// was interrupted, or where the set was smaller. One that was given up before it had a sample is begun anew, whatever its meta.
    ///
    /// # Errors
    /// [`DataError::InvalidMeta`] and [`DataError::TooFewSamples`]; [`DataError::OtherSet`] if `dir` holds a data set
    /// with another meta, [`DataError::OtherCount`] if that set cannot grow to this one, [`DataError::OtherPart`] if it
    /// holds a part of one, [`DataError::ForeignFolder`] if it holds anything else; [`DataError::InUse`] while another
    /// collector has it open; [`DataError::Io`] if it cannot be written.
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
                    if let Err(other) = meta.grows_from(&staged, dir)
                        && is_begun(&staging)?
                    {
                        return Err(other);
                    }
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
                meta.save(&staging)?;
            }
            State::Collecting { _lock: lock, grows }
        };
        Ok(Self {
            dir: dir.to_owned(),
            blocks: Blocks::new(staging, meta.clone(), 0..meta.count),
            state,
        })
    }

    /// Opens the folder `dir` of a part of the data set `meta`, which is made if it is not there, or resumed where
    /// collecting was interrupted. [`finish`](Self::finish) leaves its samples for [`merge`](super::merge()).
    ///
    /// # Errors
    /// [`DataError::InvalidMeta`] and [`DataError::TooFewSamples`]; [`DataError::OtherPart`] if `dir` holds another part or
    /// a whole data set, [`DataError::OtherSet`] or [`DataError::OtherCount`] if the part is of another data set,
    /// [`DataError::ForeignFolder`] if it holds anything else; [`DataError::InUse`] while another collector has it open;
    /// [`DataError::Io`] if it cannot be written.
    pub fn open_part(dir: &Path, meta: &Meta, part: Part) -> Result<Self, DataError> {
        meta.validate()?;
        let (folder, lock) = PartFolder::open(dir, meta, part)?;
        Ok(Self {
            dir: folder.dir,
            blocks: folder.blocks,
            state: State::Part { _lock: lock },
        })
    }

    /// Index ranges of the blocks that are still to be made, in ascending order.
    ///
    /// A block whose file is there but truncated counts as missing.
    pub fn missing_blocks(&self) -> Vec<Range<usize>> {
        match self.state {
            State::Complete => vec![],
            State::Collecting { .. } | State::Part { .. } => self.blocks.missing(),
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
        match self.state {
            State::Complete => Err(DataError::Complete {
                path: self.dir.clone(),
            }),
            State::Collecting { .. } | State::Part { .. } => {
                self.blocks.write(first_index, samples)
            }
        }
    }

    /// Completes the data set: fits the normalisation, writes the shards of each split in index order, and removes
    /// the staging folder. Nothing is to be done for a data set that is complete already, nor for a part.
    ///
    /// `progress` is called with the steps done and the steps in all, and may ask to stop. Memory is needed for one shard of
    /// each split, and three times for two more.
    ///
    /// # Errors
    /// [`DataError::Incomplete`] while blocks are missing; [`DataError::Interrupted`] where `progress` asked for it;
    /// [`DataError::Io`] and what reading a damaged block brings. After an error the blocks are still there, and finishing
    /// can be tried again. A damaged block is made again once its file is removed.
    pub fn finish(
        self,
        mut progress: impl FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Result<(), DataError> {
        if !self.missing_blocks().is_empty() {
            return Err(DataError::Incomplete { path: self.dir });
        }
        let blocks = self.blocks.clone();
        self.finish_of(&[blocks], &mut progress)
    }

    /// Gives up what is being made. Where no sample is stored, what was put into the folder is removed, and the folder itself where
    /// nothing is left in it; else all stays to be resumed.
    ///
    /// # Errors
    /// [`DataError::Io`] where it cannot be removed.
    pub fn abandon(self) -> Result<(), DataError> {
        let staging = &self.blocks.dir;
        let (lock, is_part) = match self.state {
            State::Complete => return Ok(()),
            State::Collecting { _lock: lock, .. } => (lock, false),
            State::Part { _lock: lock } => (lock, true),
        };
        if holds_blocks(staging)? {
            return Ok(());
        }
        // Not every system removes an open file, and the lock is one.
        drop(lock);
        remove_folder(staging)?;
        if is_part {
            PartFolder::remove(&self.dir)?;
        }
        // Who has something else in it keeps it.
        let _ = fs::remove_dir(&self.dir);
        Ok(())
    }

    /// [`finish`](Self::finish) of samples that lie in `sources`, in index order and all of them.
    pub(super) fn finish_of(
        self,
        sources: &[Blocks],
        progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Result<(), DataError> {
        let State::Collecting { _lock: lock, .. } = self.state else {
            return Ok(());
        };
        assemble(&self.dir, &self.blocks.meta, sources, progress)?;
        // Not every system removes an open file, and the lock is one.
        drop(lock);
        remove_folder(&self.blocks.dir)
    }
}

/// Whether a staging folder holds more than what tells whose it is.
fn holds_blocks(staging: &Path) -> Result<bool, DataError> {
    let unwritten = format!("{META_FILE}.{TEMPORARY}");
    let own = [LOCK_FILE.to_owned(), META_FILE.to_owned(), unwritten];
    Ok(foreign_entry(staging, &own)?.is_some())
}

/// Whether it does, or a collector has it open.
fn is_begun(staging: &Path) -> Result<bool, DataError> {
    let path = staging.join(LOCK_FILE);
    let lock = try_lock(&path).map_err(DataError::io("create", &path))?;
    Ok(lock.is_none() || holds_blocks(staging)?)
}

/// Refuses a folder that holds anything, except what an interrupted [`Collector::open`] leaves.
fn require_fresh(dir: &Path) -> Result<(), DataError> {
    if let Some(found) = PartFolder::load(dir)? {
        return Err(DataError::OtherPart {
            path: dir.to_owned(),
            found: Some(found.part),
            expected: None,
        });
    }
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

/// Keeps other collectors out of `dir` for as long as the file is open.
fn lock(dir: &Path) -> Result<File, DataError> {
    let path = dir.join(STAGING).join(LOCK_FILE);
    let file = try_lock(&path).map_err(DataError::io("create", &path))?;
    file.ok_or_else(|| DataError::InUse {
        path: dir.to_owned(),
    })
}

/// Removes the staging folder of the complete set `meta`, unless that is to grow there.
fn remove_leftovers(staging: &Path, meta: &Meta) -> Result<(), DataError> {
    match Meta::load(&staging.join(META_FILE)) {
        Ok(Some(staged)) if staged != *meta => Ok(()),
        _ => remove_folder(staging),
    }
}
