//! Tables of commands as spreadsheets and other programs write them.

use std::fs;

use crate::{refuse, succeed_json, text};

#[test]
fn a_table_of_commands_is_the_same_however_it_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("commands.csv");
    let settle = |table: &str| {
        fs::write(&file, table).unwrap();
        succeed_json(&["settle", "--commands", text(&file)])
    };
    let header = "c0 (m),c1 (m),c2 (m),c3 (m),c4 (m),c5 (m),payload (kg)";
    let rows = ["0.01,0,0,0.01,0,0,0.01", "0,0.02,0,0,0,0,0"];
    let plain = settle(&[header, rows[0], rows[1], ""].join("\n"));
    let quoted = |line: &str| format!("\"{}\"", line.replace(',', "\",\""));
    let noted = |line: &str, note: &str| {
        let (command, payload) = line.rsplit_once(',').unwrap();
        format!("{command},{note},{payload}")
    };
    let quotes = [header, rows[0], rows[1]].map(quoted);
    let notes = [
        noted(header, "\"note, by hand\""),
        "# by hand, \"so".to_owned(),
        noted(rows[0], "\"a, b\""),
        noted(rows[1], ""),
    ];
    for table in [
        [header, rows[0], rows[1]].join("\r\n"),
        quotes.join("\r\n") + "\r\n\r\n",
        [header.replace(',', " , "), rows.join("\n\n")].join("\n \n"),
        format!("\u{feff}{}", notes.join("\n")),
    ] {
        assert_eq!(settle(&table), plain, "{table}");
    }
    let wrong = [header, "", rows[0], &rows[1].replace("0.02", "\"0,02\"")].join("\r\n");
    fs::write(&file, wrong).unwrap();
    refuse(
        &["settle", "--commands", text(&file)],
        1,
        "commands.csv line 4: `0,02` is not a number",
    );
}
