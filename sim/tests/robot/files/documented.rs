//! `docs/robot-files.md` against the reader: its fields, types, defaults and accepted values.
//!
//! A section of the page is a table of a robot file, by its path; `[]` is an element of a list. Its TOML, put at that path in
//! the page's complete robot, is the file in which the section's fields are tried.

use std::collections::BTreeSet;

use tdcr_sim::formats::RobotFileError;
use toml::{Table, Value};

use super::load;
use super::page::{Row, Section, at, document, ends, quoted, robot, sections, value};

/// Values for fields whose accepted values are not an interval: some to accept, some to refuse.
const SAMPLES: &[(&str, &[&str], &[&str])] = &[
    ("name", &["''", "'a b'"], &["1"]),
    ("modules", &[], &["[]"]),
    (
        "base.orientation",
        &["[0, 0, 0, -2]"],
        &["[0, 0, 0, 0]", "[nan, 0, 0, 1]"],
    ),
    ("modules[].length", &["1e-3", "5e3"], &["0", "5.1e3"]),
    (
        "modules[].rod",
        &[],
        &["{ youngs = 1e15, poisson = 0, radius = 1e3, density = 0 }"],
    ),
    (
        "modules[].tendons.range",
        &["[0, 1e15]", "[0.1, 0.2]"],
        &["[-0.1, 1]", "[1, 1]", "[2, 1]", "[0, 2e15]"],
    ),
    (
        "routes[].tendon.range",
        &["[0, 1e15]", "[0.1, 0.2]"],
        &["[-0.1, 1]", "[1, 1]", "[2, 1]", "[0, 2e15]"],
    ),
    (
        "routes[].through",
        &["[['base', 2], [4, 2]]", "[[4, 0], ['base', 0]]"],
        &[
            "[]",
            "[['base', 0]]",
            "[['base', 0], ['base', 1]]",
            "[['base', 0], [5, 0]]",
            "[['base', 0], [0, 3]]",
            "[['tip', 0], [0, 0]]",
        ],
    ),
    ("cameras[].aim.at", &["[0, 0, 0]"], &["[0.4, 0.0, 0.3]"]),
    (
        "cameras[].aim.orientation",
        &["[0, 0, 0, -2]"],
        &["[0, 0, 0, 0]"],
    ),
    ("cameras.distortion.k1", &["0.1"], &["-10.0", "nan"]),
    ("cameras.distortion.k2", &["0.1"], &["-100.0", "nan"]),
    ("cameras.distortion.p1", &["0.001"], &["10.0", "nan"]),
    ("cameras.distortion.p2", &["0.001"], &["10.0", "nan"]),
    ("cameras.distortion.k3", &["0.1"], &["-1000.0", "nan"]),
    ("cameras[].distortion.k1", &["0.1"], &["-10.0", "nan"]),
    ("cameras[].distortion.k2", &["0.1"], &["-100.0", "nan"]),
    ("cameras[].distortion.p1", &["0.001"], &["10.0", "nan"]),
    ("cameras[].distortion.p2", &["0.001"], &["10.0", "nan"]),
    ("cameras[].distortion.k3", &["0.1"], &["-1000.0", "nan"]),
];

/// What the reader says that it expects where it finds `true`.
const TYPES: &[(&str, &str)] = &[
    ("text", "expected a string"),
    ("integer", "expected usize"),
    ("number", "expected f64"),
    ("2 integers", "expected an array of length 2"),
    ("2 numbers", "expected an array of length 2"),
    ("3 numbers", "expected an array of length 3"),
    ("4 numbers", "expected an array of length 4"),
    (
        "3 numbers, or z",
        "expected [x, y, z] in metres, or the height z alone",
    ),
    ("list of numbers", "expected a sequence"),
    ("list of tables", "expected a sequence"),
    ("list of [body, hole]", "expected a sequence"),
    (
        "list of [x, y], or table",
        "expected a list of [x, y] in metres, or {",
    ),
    (
        "number, or per disc",
        "expected one value, or a list with one per disc",
    ),
    (
        "table, or per disc",
        "expected one value, or a list with one per disc",
    ),
    ("table", "expected struct "),
    (
        "table, or list of tables",
        "expected a table with a ring of cameras, or a list",
    ),
    ("one of", "wanted string or table"),
];

fn said(document: &Value) -> String {
    load("toml", &toml::to_string(document).unwrap())
        .unwrap_err()
        .to_string()
}

fn is_read(document: &Value) -> bool {
    let loaded = load("toml", &toml::to_string(document).unwrap());
    // What is refused must be the value, not what else the file looks like.
    if let Err(error) = &loaded {
        assert!(!matches!(error, RobotFileError::Missing { .. }), "{error}");
        for other in ["unknown field", "given beside", "are given", "duplicate"] {
            assert!(!error.to_string().contains(other), "{error}");
        }
    }
    loaded.is_ok()
}

#[test]
fn the_complete_robot_of_the_page_is_one() {
    let toml = toml::to_string(&robot()).unwrap();
    let json = serde_json::to_string(&robot()).unwrap();
    let spec = load("toml", &toml).unwrap();
    assert_eq!(load("json", &json).unwrap(), spec);
    let robot = tdcr_sim::robot::Robot::new(spec).unwrap();
    let command = robot.command(&[0.07, 0.08, 0.08]).unwrap();
    assert!(robot.settle(&command, &Default::default()).converged);
}

#[test]
fn the_page_has_the_fields_that_are_read_and_no_others() {
    let sections = sections();
    let mut documented = BTreeSet::new();
    for section in &sections {
        let fields: BTreeSet<&str> = section
            .rows
            .iter()
            .map(|row| row.field.trim_matches('"'))
            .collect();
        assert_eq!(fields.len(), section.rows.len(), "{:?}", section.paths);
        for path in &section.paths {
            assert!(documented.insert(path.to_string()), "{path} stands twice");
            let mut document = document(&sections, path);
            assert!(is_read(&document), "{path}: {}", said(&document));
            let mut unknown = Table::new();
            unknown.insert("zz".to_owned(), Value::Boolean(true));
            match at(&mut document, path) {
                Value::Table(table) if !section.is_choice() => table.extend(unknown),
                choice => *choice = Value::Table(unknown),
            }
            let message = said(&document);
            let valid = message.split("`zz`, expected ").nth(1);
            let valid = quoted(valid.unwrap_or_else(|| panic!("{path}: {message}")));
            assert_eq!(BTreeSet::from_iter(valid), fields, "`{path}`");
        }
    }
    // Each table within a table has a section, and each section such a place.
    let mut within = BTreeSet::from([String::new()]);
    for section in &sections {
        for (path, row) in section
            .paths
            .iter()
            .flat_map(|p| section.rows.iter().map(move |r| (p, r)))
        {
            let join = if path.is_empty() { "" } else { "." };
            let full = format!("{path}{join}{}", row.field);
            if row.kind == "one of" || row.kind.contains("table") && row.kind != "list of tables" {
                within.insert(full.clone());
            }
            if row.kind.contains("list of tables") {
                within.insert(format!("{full}[]"));
            }
        }
    }
    assert_eq!(documented, within);
}

#[test]
fn the_page_has_the_types_that_are_read() {
    for_each_row(|section, path, row, document| {
        if row.kind == "value" {
            assert!(is_read(&section.with(
                document,
                path,
                row,
                &Value::Boolean(true)
            )));
            return;
        }
        let message = said(&section.with(document, path, row, &Value::Boolean(true)));
        let (_, expected) = (TYPES.iter().find(|(kind, _)| *kind == row.kind))
            .unwrap_or_else(|| panic!("`{path}.{}`: no type `{}`", row.field, row.kind));
        assert!(
            message.contains(expected),
            "`{path}.{}`: {message}",
            row.field
        );
    });
}

#[test]
fn the_page_has_the_defaults_of_what_is_left_out() {
    for_each_row(|section, path, row, document| {
        let full = format!("{path}.{}", row.field);
        if section.is_choice() {
            return;
        }
        let mut without = document.clone();
        let table = at(&mut without, path).as_table_mut().unwrap();
        table.remove(row.field);
        let read = |document: &Value| load("toml", &toml::to_string(document).unwrap());
        if row.default.starts_with("required") {
            for other in row.alternatives() {
                table.remove(other);
            }
            let error = read(&without).unwrap_err();
            assert!(
                matches!(error, RobotFileError::Missing { .. }),
                "{full}: {error}"
            );
            assert!(
                error.to_string().contains(&format!("`{}`", row.field)),
                "{full}: {error}"
            );
            return;
        }
        if row.default.starts_with("in place of") {
            // One of the two is enough, both are too many.
            let mut both = document.clone();
            let table = at(&mut both, path).as_table_mut().unwrap();
            for name in [row.field, row.alternatives()[0]] {
                let kind = section.rows.iter().find(|row| row.field == name).unwrap();
                table.insert(name.to_owned(), kind.values(0.1, None).remove(0));
            }
            let error = read(&both).unwrap_err().to_string();
            assert!(
                error.contains(&format!("`{}`", row.field)),
                "{full}: {error}"
            );
            return;
        }
        let spec = read(&without).unwrap_or_else(|error| panic!("{full}: {error}"));
        match quoted(row.default)[..] {
            // `cameras_that_a_file_leaves_out_stand_around_the_robot_in_the_papers_proportions`.
            [] if row.field == "cameras" => {}
            [] => {
                assert_eq!(row.default, "none", "{full}");
                let mut written = Value::try_from(&spec).unwrap();
                let written = at(&mut written, path).as_table().unwrap();
                assert!(!written.contains_key(row.field), "{full}");
            }
            [default] => {
                let table = at(&mut without, path).as_table().unwrap();
                let value = table.get(default).cloned().or_else(|| value(default));
                let value = value.unwrap_or_else(|| panic!("{full}: no value `{default}`"));
                let with = section.with(document, path, row, &value);
                assert_eq!(read(&with).unwrap(), spec, "{full}");
            }
            _ => panic!("{full}: default {}", row.default),
        }
    });
}

#[test]
fn the_page_has_the_values_that_are_accepted() {
    let mut samples: BTreeSet<&str> = SAMPLES.iter().map(|(path, ..)| *path).collect();
    for_each_row(|section, path, row, document| {
        let full = format!("{path}.{}", row.field);
        let full = full.trim_start_matches('.');
        let try_out = |value: &Value, expected: bool| {
            let mut document = document.clone();
            if full == "modules[].rod.radius" {
                // So that the stiffness is not what is refused.
                at(&mut document, path)["youngs"] = Value::Float(1e-60);
            }
            let document = section.with(document, path, row, value);
            let read = is_read(&document);
            assert_eq!(
                read,
                expected,
                "{full} = {value}\n{}",
                toml::to_string(&document).unwrap()
            );
        };
        if let Some([within, beyond]) = ends(row.accepted, row.kind.contains("integer")) {
            let mut document = document.clone();
            let before = at(&mut document, path).as_table();
            let before = before.and_then(|table| table.get(row.field));
            for (numbers, expected) in [(within, true), (beyond, false)] {
                for number in numbers {
                    for value in row.values(number, before) {
                        try_out(&value, expected);
                    }
                }
            }
        } else if let Some((path, accepted, refused)) = SAMPLES.iter().find(|(p, ..)| *p == full) {
            samples.remove(path);
            for (texts, expected) in [(accepted, true), (refused, false)] {
                for text in *texts {
                    try_out(&value(text).unwrap(), expected);
                }
            }
        } else {
            // A table, or one of several: their fields have sections of their own.
            assert!(
                row.accepted.is_empty(),
                "{full}: nothing tries `{}`",
                row.accepted
            );
            let own = ["table", "one of", "value"]
                .iter()
                .any(|kind| row.kind.contains(kind));
            assert!(own, "{full}: no accepted values");
        }
    });
    assert!(samples.is_empty(), "not on the page: {samples:?}");
}

/// Each field of each section at each of its paths, with a file that has the section's table there.
fn for_each_row(mut check: impl FnMut(&Section, &str, &Row, Value)) {
    let sections = sections();
    assert!(sections.len() > 15);
    for section in &sections {
        for path in &section.paths {
            for row in &section.rows {
                check(section, path, row, document(&sections, path));
            }
        }
    }
}
