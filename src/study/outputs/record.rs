//! `study.json`: what was run.

use std::path::Path;

use serde::{Deserialize, Serialize};
use tdcr_base::files::{LARGEST_TEXT, read_text};

use crate::study::error::StudyError;
use crate::study::spec::{Column, Study};

/// Its name.
pub(in crate::study) const RECORD: &str = "study.json";
/// The table's.
pub(in crate::study) const TABLE: &str = "table.csv";
/// That of the rows of an unfinished study.
pub(in crate::study) const ROWS: &str = "table.csv.unfinished";

/// What a folder holds.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::study) struct Record {
    pub tdcr_version: String,
    pub title: String,
    pub seed: u64,
    /// Rows of the table, and those that settled.
    pub rows: usize,
    pub settled: usize,
    /// `[I, N]`: part `I` of `N`; nothing for a whole study.
    pub part: Option<[usize; 2]>,
    /// Number of the first row.
    pub first_row: usize,
    /// When the run that finished it began (s since 1970), and how long that took (s).
    pub began: u64,
    pub seconds: f64,
    pub columns: Vec<Column>,
    pub study: Study,
}

impl Record {
    /// The record of a folder; `None` where there is none.
    ///
    /// # Errors
    /// [`StudyError::Table`] where it cannot be read.
    pub fn read(dir: &Path) -> Result<Option<Self>, StudyError> {
        let path = dir.join(RECORD);
        match path.exists() {
            true => Self::of_file(&path).map(Some),
            false => Ok(None),
        }
    }

    fn of_file(path: &Path) -> Result<Self, StudyError> {
        let fail = |line, reason: String| StudyError::Table {
            path: path.to_owned(),
            line,
            reason,
        };
        let text = read_text(path, LARGEST_TEXT).map_err(|error| fail(1, error.to_string()))?;
        serde_json::from_str(&text).map_err(|error| fail(error.line(), error.to_string()))
    }

    /// Whether it is of this study, this part of it, and by this version.
    pub fn is_of(&self, study: &Study, part: Option<[usize; 2]>) -> bool {
        self.study == *study && self.part == part && self.tdcr_version == env!("CARGO_PKG_VERSION")
    }
}
