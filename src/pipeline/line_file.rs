//! A file that grows by whole lines, from which killed work resumes.

use std::fs::{File, OpenOptions};
use std::io::{self, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde_json::Value;
use tdcr_base::files::{self, without_mark};

use super::PipelineError;

/// An open file of lines, whose first one says whose work it is.
pub(crate) struct LineFile {
    path: PathBuf,
    file: File,
}

impl LineFile {
    /// Whether the file holds other work than that which `key` stands for.
    pub fn is_of_other_work(path: &Path, key: &Value) -> bool {
        let mut line = String::new();
        let read = files::open(path)
            .and_then(|file| files::read_line(&mut BufReader::new(file), &mut line));
        read.is_ok() && line.ends_with('\n') && !is_key(&line, key)
    }

    /// Opens the file of the work that `key` stands for, or begins it, and hands its other lines, with their ends, to `keep`. The
    /// first that is not kept goes, and so do all behind it, a line that a killed process left unfinished, and other work.
    ///
    /// # Errors
    /// [`PipelineError::Write`] where it cannot be read or written.
    pub fn open(
        path: &Path,
        key: &Value,
        mut keep: impl FnMut(&str) -> bool,
    ) -> Result<Self, PipelineError> {
        let mut open = || -> io::Result<File> {
            if path.exists() {
                files::regular(path)?;
            }
            let mut file = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .open(path)?;
            let mut whole = 0;
            let mut reader = BufReader::new(&file);
            let mut line = String::new();
            let mut next = |line: &mut String| files::read_line(&mut reader, line);
            while next(&mut line).is_ok_and(|length| length > 0) && line.ends_with('\n') {
                let kept = match whole {
                    0 => is_key(&line, key),
                    _ => keep(&line),
                };
                if !kept {
                    break;
                }
                whole += line.len() as u64;
            }
            file.set_len(whole)?;
            file.seek(SeekFrom::End(0))?;
            if whole == 0 {
                writeln!(file, "{key}")?;
            }
            Ok(file)
        };
        let file = open().map_err(|source| failure(path, source))?;
        Ok(Self {
            path: path.to_owned(),
            file,
        })
    }

    /// Adds whole lines.
    ///
    /// # Errors
    /// [`PipelineError::Write`].
    pub fn add(&mut self, lines: &str) -> Result<(), PipelineError> {
        let written = self.file.write_all(lines.as_bytes());
        written.map_err(|source| failure(&self.path, source))
    }

    /// Flushes all to the disk and closes the file.
    ///
    /// # Errors
    /// [`PipelineError::Write`].
    pub fn close(self) -> Result<(), PipelineError> {
        let flushed = self.file.sync_all();
        flushed.map_err(|source| failure(&self.path, source))
    }
}

fn is_key(line: &str, key: &Value) -> bool {
    serde_json::from_str::<Value>(without_mark(line))
        .ok()
        .as_ref()
        == Some(key)
}

fn failure(path: &Path, source: io::Error) -> PipelineError {
    PipelineError::Write {
        path: path.to_owned(),
        source,
    }
}
