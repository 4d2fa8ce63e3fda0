//! A file of finished pieces of work, from which an interrupted stage resumes.

use std::io::Write;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;
use tdcr_base::files::write_atomically;

use super::PipelineError;
use super::line_file::LineFile;

/// A growing file of JSON lines: the first says whose work it is, each other is a finished piece with its checksum.
///
/// A line that a killed process left unfinished is dropped, and so are all lines of other work. So are a line that was
/// edited or damaged, by its checksum, and those behind it. The checksum guards against damage, not against forgery.
pub(super) struct Journal {
    /// The first line, which all checksums begin with.
    key: String,
    file: Mutex<LineFile>,
}

/// Text of a line around its checksum and its piece: before the checksum, between the two, after the piece.
const FRAME: [&str; 3] = ["{\"checksum\":\"", "\",\"entry\":", "}\n"];

impl Journal {
    /// Opens the journal of the work that `key` stands for; also returns what is in it.
    pub fn open<T: DeserializeOwned>(
        path: &Path,
        key: &Value,
    ) -> Result<(Self, Vec<T>), PipelineError> {
        let key_line = key.to_string();
        let mut entries = Vec::new();
        let file = LineFile::open(path, key, |line| {
            let entry = entry(&key_line, line);
            let found = entry.is_some();
            entries.extend(entry);
            found
        })?;
        let journal = Self {
            key: key_line,
            file: Mutex::new(file),
        };
        Ok((journal, entries))
    }

    /// The same of pieces that are to be kept; the others go.
    pub fn open_kept<T: DeserializeOwned + Serialize>(
        path: &Path,
        key: &Value,
        mut is_kept: impl FnMut(&T) -> bool,
    ) -> Result<(Self, Vec<T>), PipelineError> {
        let (journal, mut entries) = Self::open(path, key)?;
        let found = entries.len();
        entries.retain(&mut is_kept);
        if entries.len() == found {
            return Ok((journal, entries));
        }
        drop(journal);
        let key_line = key.to_string();
        let lines = entries.iter().map(|entry| line(&key_line, entry));
        let text: String = [format!("{key_line}\n")].into_iter().chain(lines).collect();
        let rewritten = write_atomically(path, |file| file.write_all(text.as_bytes()));
        rewritten.map_err(|source| PipelineError::Write {
            path: path.to_owned(),
            source,
        })?;
        Self::open(path, key)
    }

    /// Adds a finished piece. Pieces may come from several threads.
    pub fn add(&self, entry: &impl Serialize) -> Result<(), PipelineError> {
        let line = line(&self.key, entry);
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.add(&line)
    }

    /// Does `work` while the journal is as good as on a disk that stalls: nothing can be added.
    #[cfg(test)]
    pub fn while_stalled(&self, work: impl FnOnce()) {
        let _file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        work();
    }
}

/// The line of a piece.
fn line(key: &str, entry: &impl Serialize) -> String {
    let entry = serde_json::to_string(entry).expect("plain values serialise");
    let [before, between, behind] = FRAME;
    let sum = checksum(key, &entry);
    format!("{before}{sum}{between}{entry}{behind}")
}

/// The piece in a line; `None` for one that is not as it was written.
fn entry<T: DeserializeOwned>(key: &str, line: &str) -> Option<T> {
    let [before, between, behind] = FRAME;
    let line = line.strip_prefix(before)?.strip_suffix(behind)?;
    let (sum, entry) = line.split_once(between)?;
    if sum != checksum(key, entry) {
        return None;
    }
    serde_json::from_str(entry).ok()
}

/// FNV-1a of the key and a piece, 64 bits in hexadecimal.
fn checksum(key: &str, entry: &str) -> String {
    let bytes = key.bytes().chain([b'\n']).chain(entry.bytes());
    let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    format!("{hash:016x}")
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
        std::fs::write(&path, [&b"\xef\xbb\xbf"[..], &bytes].concat()).unwrap();
        assert_eq!(entries(&path, 1), [7, 8, 9], "behind a byte order mark");
        std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
        assert_eq!(entries(&path, 1), [7, 8]);
        let (journal, _) = Journal::open::<u32>(&path, &json!({"key": 1})).unwrap();
        journal.add(&5).unwrap();
        assert_eq!(entries(&path, 1), [7, 8, 5]);
    }

    #[test]
    fn a_piece_that_was_edited_is_not_believed_nor_what_is_behind_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let (journal, _) = Journal::open::<u32>(&path, &json!({"key": 1})).unwrap();
        (7..10).for_each(|entry| journal.add(&entry).unwrap());
        drop(journal);
        let written = std::fs::read_to_string(&path).unwrap();
        let edited = written.replace("\"entry\":8}", "\"entry\":6}");
        assert_ne!(edited, written);
        std::fs::write(&path, edited).unwrap();
        assert_eq!(entries(&path, 1), [7]);
        // Pieces of other work, under this one's first line.
        std::fs::write(&path, written.replace("{\"key\":1}", "{\"key\":2}")).unwrap();
        assert!(entries(&path, 2).is_empty());
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
