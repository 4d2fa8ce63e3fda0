//! The rows of an unfinished study: a file that grows by whole blocks, from which a killed study resumes.
//!
//! The first line says whose rows they are, each other is a row of the table, by ascending number.

use std::path::Path;

use serde_json::Value;

use crate::pipeline::LineFile;
use crate::study::error::StudyError;

/// An open file of rows.
pub(super) struct Progress {
    file: LineFile,
    /// The number of the next row.
    pub next: usize,
}

impl Progress {
    /// Opens the file of the work that `key` stands for, whose first row has the number `first`.
    ///
    /// # Errors
    /// [`StudyError::OtherStudy`] for a file of other work, [`StudyError::Write`] where it cannot be read or written.
    pub fn open(path: &Path, key: &Value, first: usize) -> Result<Self, StudyError> {
        if LineFile::is_of_other_work(path, key) {
            let path = path.parent().unwrap_or(path).to_owned();
            return Err(StudyError::OtherStudy { path });
        }
        let mut next = first;
        let file = LineFile::open(path, key, |line| {
            let number = line.split([',', '\n']).next();
            let expected = number.and_then(|cell| cell.parse().ok()) == Some(next);
            next += usize::from(expected);
            expected
        })?;
        Ok(Self { file, next })
    }

    /// Adds the lines of the next `count` rows.
    pub fn add(&mut self, lines: &str, count: usize) -> Result<(), StudyError> {
        self.next += count;
        Ok(self.file.add(lines)?)
    }

    /// Flushes all to the disk and closes the file.
    pub fn close(self) -> Result<(), StudyError> {
        Ok(self.file.close()?)
    }
}
