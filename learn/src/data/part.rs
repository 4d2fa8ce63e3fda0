//! Parts of a data set, collected apart, each in a folder of its own:
//!
//! ```text
//! part.json                    {"part": I, "of": N, "meta": {...}}: which part, and the meta of the whole set
//! blocks/block-00000000.h5     the samples, a few consecutive ones a file: `data`, `rgb` and `motors` of a shard
//! ```
//!
//! Part `I` of `N` of `count` samples holds those from `(I - 1) count / N` to before `I count / N`, rounded down: none, where
//! there are more parts than samples. It is complete when all its blocks are there.

use std::fmt;
use std::fs::{self, File};
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use tdcr_sim::files::{LARGEST_TEXT, TEMPORARY, read_text};

use super::DataError;
use super::blocks::Blocks;
use super::collector::STAGING;
use super::folder::foreign_entry;
use super::meta::{META_FILE, Meta, Version, save_json};
use super::split::MAX_SAMPLES;
use crate::lock::try_lock;

/// File that makes a folder a part's.
pub(super) const PART_FILE: &str = "part.json";
const BLOCKS: &str = "blocks";
const LOCK_FILE: &str = ".lock";

/// Which part of a data set: `number` of `of`, counted from 1; as text `I/N`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Part {
    number: usize,
    of: usize,
}

impl Part {
    /// Part `number` of `of`.
    ///
    /// # Errors
    /// [`DataError::InvalidPart`] unless `1 <= number <= of <= 10000000`.
    pub fn new(number: usize, of: usize) -> Result<Self, DataError> {
        if (1..=of).contains(&number) && of <= MAX_SAMPLES {
            return Ok(Self { number, of });
        }
        Err(DataError::InvalidPart {
            found: format!("{number}/{of}"),
        })
    }

    /// Which part, from 1.
    pub fn number(self) -> usize {
        self.number
    }

    /// Number of parts in all.
    pub fn of(self) -> usize {
        self.of
    }

    /// Indices of the part's samples in a data set of `count` samples.
    pub fn samples(self, count: usize) -> Range<usize> {
        let end_of = |parts: usize| (parts as u128 * count as u128 / self.of as u128) as usize;
        end_of(self.number - 1)..end_of(self.number)
    }
}

impl fmt::Display for Part {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        write!(out, "part {} of {}", self.number, self.of)
    }
}

/// Reads `I/N`.
impl FromStr for Part {
    type Err = DataError;

    fn from_str(text: &str) -> Result<Self, DataError> {
        let numbers = text.split_once('/').and_then(|(number, of)| {
            let whole = |digits: &str| digits.parse().ok();
            Some((whole(number)?, whole(of)?))
        });
        let (number, of) = numbers.ok_or_else(|| DataError::InvalidPart {
            found: text.to_owned(),
        })?;
        Self::new(number, of)
    }
}

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
        let samples = part.samples(meta.count);
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
        let invalid = |problem: DataError| DataError::InvalidJson {
            path: path.clone(),
            problem: problem.to_string(),
        };
        let part = Part::new(part, of).map_err(invalid)?;
        meta.validate().map_err(invalid)?;
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

    fn save(&self) -> Result<(), DataError> {
        let Part { number, of } = self.part;
        let contents = Contents {
            part: number,
            of,
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn parts_hold_every_sample_once_in_order_and_are_of_equal_size(count in 0..3000_usize, of in 1..4000_usize) {
            let mut end = 0;
            for number in 1..=of {
                let samples = Part::new(number, of).unwrap().samples(count);
                prop_assert_eq!(samples.start, end);
                prop_assert!((count / of..=count.div_ceil(of)).contains(&samples.len()));
                end = samples.end;
            }
            prop_assert_eq!(end, count);
        }
    }

    #[test]
    fn a_part_is_two_whole_numbers_of_which_the_first_counts_up_to_the_second() {
        let part: Part = "2/7".parse().unwrap();
        assert_eq!((part.number(), part.of()), (2, 7));
        assert_eq!(part.to_string(), "part 2 of 7");
        let largest: Part = "10000000/10000000".parse().unwrap();
        assert_eq!(largest.samples(10_000_000), 9_999_999..10_000_000);
        for text in [
            "",
            "2",
            "0/3",
            "4/3",
            "1/0",
            "-1/3",
            "1/3/3",
            "1.0/3",
            "1/10000001",
            "a/b",
        ] {
            let error = text.parse::<Part>().unwrap_err().to_string();
            let expected = format!("`{text}` is no part, expected I/N");
            assert!(error.starts_with(&expected), "{error}");
        }
    }
}
