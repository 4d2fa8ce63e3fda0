//! Paths in the documents: those of files and folders of the repository are there.
//!
//! Every word of code, between backticks or in a block, counts as such a path that begins with one of our folders, or is a file
//! of Rust. Words in capitals stand for what a reader puts there: of `src/cli/COMMAND.rs` the folder is looked for.

use std::fs::{read_dir, read_to_string};
use std::path::{Path, PathBuf};

use super::ROOT;

/// Documents beside those in `docs/`.
const DOCUMENTS: [&str; 4] = [
    "README.md",
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
];
/// What paths of ours begin with.
const FOLDERS: [&str; 15] = [
    ".cargo",
    "base",
    "benches",
    "control",
    "docs",
    "examples",
    "fuzz",
    "hw",
    "learn",
    "models_xml",
    "python",
    "scripts",
    "sim",
    "src",
    "tests",
];
/// Where files of Rust lie.
const SOURCES: [&str; 10] = [
    "base",
    "benches",
    "control",
    "examples",
    "fuzz",
    "hw",
    "learn",
    "python/src",
    "sim",
    "src",
];

#[test]
fn paths_in_documents_are_there() {
    let mut wrong = Vec::new();
    let mut found = 0;
    for document in documents() {
        let text = read_to_string(Path::new(ROOT).join(&document)).unwrap();
        for (line, path) in paths(&text) {
            found += 1;
            if !is_there(&path) {
                wrong.push(format!("{document}:{line}: there is no {path}"));
            }
        }
    }
    assert!(found > 100, "found {found} paths in the documents");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn paths_are_words_of_code_that_begin_with_our_folders() {
    let text = "See `src/cli/COMMAND.rs`, `net/layers` and src/none.\n```\npython examples/a.py --out=run/x\nsim/src/lib.rs:12\n```\n`amx.rs`.";
    let expected = [
        (1, "src/cli/".to_owned()),
        (3, "examples/a.py".to_owned()),
        (4, "sim/src/lib.rs".to_owned()),
        (6, "amx.rs".to_owned()),
    ];
    assert_eq!(paths(text), expected);
    assert!(is_there("src/cli/") && is_there("amx.rs") && is_there("bfloat16/amx.rs"));
    assert!(!is_there("src/cli/none.rs") && !is_there("mx.rs") && !is_there("float32/amx.rs"));
}

fn documents() -> Vec<String> {
    let names = read_dir(Path::new(ROOT).join("docs")).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut pages: Vec<String> = (names.filter(|name| name.ends_with(".md")))
        .map(|name| format!("docs/{name}"))
        .collect();
    pages.sort();
    DOCUMENTS
        .map(str::to_owned)
        .into_iter()
        .chain(pages)
        .collect()
}

/// The paths in a document with their lines.
fn paths(text: &str) -> Vec<(usize, String)> {
    let mut paths = Vec::new();
    let mut in_block = false;
    for (line, text) in (1..).zip(text.lines()) {
        if text.starts_with("```") {
            in_block = !in_block;
            continue;
        }
        // Every other piece lies between backticks.
        let code: Vec<&str> = match in_block {
            true => vec![text],
            false => text.split('`').skip(1).step_by(2).collect(),
        };
        let is_apart = |c: char| !(c.is_ascii_alphanumeric() || "_./-*".contains(c));
        let words = code.into_iter().flat_map(|code| code.split(is_apart));
        let found = words.filter_map(path);
        paths.extend(found.map(|path| (line, path)));
    }
    paths
}

/// The path that a word is, up to what stands for something.
fn path(word: &str) -> Option<String> {
    let word = word.trim_end_matches('.');
    let stands_for = |step: &&str| {
        let letters: Vec<char> = step.chars().take_while(|c| *c != '.').collect();
        step.contains('*') || letters.iter().filter(|c| c.is_ascii_uppercase()).count() > 2
    };
    let steps: Vec<&str> = word.split('/').collect();
    let is_ours = steps.len() > 1 && FOLDERS.contains(&steps[0]);
    let place = steps.iter().position(stands_for);
    match place {
        Some(place) => is_ours.then(|| steps[..place].join("/") + "/"),
        None => (is_ours || word.ends_with(".rs") && word != ".rs").then(|| word.to_owned()),
    }
}

fn is_there(path: &str) -> bool {
    let root = Path::new(ROOT);
    // A page of a table of contents is named without its ending, from the folder of the documents.
    if root.join(path).exists() || root.join(format!("docs/{path}.md")).exists() {
        return true;
    }
    let is_ours = path
        .split_once('/')
        .is_some_and(|(first, _)| FOLDERS.contains(&first));
    !is_ours
        && SOURCES
            .iter()
            .any(|folder| holds(&root.join(folder), Path::new(path)))
}

/// Whether a folder has a file whose path ends so.
fn holds(folder: &Path, end: &Path) -> bool {
    let Ok(entries) = read_dir(folder) else {
        return false;
    };
    let mut entries = entries.map(|entry| entry.unwrap().path());
    entries.any(|path: PathBuf| match path.is_dir() {
        true => holds(&path, end),
        false => path.ends_with(end),
    })
}
