//! Tables as spreadsheets and other programs write them: quoted cells, carriage returns, an empty last line.

use std::path::Path;

use tdcr::pipeline::recording::{Columns, RecordingFile};

use crate::files::{NAMES, recording};

/// A recording read with the map that stands beside this file.
fn read(text: &str) -> RecordingFile {
    let columns: Columns = toml::from_str(include_str!("columns.toml")).unwrap();
    RecordingFile::parse(text.as_bytes(), &columns, Path::new("r.csv")).unwrap()
}

/// Every cell of a table within quotes.
fn quoted(table: &str) -> String {
    let lines = table
        .lines()
        .map(|line| format!("\"{}\"", line.replace(',', "\",\"")));
    lines.collect::<Vec<String>>().join("\n")
}

#[test]
fn a_recording_is_the_same_however_its_table_is_written() {
    let plain = String::from_utf8(recording(",")).unwrap();
    let expected = read(&plain);
    assert!(expected.bad.is_empty() && expected.lines == [2, 3, 4, 5, 6, 7]);
    for (how, written) in [
        ("quoted", quoted(&plain)),
        (
            "space before quotes",
            quoted(&plain).replace(",\"", " , \""),
        ),
        ("carriage returns", plain.replace('\n', "\r\n")),
        ("a last line", format!("{plain}\n")),
        ("an empty last line", format!("{plain}\n\n")),
        ("a line of spaces", format!("{plain}\r\n  \r\n")),
        ("a mark", format!("\u{feff}{plain}")),
        ("tabs", plain.replace(',', "\t")),
        ("semicolons", quoted(&plain).replace(',', ";")),
    ] {
        assert_eq!(read(&written), expected, "{how}");
    }
}

#[test]
fn a_bad_cell_is_named_by_line_and_column_and_a_quote_left_open_spoils_one_line() {
    let plain = String::from_utf8(recording(",")).unwrap();
    let mut lines: Vec<String> = plain.lines().map(str::to_owned).collect();
    lines.insert(1, "# by hand, \"open".to_owned());
    lines[3] = lines[3].replacen("up and down,1,", "\"up, down\",\"one\",", 1);
    lines[5] = lines[5].replacen("up and down", "\"up and down", 1);
    let found = read(&lines.join("\r\n"));
    assert_eq!(found.lines, [3, 5, 7, 8]);
    let said: Vec<(usize, &str)> = (found.bad.iter())
        .map(|bad| (bad.line, bad.reason.as_str()))
        .collect();
    let columns = NAMES.split(',').count();
    let cells = format!("2 cells; the header has {columns} columns");
    assert_eq!(
        said,
        [
            (4, "a is `one`; expected a finite number"),
            (6, cells.as_str())
        ]
    );
}

#[test]
fn names_with_separators_are_found_where_they_are_quoted() {
    let plain = String::from_utf8(recording(",")).unwrap();
    let map = include_str!("columns.toml").replacen("column = \"a\"", "column = \"a, left\"", 1);
    let columns: Columns = toml::from_str(&map).unwrap();
    let table = plain.replacen(",a,", ",\"a, left\",", 1);
    let found = RecordingFile::parse(table.as_bytes(), &columns, Path::new("r.csv")).unwrap();
    assert_eq!(found, read(&plain));
}
