//! The options of training as Python's type checkers see them: a file written from those of the command line.

use std::fmt::Write;
use std::path::Path;

use tdcr::learn::options::cli::{Kind, OptionInfo, options};

const FILE: &str = "python/tdcr/_train_options.py";
/// Set, the file is written in place of compared.
const UPDATE: &str = "UPDATE_OPTIONS";
/// Longest line of the Python package.
const WIDTH: usize = 130;

#[test]
fn python_has_the_options_of_training() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(FILE);
    let expected = module(&options());
    if std::env::var_os(UPDATE).is_some() {
        std::fs::write(&path, &expected).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap();
    assert!(
        found == expected,
        "{FILE} is not that of learn/src/options; to write it: \
         {UPDATE}=1 cargo test --release --test cli python_options"
    );
}

/// The Python module.
fn module(options: &[OptionInfo]) -> String {
    let mut out = format!(
        "\"\"\"Options of training, written from `learn/src/options/mod.rs` by\n\
         `{UPDATE}=1 cargo test --release --test cli python_options`.\n\"\"\"\n\n\
         from collections.abc import Sequence\n\
         from typing import Any, Literal, TypedDict\n\n\
         from tdcr.data import PathLike\n\
         from tdcr.robot import Robot\n\n\n\
         class TrainOptions(TypedDict, total=False):\n    \
         \"\"\"Options of :func:`tdcr.train`: those of ``tdcr train``; None is the default.\"\"\"\n"
    );
    for option in options {
        let kind = python_type(option);
        writeln!(out, "\n    {}: {kind} | None", option.name).unwrap();
        out.push_str(&docstring(&about(option)));
    }
    out
}

fn python_type(option: &OptionInfo) -> String {
    match option.kind {
        Kind::Count => "int".to_owned(),
        Kind::Counts => "Sequence[int]".to_owned(),
        Kind::Number => "float".to_owned(),
        Kind::Flag => "bool".to_owned(),
        Kind::Text => "str".to_owned(),
        Kind::File => "PathLike".to_owned(),
        Kind::Robot => "Robot | PathLike | dict[str, Any]".to_owned(),
        Kind::Choice => {
            let names = option.choices.iter().map(|name| format!("\"{name}\""));
            format!("Literal[{}]", names.collect::<Vec<_>>().join(", "))
        }
    }
}

/// The help of an option with its default, where other options have their Python names.
fn about(option: &OptionInfo) -> String {
    let words = option.help.split(' ').map(|word| {
        let Some(rest) = word.strip_prefix("--") else {
            return word.to_owned();
        };
        let end = rest.find(|letter: char| !letter.is_ascii_lowercase() && letter != '-');
        let (name, after) = rest.split_at(end.unwrap_or(rest.len()));
        let name = name.replace('-', "_");
        match options().iter().any(|other| other.name == name) {
            true => format!("``{name}``{after}"),
            false => word.to_owned(),
        }
    });
    let help = words
        .collect::<Vec<_>>()
        .join(" ")
        .replace('`', "``")
        .replace("````", "``");
    match &option.default {
        serde_json::Value::Null => help,
        default => format!(
            "{help} [default: {}]",
            default.to_string().trim_matches('"')
        ),
    }
}

/// A text as the docstring of a field.
fn docstring(text: &str) -> String {
    const INDENT: &str = "    ";
    let mut lines = vec![format!("{INDENT}\"\"\"")];
    for (index, word) in text.split(' ').enumerate() {
        let last = lines.last_mut().unwrap();
        if last.len() + 1 + word.len() + 3 > WIDTH {
            lines.push(format!("{INDENT}{word}"));
        } else {
            last.push_str(if index == 0 { "" } else { " " });
            last.push_str(word);
        }
    }
    format!("{}\"\"\"\n", lines.join("\n"))
}
