//! Tables: cells, lines of CSV, and a table on disk, read row by row.

use std::io::BufReader;
use std::path::{Path, PathBuf};

use tdcr_base::files::{self, without_mark};
use tdcr_base::rows::Splitter;

use super::record::{Record, TABLE};
use crate::study::error::StudyError;
use crate::study::spec::Column;

/// A cell.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::study) enum Cell {
    Number(f64),
    Whole(i64),
    Text(String),
    Empty,
}

/// The first line of a table, with its end.
pub(in crate::study) fn header(columns: &[Column]) -> String {
    let titles: Vec<String> = columns
        .iter()
        .map(|column| quoted(&column.title()))
        .collect();
    titles.join(",") + "\n"
}

/// Adds a line with these cells. Numbers are the shortest text that reads back the same; those that are none are empty.
pub(in crate::study) fn push_line(out: &mut String, cells: &[Cell]) {
    for (place, cell) in cells.iter().enumerate() {
        if place > 0 {
            out.push(',');
        }
        match cell {
            Cell::Number(number) if number.is_finite() => out.push_str(&format!("{number:?}")),
            Cell::Whole(number) => out.push_str(&number.to_string()),
            Cell::Text(text) => out.push_str(&quoted(text)),
            Cell::Number(_) | Cell::Empty => {}
        }
    }
    out.push('\n');
}

/// A text as a cell (RFC 4180), on one line.
fn quoted(text: &str) -> String {
    let line = text.replace(['\n', '\r'], " ");
    match line.contains([',', '"']) {
        true => format!("\"{}\"", line.replace('"', "\"\"")),
        false => line,
    }
}

/// A table on disk, read row by row.
pub(in crate::study) struct Table<'a> {
    path: PathBuf,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_reads_back_as_what_was_written() {
        let texts = ["plain", "a, \"b\"", "", "two\nlines"];
        let mut line = String::new();
        let written: Vec<Cell> = texts
            .iter()
            .map(|text| Cell::Text((*text).to_owned()))
            .collect();
        push_line(&mut line, &written);
        let mut splitter = Splitter::new(b',');
        assert_eq!(
            splitter.cells(&line),
            ["plain", "a, \"b\"", "", "two lines"]
        );
        let numbers = [0.1, 1e-12, -3.0, 12345.678];
        let mut line = String::new();
        push_line(&mut line, &numbers.map(Cell::Number));
        let read = splitter.cells(&line);
        let read: Vec<f64> = read.iter().filter_map(|cell| cell.parse().ok()).collect();
        assert_eq!(read, numbers);
        let mut line = String::new();
        push_line(
            &mut line,
            &[Cell::Number(f64::NAN), Cell::Empty, Cell::Whole(7)],
        );
        assert_eq!(line, ",,7\n");
    }
}
