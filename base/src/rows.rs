//! Cells of the lines of tables (CSV), by the crate `csv`.
//!
//! A row is a line: a cell ends with its line, so that a quote which is never closed spoils its row and not the file, and a
//! message names the line that a person sees.

use std::io::{Cursor, SeekFrom};

use csv::{Position, Reader, ReaderBuilder, StringRecord};

/// Splits lines into cells (RFC 4180): cells may be quoted, `""` in them is a quote. Rows may have any number of cells.
///
/// ```
/// use tdcr_base::rows::Splitter;
///
/// let mut splitter = Splitter::new(b',');
/// assert_eq!(splitter.cells("0.1,\"a, \"\"b\"\"\",,7\r\n"), ["0.1", "a, \"b\"", "", "7"]);
/// assert_eq!(splitter.trimmed(" c0 , \"c1\""), ["c0", "c1"]);
/// ```
#[derive(Debug)]
pub struct Splitter {
    reader: Reader<Cursor<Vec<u8>>>,
    record: StringRecord,
}

impl Splitter {
    /// Of lines whose cells are apart by `separator`, an ASCII character.
    pub fn new(separator: u8) -> Self {
        let reader = ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .delimiter(separator)
            .from_reader(Cursor::default());
        Self {
            reader,
            record: StringRecord::new(),
        }
    }

    /// The cells of a line, with or without its end, as they are between separators and quotes. An empty line is an empty cell.
    pub fn cells(&mut self, line: &str) -> Vec<String> {
        self.read(line);
        match self.record.is_empty() {
            true => vec![String::new()],
            false => self.record.iter().map(str::to_owned).collect(),
        }
    }

    /// The same without the space around each, and without the quotes that a space came before.
    pub fn trimmed(&mut self, line: &str) -> Vec<String> {
        let mut cells = self.cells(line);
        for cell in &mut cells {
            *cell = bare(cell).to_owned();
        }
        cells
    }

    fn read(&mut self, line: &str) {
        let bytes = self.reader.get_mut().get_mut();
        bytes.clear();
        bytes.extend_from_slice(line.as_bytes());
        let begin = self.reader.seek_raw(SeekFrom::Start(0), Position::new());
        let read = begin.and_then(|()| self.reader.read_record(&mut self.record));
        // Neither fails: the bytes are in memory and are text, and rows may have any length.
        if read.is_err() {
            self.record.clear();
        }
    }
}

/// A cell without the space around it, and without the quotes around that.
fn bare(cell: &str) -> &str {
    let cell = cell.trim();
    let quoted = cell
        .strip_prefix('"')
        .and_then(|rest| rest.strip_suffix('"'));
    quoted.map_or(cell, str::trim)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_split_one_by_one_whatever_the_last_one_was() {
        let mut splitter = Splitter::new(b';');
        assert_eq!(splitter.cells("a;b,c"), ["a", "b,c"]);
        // A quote that is not closed ends with its line.
        assert_eq!(splitter.cells("1;\"2;3\n"), ["1", "2;3\n"]);
        assert_eq!(splitter.cells("4;5;6\r\n"), ["4", "5", "6"]);
        assert_eq!(splitter.cells("\n"), [""]);
        assert_eq!(splitter.cells(""), [""]);
        assert_eq!(splitter.cells("7;"), ["7", ""]);
        assert_eq!(splitter.cells(" \"x;y\" "), [" \"x", "y\" "]);
        let long = "9;".repeat(20_000);
        assert_eq!(splitter.cells(&long).len(), 20_001);
        assert_eq!(splitter.cells("8"), ["8"]);
    }

    #[test]
    fn trimmed_cells_have_no_space_and_no_quotes_around_them() {
        let mut splitter = Splitter::new(b',');
        let cells = splitter.trimmed(" 1 ,\" two \", \"three\" ,\"a,b\",\"");
        assert_eq!(cells, ["1", "two", "three", "a,b", ""]);
    }
}
