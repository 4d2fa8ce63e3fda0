//! Tables: columns with units, cells, lines of CSV.

use serde::{Deserialize, Serialize};

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// Unit of its numbers; empty where there is none.
    pub unit: String,
    /// What its cells are.
    pub kind: Kind,
}

/// What the cells of a column are. Any cell may be empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Numbers.
    Number,
    /// Whole numbers.
    Whole,
    /// Text.
    Text,
}

/// A cell.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cell {
    Number(f64),
    Whole(i64),
    Text(String),
    Empty,
}

impl Column {
    pub(super) fn new(name: &str, unit: &str, kind: Kind) -> Self {
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            kind,
        }
    }

    /// Its name with its unit, as the first line of a table has it.
    pub fn title(&self) -> String {
        match self.unit.as_str() {
            "" => self.name.clone(),
            unit => format!("{} ({unit})", self.name),
        }
    }
}

/// The first line of a table, with its end.
pub(super) fn header(columns: &[Column]) -> String {
    let titles: Vec<String> = columns
        .iter()
        .map(|column| quoted(&column.title()))
        .collect();
    titles.join(",") + "\n"
}

/// Adds a line with these cells. Numbers are the shortest text that reads back the same; those that are none are empty.
pub(super) fn push_line(out: &mut String, cells: &[Cell]) {
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

#[cfg(test)]
mod tests {
    use tdcr_base::rows::Splitter;

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
