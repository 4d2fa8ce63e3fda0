//! The rooms of the crates, as ARCHITECTURE.md lists them, against the files and what they import.
//!
//! A table under a heading `` ### `sim/src` `` lists a crate's rooms in building order. A room is a file or a folder. It may
//! use itself and the rooms and crates that its row names, which stand above it: so no arrow points up, and no circle goes
//! through two rooms. Calls of methods need no import and are not seen. Within rooms no circle goes through two [`files`],
//! and paths in the [`documents`] are there.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod documents;
mod files;
mod source;

use std::collections::BTreeSet;
use std::fs::{read_dir, read_to_string};
use std::path::Path;

use source::Source;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const MAP: &str = "ARCHITECTURE.md";
/// What the row of a room says that may use all rooms before it, and all crates.
const EVERYTHING: &str = "everything above";

/// What rows of other crates call the root package.
const FACADE: &str = "tdcr";

/// A crate of ours.
struct House {
    /// Folder of its sources, such as `sim/src`.
    folder: String,
    /// In building order.
    rooms: Vec<Room>,
    /// The files, by their modules: `net/layers/mod.rs` is `["net", "layers"]`.
    modules: Vec<(Vec<String>, String)>,
}

/// A row of the map.
struct Room {
    /// File or folder, such as `net/layers`.
    name: String,
    /// The rooms and crates that it may use; `None` for [`EVERYTHING`].
    uses: Option<Vec<String>>,
    /// Its line in the map.
    line: usize,
}

#[derive(Clone, Copy)]
enum Used<'a> {
    Room(usize),
    Crate(&'a str),
}

#[test]
fn the_map_has_every_crate() {
    let manifest = read_to_string(Path::new(ROOT).join("Cargo.toml")).unwrap();
    let members = manifest
        .split("members = [")
        .nth(1)
        .unwrap()
        .split(']')
        .next()
        .unwrap();
    let members = members.split('"').skip(1).step_by(2);
    // What lies in `tests` is no part of the house.
    let folders = members.filter(|member| !member.starts_with("tests/"));
    let folders: BTreeSet<String> = folders
        .map(|member| format!("{member}/src"))
        .chain(["src".to_owned()])
        .collect();
    let mapped: BTreeSet<String> = houses().into_iter().map(|house| house.folder).collect();
    assert_eq!(
        mapped, folders,
        "crates with a table of rooms in {MAP}, and crates of the workspace"
    );
}

#[test]
fn every_file_has_a_room_and_every_room_files() {
    let mut wrong = Vec::new();
    for house in houses() {
        let rooms: Vec<_> = house
            .modules
            .iter()
            .map(|(module, _)| house.room(module))
            .collect();
        for ((_, file), room) in house.modules.iter().zip(&rooms) {
            if room.is_none() {
                wrong.push(format!("{}/{file} is in no room of {MAP}", house.folder));
            }
        }
        for (index, room) in house.rooms.iter().enumerate() {
            if !rooms.contains(&Some(index)) {
                wrong.push(format!(
                    "{MAP}:{}: `{}` has no file in {}",
                    room.line, room.name, house.folder
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn rooms_name_rooms_above_them() {
    let mut wrong = Vec::new();
    let houses = houses();
    for house in &houses {
        for (index, room) in house.rooms.iter().enumerate() {
            for used in room.uses.iter().flatten() {
                let above = house.rooms[..index].iter().any(|other| other.name == *used);
                let facade = used == FACADE && !house.name().is_empty();
                if !above
                    && !facade
                    && !houses
                        .iter()
                        .any(|other| other.name() == used && other.name() != house.name())
                {
                    wrong.push(format!(
                        "{MAP}:{}: `{}` names `{used}`, which is no crate and no room above it",
                        room.line, room.name
                    ));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn imports_follow_the_map() {
    let mut wrong = Vec::new();
    let houses = houses();
    let crates: Vec<&str> = houses.iter().map(House::name).collect();
    for house in &houses {
        for (module, file, source) in house.sources() {
            let Some(own) = house.room(&module) else {
                continue;
            };
            for import in &source.imports {
                let Some(used) = house.used(&module, &import.path, &crates) else {
                    continue;
                };
                if !house.allows(own, used) {
                    wrong.push(format!(
                        "{}/{file}:{}: `{}` is of `{}`; {MAP}:{}: `{}` may use {}",
                        house.folder,
                        import.line,
                        import.path.join("::"),
                        house.name_of(used),
                        house.rooms[own].line,
                        house.rooms[own].name,
                        house.rooms[own]
                            .uses
                            .as_ref()
                            .map_or(EVERYTHING.to_owned(), |uses| uses.join(", ")),
                    ));
                }
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "{} imports break the map:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}

/// What the libraries say is a fact; which option of the command line helps, that alone adds (`src/cli/hint.rs`).
#[test]
fn no_text_of_a_library_names_an_option_of_the_command_line() {
    let (mut wrong, mut seen) = (Vec::new(), 0);
    for house in houses() {
        for (module, file, source) in house.sources() {
            let rooms_of_src = ["pipeline", "study", "pages", "track", "view", "reach"];
            let is_library = match house.name() {
                "base" | "sim" | "control" | "learn" | "hw" => true,
                "" => rooms_of_src.contains(&module[0].as_str()),
                _ => false,
            };
            // The options of training are clap's there.
            let is_command_line = house.name() == "learn" && module == ["options", "cli"];
            if !is_library || is_command_line {
                continue;
            }
            seen += source.texts.len();
            let named = source.texts.iter().filter(|(_, text)| names_option(text));
            wrong.extend(
                named.map(|(line, text)| format!("{}/{file}:{line}: {text}", house.folder)),
            );
        }
    }
    assert!(seen > 4000, "{seen} texts");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Whether a text has a word that begins as options do: `--out`.
fn names_option(text: &str) -> bool {
    let mut found = text.match_indices("--");
    found.any(|(at, _)| text[at + 2..].starts_with(|c: char| c.is_ascii_lowercase()))
}

#[test]
fn options_are_found_in_texts_and_not_in_comments_and_tests() {
    let source = Source::parse(
        "// \"--a\"\nconst A: &str = \"choose another (--out)\";\n#[cfg(test)]\nmod tests {\n\
         const B: &str = \"--b\";\n}\nconst C: &str = r#\"1 -- 2\"#;\n",
    );
    let lines: Vec<usize> = source.texts.iter().map(|(line, _)| *line).collect();
    assert_eq!(lines, [2, 7]);
    let named = source.texts.iter().map(|(_, text)| names_option(text));
    assert_eq!(named.collect::<Vec<_>>(), [true, false]);
}

/// The crates of the map with their files.
fn houses() -> Vec<House> {
    let text = read_to_string(Path::new(ROOT).join(MAP)).unwrap();
    let mut houses: Vec<House> = Vec::new();
    let mut in_table = false;
    for (line, text) in text
        .lines()
        .enumerate()
        .map(|(index, text)| (index + 1, text))
    {
        if text.starts_with('#') {
            in_table = text.starts_with("### `");
            if in_table {
                let folder = text.split('`').nth(1).unwrap().to_owned();
                let modules = modules(&folder);
                houses.push(House {
                    folder,
                    rooms: Vec::new(),
                    modules,
                });
            }
        } else if in_table && text.starts_with("| `") {
            let cells: Vec<&str> = text.trim_matches('|').split('|').map(str::trim).collect();
            let [name, uses, meaning] = cells[..] else {
                panic!("{MAP}:{line}: expected three cells")
            };
            assert!(
                !meaning.is_empty(),
                "{MAP}:{line}: expected what the room is"
            );
            let quoted = uses
                .split('`')
                .skip(1)
                .step_by(2)
                .map(str::to_owned)
                .collect();
            let room = Room {
                name: name.trim_matches('`').to_owned(),
                uses: (uses != EVERYTHING).then_some(quoted),
                line,
            };
            houses.last_mut().unwrap().rooms.push(room);
        }
    }
    houses
}

/// The modules and files of a folder, ordered.
fn modules(folder: &str) -> Vec<(Vec<String>, String)> {
    fn collect(folder: &Path, within: &str, out: &mut Vec<String>) {
        for entry in read_dir(folder.join(within)).unwrap() {
            let entry = entry.unwrap();
            let name = format!("{within}{}", entry.file_name().to_str().unwrap());
            if entry.file_type().unwrap().is_dir() {
                collect(folder, &format!("{name}/"), out);
            } else if name.ends_with(".rs") {
                out.push(name);
            }
        }
    }
    let mut files = Vec::new();
    collect(&Path::new(ROOT).join(folder), "", &mut files);
    files.sort();
    let module = |file: &String| {
        let path = file.strip_suffix(".rs").unwrap();
        let path = path.strip_suffix("/mod").unwrap_or(path);
        path.split('/').map(str::to_owned).collect()
    };
    files
        .iter()
        .map(|file| (module(file), file.clone()))
        .collect()
}

impl House {
    /// The crate's folder, and its name in rows: `sim`; empty for the root package.
    fn name(&self) -> &str {
        self.folder
            .strip_suffix("src")
            .unwrap()
            .trim_end_matches('/')
    }

    /// What the crate is called in imports.
    fn crate_name(&self) -> String {
        match self.name() {
            "" => FACADE.to_owned(),
            name => format!("tdcr_{name}"),
        }
    }

    /// The room that a module lies in: that of the most exact row.
    fn room(&self, module: &[String]) -> Option<usize> {
        let lies_in = |room: &Room| {
            let steps: Vec<&str> = room.name.split('/').collect();
            module.len() >= steps.len()
                && module
                    .iter()
                    .zip(steps)
                    .all(|(step, of_room)| step == of_room)
        };
        let rooms = self
            .rooms
            .iter()
            .enumerate()
            .filter(|(_, room)| lies_in(room));
        rooms
            .max_by_key(|(_, room)| room.name.len())
            .map(|(index, _)| index)
    }

    /// Files but tests, parsed.
    fn sources(&self) -> Vec<(Vec<String>, String, Source)> {
        let parsed: Vec<_> = (self.modules.iter())
            .map(|(module, file)| {
                let text = read_to_string(Path::new(ROOT).join(&self.folder).join(file)).unwrap();
                (module.clone(), file.clone(), Source::parse(&text))
            })
            .collect();
        let tests: Vec<Vec<String>> = (parsed.iter())
            .flat_map(|(module, _, source)| source.tests.iter().map(|name| child(module, name)))
            .collect();
        let is_test = |module: &[String]| tests.iter().any(|test| module.starts_with(test));
        parsed
            .into_iter()
            .filter(|(module, ..)| !is_test(module))
            .collect()
    }

    /// The other room or crate that an import of a module reaches; `None` for crates of others.
    fn used<'a>(&self, from: &[String], path: &[String], crates: &[&'a str]) -> Option<Used<'a>> {
        let other = |name: &str| {
            crates
                .iter()
                .find(|other| **other == name && **other != self.name() && !other.is_empty())
        };
        let first = path[0].as_str();
        let target = if let Some(name) = first.strip_prefix("tdcr_").and_then(other) {
            return Some(Used::Crate(name));
        } else if first == "crate"
            || first == FACADE
            || first.strip_prefix("tdcr_") == Some(self.name())
        {
            // The root package shows the other crates under their short names.
            if let Some(name) = path
                .get(1)
                .and_then(|name| other(name))
                .filter(|_| first == FACADE)
            {
                return Some(Used::Crate(name));
            }
            if first == FACADE && !self.name().is_empty() {
                return Some(Used::Crate(FACADE));
            }
            path[1..].to_vec()
        } else {
            let above = path.iter().take_while(|step| *step == "super").count();
            let rest = path[above..].iter().skip_while(|step| *step == "self");
            let own = if is_root(from) { &[] } else { from };
            let target: Vec<String> = own[..own.len().checked_sub(above)?]
                .iter()
                .chain(rest)
                .cloned()
                .collect();
            let is_relative = above > 0 || first == "self";
            // What starts with neither is a module within, or a crate of others.
            if !is_relative && !self.is_module(&target[..own.len() + 1]) {
                return None;
            }
            target
        };
        let module = (1..=target.len())
            .rev()
            .map(|end| &target[..end])
            .find(|module| self.is_module(module));
        let root = || {
            self.modules
                .iter()
                .map(|(module, _)| module.as_slice())
                .find(|module| is_root(module))
        };
        let room = self.room(module.or_else(root)?)?;
        (Some(room) != self.room(from)).then_some(Used::Room(room))
    }

    fn is_module(&self, module: &[String]) -> bool {
        self.modules.iter().any(|(other, _)| other == module)
    }

    fn allows(&self, own: usize, used: Used) -> bool {
        match (&self.rooms[own].uses, used) {
            (Some(uses), used) => uses.iter().any(|name| name == self.name_of(used)),
            (None, Used::Room(room)) => room < own,
            (None, Used::Crate(_)) => true,
        }
    }

    fn name_of<'a>(&'a self, used: Used<'a>) -> &'a str {
        match used {
            Used::Room(room) => &self.rooms[room].name,
            Used::Crate(name) => name,
        }
    }
}

/// Whether a file is the root of a crate: `lib.rs`, `main.rs`.
fn is_root(module: &[String]) -> bool {
    matches!(module, [only] if only == "lib" || only == "main")
}

fn child(module: &[String], name: &str) -> Vec<String> {
    let own = if is_root(module) { &[] } else { module };
    own.iter().cloned().chain([name.to_owned()]).collect()
}
