//! From a finished table to everything else in the folder.

use std::io::{BufReader, Write};
use std::path::Path;

use tdcr_base::files::{self, without_mark, write_atomically};
use tdcr_base::rows::Splitter;

use super::StudyError;
use super::cases::Cases;
use super::parquet_file;
use super::record::{RECORD, ROWS, Record, TABLE};
use super::report;
use super::summary;
use super::table::{Column, header};
use super::worker::{SETTLED, STATUS, places};
use crate::pipeline::Monitor;

/// Writes the table as Parquet, the summary, the report and the record, which is last: a folder with it is whole. Of a part,
/// the record alone. Returns how many rows settled.
pub(super) fn finish(
    cases: &Cases,
    dir: &Path,
    mut record: Record,
    monitor: &dyn Monitor,
) -> Result<usize, StudyError> {
    record.settled = settled(&Table::new(dir, &record))?;
    if record.part.is_none() {
        let table = Table::new(dir, &record);
        monitor.status("writing table.parquet");
        parquet_file::write(&dir.join("table.parquet"), &table)?;
        monitor.status("writing the summary");
        summary::write(cases, &record, &table, dir)?;
        monitor.status("drawing the report");
        report::write(cases, &record, &table, dir)?;
    }
    let text = serde_json::to_string_pretty(&record).map_err(std::io::Error::from);
    let path = dir.join(RECORD);
    text.and_then(|text| write_atomically(&path, |file| writeln!(file, "{text}")))
        .map_err(|source| StudyError::Write { path, source })?;
    let unfinished = dir.join(ROWS);
    if unfinished.exists() {
        std::fs::remove_file(&unfinished).map_err(|source| StudyError::Write {
            path: unfinished,
            source,
        })?;
    }
    Ok(record.settled)
}

fn settled(table: &Table) -> Result<usize, StudyError> {
    let status = places(table.columns)
        .get(STATUS)
        .copied()
        .unwrap_or_default();
    let mut settled = 0;
    table.rows(|_, cells| {
        settled += usize::from(cells[status] == SETTLED);
        Ok(())
    })?;
    Ok(settled)
}

/// A table on disk, read row by row.
pub(super) struct Table<'a> {
    path: std::path::PathBuf,
    pub columns: &'a [Column],
    first_row: usize,
    rows: usize,
}

impl<'a> Table<'a> {
    pub fn new(dir: &Path, record: &'a Record) -> Self {
        Self {
            path: dir.join(TABLE),
            columns: &record.columns,
            first_row: record.first_row,
            rows: record.rows,
        }
    }

    /// Hands each row's number and cells to `visit`.
    ///
    /// # Errors
    /// [`StudyError::Table`] for a line that was not written here; those of `visit`.
    pub fn rows(
        &self,
        mut visit: impl FnMut(usize, Vec<String>) -> Result<(), StudyError>,
    ) -> Result<(), StudyError> {
        let fail = |line: usize, reason: String| StudyError::Table {
            path: self.path.clone(),
            line,
            reason,
        };
        let file = files::open(&self.path).map_err(|error| fail(1, error.to_string()))?;
        let mut lines = BufReader::new(file);
        let mut splitter = Splitter::new(b',');
        let mut line = String::new();
        let mut next = |line: &mut String, number: usize| {
            let length = files::read_line(&mut lines, line);
            length.map_err(|error| fail(number, error.to_string()))
        };
        next(&mut line, 1)?;
        if without_mark(&line).trim_end() != header(self.columns).trim_end() {
            return Err(fail(
                1,
                "these are not the columns of study.json".to_owned(),
            ));
        }
        let mut read = 0;
        while next(&mut line, read + 2)? > 0 {
            let number = read + 2;
            let cells = splitter.cells(&line);
            if cells.len() != self.columns.len() {
                let expected = self.columns.len();
                return Err(fail(
                    number,
                    format!("{} cells, expected {expected}", cells.len()),
                ));
            }
            let row = self.first_row + read;
            if cells[0].parse() != Ok(row) {
                return Err(fail(
                    number,
                    format!("row {}, expected row {row}", cells[0]),
                ));
            }
            visit(row, cells)?;
            read += 1;
        }
        match read == self.rows {
            true => Ok(()),
            false => Err(fail(
                read + 1,
                format!("{read} rows, expected {}", self.rows),
            )),
        }
    }
}
