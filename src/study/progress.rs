//! The rows of an unfinished study: a file that grows by whole blocks, from which a killed study resumes.
//!
//! The first line says whose rows they are, each other is a row of the table, by ascending number. A line that a killed process
//! left unfinished is dropped, and so is all behind a line out of order.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::StudyError;

/// An open file of rows.
pub(super) struct Progress {
    path: PathBuf,
    file: File,
    /// The number of the next row.
    pub next: usize,
}

impl Progress {
    /// Opens the file of the work that `key` stands for, whose first row has the number `first`.
    ///
    /// # Errors
    /// [`StudyError::OtherStudy`] for a file of other work, [`StudyError::Write`] where it cannot be read or written.
    pub fn open(path: &Path, key: &Value, first: usize) -> Result<Self, StudyError> {
        let fail = |source| StudyError::Write {
            path: path.to_owned(),
            source,
        };
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .map_err(fail)?;
        let (mut next, mut whole) = (first, 0);
        let mut reader = BufReader::new(&file);
        let mut line = String::new();
        while reader.read_line(&mut line).is_ok_and(|length| length > 0) && line.ends_with('\n') {
            if whole == 0 {
                let found: Option<Value> = serde_json::from_str(&line).ok();
                if found.as_ref() != Some(key) {
                    let path = path.parent().unwrap_or(path).to_owned();
                    return Err(StudyError::OtherStudy { path });
                }
            } else {
                let number = line
                    .split([',', '\n'])
                    .next()
                    .and_then(|cell| cell.parse().ok());
                if number != Some(next) {
                    break;
                }
                next += 1;
            }
            whole += line.len() as u64;
            line.clear();
        }
        file.set_len(whole)
            .and_then(|()| file.seek(SeekFrom::End(0)))
            .map_err(fail)?;
        if whole == 0 {
            writeln!(file, "{key}").map_err(fail)?;
        }
        Ok(Self {
            path: path.to_owned(),
            file,
            next,
        })
    }

    /// Adds the lines of the next `count` rows.
    pub fn add(&mut self, lines: &str, count: usize) -> Result<(), StudyError> {
        self.next += count;
        self.file
            .write_all(lines.as_bytes())
            .map_err(|source| StudyError::Write {
                path: self.path.clone(),
                source,
            })
    }

    /// Flushes all to the disk and closes the file.
    pub fn close(self) -> Result<(), StudyError> {
        self.file.sync_all().map_err(|source| StudyError::Write {
            path: self.path,
            source,
        })
    }
}
