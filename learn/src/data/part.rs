//! Parts of a data set, collected apart, each in a folder of its own:
//!
//! ```text
//! part.json                    {"part": I, "of": N, "meta": {...}}: which part, and the meta of the whole set
//! blocks/block-00000000.h5     the samples, a few consecutive ones a file: `data`, `rgb` and `motors` of a shard
//! ```
//!
//! Which samples a part has, [`Part`] says. It is complete when all its blocks are there.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use tdcr_base::Part;
use tdcr_base::files::{LARGEST_TEXT, TEMPORARY, read_text};
use tdcr_base::lock::try_lock;

use super::DataError;
use super::blocks::Blocks;
use super::folder::{STAGING, foreign_entry, remove_file};
use super::meta::{META_FILE, Meta, Version, save_json};

/// File that makes a folder a part's.
pub(super) const PART_FILE: &str = "part.json";
const BLOCKS: &str = "blocks";
const LOCK_FILE: &str = ".lock";

/// The contents of `part.json`.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Contents {
    part: usize,
    of: usize,
    meta: Meta,
}

/// What every version of `part.json` says.
#[derive(Deserialize)]
struct ContentsVersion {
    meta: Version,
}

/// A folder of a part, complete or not.
#[derive(Clone, Debug)]
pub(super) struct PartFolder {
    pub(super) dir: PathBuf,
    pub(super) part: Part,
    pub(super) blocks: Blocks,
}

impl PartFolder {
    fn new(dir: &Path, part: Part, meta: Meta) -> Self {
        let samples = part.range(meta.count);
        Self {
            dir: dir.to_owned(),
            part,
            blocks: Blocks::new(dir.join(BLOCKS), meta, samples),
        }
    }

    /// The part in the folder `dir`; `None` where there is no `part.json`.
    pub(super) fn load(dir: &Path) -> Result<Option<Self>, DataError> {
        let path = dir.join(PART_FILE);
        let text = match read_text(&path, LARGEST_TEXT) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            text => text.map_err(DataError::io("read", &path))?,
        };
        let json = |source| DataError::Json {
            path: path.clone(),
            source,
        };
        let ContentsVersion { meta } = serde_json::from_str(&text).map_err(json)?;
        meta.require_known(&path)?;
        let Contents { part, of, meta } = serde_json::from_str(&text).map_err(json)?;
        let invalid = |problem: String| DataError::InvalidJson {
            path: path.clone(),
            problem,
        };
        let part = Part::new(part, of).map_err(|error| invalid(error.to_string()))?;
        let valid = meta.validate();
        valid.map_err(|error| invalid(error.to_string()))?;
        Ok(Some(Self::new(dir, part, meta)))
    }

    /// Opens the folder of a part, which is made if it is not there; the file keeps other collectors out while it is open.
    pub(super) fn open(dir: &Path, meta: &Meta, part: Part) -> Result<(Self, File), DataError> {
        let folder = Self::new(dir, part, meta.clone());
        let found = Self::load(dir)?;
        match &found {
            Some(found) => folder.require_same(found)?,
            None => require_fresh(dir, part)?,
        }
        fs::create_dir_all(dir).map_err(DataError::io("create", dir))?;
        let lock_path = dir.join(LOCK_FILE);
        let lock = try_lock(&lock_path).map_err(DataError::io("create", &lock_path))?;
        let lock = lock.ok_or_else(|| DataError::InUse {
            path: dir.to_owned(),
        })?;
        // Another collector may have begun a part before it let go of the lock.
        match Self::load(dir)? {
            Some(found) => folder.require_same(&found)?,
            None => folder.save()?,
        }
        let blocks = &folder.blocks.dir;
        fs::create_dir_all(blocks).map_err(DataError::io("create", blocks))?;
        Ok((folder, lock))
    }

    /// Removes what tells that a folder is one of a part.
    pub(super) fn remove(dir: &Path) -> Result<(), DataError> {
        remove_file(&dir.join(PART_FILE))?;
        remove_file(&dir.join(LOCK_FILE))
    }

    fn save(&self) -> Result<(), DataError> {
        let contents = Contents {
            part: self.part.number(),
            of: self.part.of(),
            meta: self.blocks.meta.clone(),
        };
        save_json(&self.dir.join(PART_FILE), &contents)
    }

    /// Refuses `found`, the part that is in the folder, unless it is this one.
    fn require_same(&self, found: &Self) -> Result<(), DataError> {
        if found.part != self.part {
            return Err(DataError::OtherPart {
                path: self.dir.clone(),
                found: Some(found.part),
                expected: Some(self.part),
            });
        }
        let (found, expected) = (&found.blocks.meta, &self.blocks.meta);
        match expected.grows_from(found, &self.dir)? {
            false => Ok(()),
            true => Err(DataError::OtherCount {
                path: self.dir.clone(),
                found: found.count,
                expected: expected.count,
                reason: "a merged data set can grow, its parts cannot".to_owned(),
            }),
        }
    }
}

/// Refuses a folder that holds anything, except what an interrupted [`PartFolder::open`] leaves.
fn require_fresh(dir: &Path, part: Part) -> Result<(), DataError> {
    if [META_FILE, STAGING]
        .iter()
        .any(|name| dir.join(name).exists())
    {
        return Err(DataError::OtherPart {
            path: dir.to_owned(),
            found: None,
            expected: Some(part),
        });
    }
    let leftovers = [LOCK_FILE.to_owned(), format!("{PART_FILE}.{TEMPORARY}")];
    match foreign_entry(dir, &leftovers)? {
        None => Ok(()),
        Some(found) => Err(DataError::ForeignFolder {
            path: dir.to_owned(),
            found,
        }),
    }
}
