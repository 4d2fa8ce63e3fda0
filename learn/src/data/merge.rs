//! Parts of a data set put together.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use super::DataError;
use super::blocks::Blocks;
use super::collector::Collector;
use super::merge_error::MergeError;
use super::meta::{META_FILE, Meta};
use super::part::PartFolder;

/// Puts the parts of a data set in the folders `parts`, in any order, together in the folder `out`, which is made if it is not
/// there: byte for byte the files that [`Collector`] makes of the whole set at once. The parts are only read. Interrupted, the
/// same call begins anew and ends in the same files. Returns what the data set is made with.
///
/// `progress` is called with the steps done and the steps in all, and may ask to stop.
///
/// # Errors
/// [`DataError::Merge`] where the folders are not the parts of one data set, each finished and there once, before anything is
/// written; else as [`Collector::open`] and [`Collector::finish`].
pub fn merge(
    parts: &[PathBuf],
    out: &Path,
    mut progress: impl FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Meta, DataError> {
    let mut folders = vec![];
    for dir in parts {
        folders.push(load(dir)?);
    }
    require_one_set(&folders)?;
    folders.sort_by_key(|folder| folder.part.number());
    require_each_once(&folders)?;
    for folder in &folders {
        require_finished(folder)?;
    }
    let sources: Vec<Blocks> = folders.into_iter().map(|folder| folder.blocks).collect();
    let meta = sources[0].meta.clone();
    Collector::open(out, &meta)?.finish_of(&sources, &mut progress)?;
    Ok(meta)
}

fn load(dir: &Path) -> Result<PartFolder, DataError> {
    if let Some(folder) = PartFolder::load(dir)? {
        return Ok(folder);
    }
    let found = match () {
        () if dir.join(META_FILE).exists() => "a whole data set",
        () if dir.exists() => "no part of a data set",
        () => "nothing: there is no such folder",
    };
    Err(MergeError::NotAPart {
        path: dir.to_owned(),
        found,
    }
    .into())
}

/// Refuses parts of different data sets, or of one that was divided differently.
fn require_one_set(folders: &[PartFolder]) -> Result<(), MergeError> {
    let (first, others) = folders.split_first().ok_or(MergeError::NoParts)?;
    for other in others {
        let [expected, found] = [first, other].map(|folder| folder.part.of());
        let of = (expected != found).then(|| {
            let [expected, found] = [expected, found].map(|of| of.to_string());
            ("parts".to_owned(), expected, found)
        });
        let difference = || first.blocks.meta.difference(&other.blocks.meta);
        if let Some((field, expected, found)) = of.or_else(difference) {
            return Err(MergeError::OtherSet {
                path: other.dir.clone(),
                first: first.dir.clone(),
                field,
                expected,
                found,
            });
        }
    }
    Ok(())
}

/// Refuses parts, in order of their numbers, of which one is there twice or not at all.
fn require_each_once(folders: &[PartFolder]) -> Result<(), MergeError> {
    for pair in folders.windows(2) {
        if pair[0].part == pair[1].part {
            return Err(MergeError::Twice {
                paths: [pair[0].dir.clone(), pair[1].dir.clone()],
                part: pair[0].part,
            });
        }
    }
    let of = folders[0].part.of();
    let mut there = folders.iter().map(|folder| folder.part.number()).peekable();
    let is_missing = |number: &usize| there.next_if_eq(number).is_none();
    let missing: Vec<usize> = (1..=of).filter(is_missing).collect();
    match missing.is_empty() {
        true => Ok(()),
        false => Err(MergeError::Missing { missing, of }),
    }
}

fn require_finished(folder: &PartFolder) -> Result<(), MergeError> {
    let missing = folder.blocks.missing();
    match missing.is_empty() {
        true => Ok(()),
        false => Err(MergeError::Unfinished {
            path: folder.dir.clone(),
            part: folder.part,
            missing: missing.iter().map(ExactSizeIterator::len).sum(),
            samples: folder.blocks.len(),
        }),
    }
}
