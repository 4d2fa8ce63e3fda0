//! A file of finished pieces of work, from which an interrupted stage is taken up.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::PipelineError;

/// A growing file of JSON lines: the first says whose work it is, each other is a finished piece.
///
/// A line that a killed process left unfinished is dropped, and so are all lines of other work.
pub(super) struct Journal {
    path: PathBuf,
    file: Mutex<File>,
}

impl Journal {
    /// Opens the journal of the work that `key` stands for; also returns what is in it.
    pub fn open<T: DeserializeOwned>(
        path: &Path,
        key: &Value,
    ) -> Result<(Self, Vec<T>), PipelineError> {
        let fail = |source| PipelineError::Folder {
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
        let (mut entries, mut whole) = (Vec::new(), 0);
        let mut reader = BufReader::new(&file);
        let mut line = String::new();
        while reader.read_line(&mut line).is_ok_and(|length| length > 0) && line.ends_with('\n') {
            if whole == 0 {
                if serde_json::from_str::<Value>(&line).ok().as_ref() != Some(key) {
                    break;
                }
            } else {
                let Ok(entry) = serde_json::from_str(&line) else {
                    break;
                };
                entries.push(entry);
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
        let journal = Self {
            path: path.to_owned(),
            file: Mutex::new(file),
        };
        Ok((journal, entries))
    }

    /// Adds a finished piece. Pieces may come from several threads.
    pub fn add(&self, entry: &impl Serialize) -> Result<(), PipelineError> {
        let mut line = serde_json::to_string(entry).expect("plain values serialise");
        line.push('\n');
        let mut file = self
            .file
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        file.write_all(line.as_bytes())
            .map_err(|source| PipelineError::Folder {
                path: self.path.clone(),
                source,
            })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use serde_json::json;

    fn entries(path: &Path, key: u32) -> Vec<u32> {
        Journal::open(path, &json!({ "key": key })).unwrap().1
    }

    #[test]
    fn what_was_added_is_there_again_and_half_a_line_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let (journal, found) = Journal::open::<u32>(&path, &json!({"key": 1})).unwrap();
        assert!(found.is_empty());
        (7..10).for_each(|entry| journal.add(&entry).unwrap());
        drop(journal);
        assert_eq!(entries(&path, 1), [7, 8, 9]);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        assert_eq!(entries(&path, 1), [7, 8]);
        let (journal, _) = Journal::open::<u32>(&path, &json!({"key": 1})).unwrap();
        journal.add(&5).unwrap();
        assert_eq!(entries(&path, 1), [7, 8, 5]);
    }

    #[test]
    fn another_work_starts_anew() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let (journal, _) = Journal::open::<u32>(&path, &json!({"key": 1})).unwrap();
        journal.add(&7).unwrap();
        assert!(entries(&path, 2).is_empty());
        assert!(entries(&path, 1).is_empty());
    }
}
