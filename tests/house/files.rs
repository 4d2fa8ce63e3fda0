//! The files of a crate among each other: no circle of imports goes through two of them, and one convention says where a module
//! with others below it lies.
//!
//! A name that a module shows by `pub use` counts as an import of the file that it comes from: what goes through the door of a
//! room is seen. A module and those below it may use each other: `mod.rs` has what its files share, and puts them together.

use std::collections::{BTreeMap, BTreeSet};

use super::source::Source;
use super::{House, houses, is_root};

/// Most re-exports that lead from a name to its file.
const DOORS: usize = 8;

/// A crate's files that are no tests, by their modules, and who imports whom in which line.
struct Files {
    sources: BTreeMap<Vec<String>, (String, Source)>,
    arrows: BTreeMap<Vec<String>, BTreeMap<Vec<String>, usize>>,
}

impl Files {
    fn of(house: &House) -> Self {
        let sources = (house.sources().into_iter())
            .map(|(module, file, source)| (module, (file, source)))
            .collect();
        let mut files = Self {
            sources,
            arrows: BTreeMap::new(),
        };
        for (module, (_, source)) in &files.sources {
            let mut arrows = BTreeMap::new();
            for import in source.imports.iter().filter(|import| !import.is_door) {
                let target = files.target(house, module, &import.path, 0);
                if let Some(target) = target.filter(|target| !is_kin(module, target)) {
                    arrows.entry(target).or_insert(import.line);
                }
            }
            files.arrows.insert(module.clone(), arrows);
        }
        files
    }

    /// The module whose file a path from `module` leads to, through re-exports; `None` outside the crate.
    fn target(
        &self,
        house: &House,
        module: &[String],
        path: &[String],
        doors: usize,
    ) -> Option<Vec<String>> {
        let own: &[String] = if is_root(module) { &[] } else { module };
        let above = path.iter().take_while(|step| *step == "super").count();
        let absolute: Vec<String> = if path[0] == "crate" || path[0] == house.crate_name() {
            path[1..].to_vec()
        } else {
            let rest = path[above..].iter().skip_while(|step| *step == "self");
            let all = own[..own.len().checked_sub(above)?].iter().chain(rest);
            let all: Vec<String> = all.cloned().collect();
            let is_relative = above > 0 || path[0] == "self";
            if !is_relative && !self.sources.contains_key(&all[..own.len() + 1]) {
                return None;
            }
            all
        };
        let root = || self.sources.keys().find(|module| is_root(module)).cloned();
        let end = (1..=absolute.len())
            .rev()
            .find(|end| self.sources.contains_key(&absolute[..*end]));
        let found = match end {
            Some(end) => absolute[..end].to_vec(),
            None => root()?,
        };
        let Some(name) = absolute.get(end.unwrap_or(0)) else {
            return Some(found);
        };
        let mut imports = self.sources[&found].1.imports.iter();
        match imports.find(|import| import.name.as_ref() == Some(name)) {
            // A name of another crate is none of ours.
            Some(import) if doors < DOORS => self.target(house, &found, &import.path, doors + 1),
            _ => Some(found),
        }
    }

    /// The modules that imports lead to from `start`, in any number of steps.
    fn reached<'a>(&'a self, start: &'a [String]) -> BTreeSet<&'a [String]> {
        let mut reached = BTreeSet::new();
        let mut next = vec![start];
        while let Some(module) = next.pop() {
            for target in self.arrows[module].keys() {
                if reached.insert(target.as_slice()) {
                    next.push(target);
                }
            }
        }
        reached
    }

    /// The arrows between modules that lead to each other, as lines of text.
    fn circles(&self, house: &House) -> Vec<String> {
        let reached: BTreeMap<&[String], _> = (self.sources.keys())
            .map(|module| (module.as_slice(), self.reached(module)))
            .collect();
        let mut lines = Vec::new();
        for (from, arrows) in &self.arrows {
            for (to, line) in arrows {
                if reached[to.as_slice()].contains(from.as_slice()) {
                    let file = &self.sources[from].0;
                    let to = &self.sources[to].0;
                    lines.push(format!("{}/{file}:{line} uses {to}", house.folder));
                }
            }
        }
        lines
    }
}

/// Whether one of two modules is the other, or lies above it.
fn is_kin(a: &[String], b: &[String]) -> bool {
    is_root(a) || is_root(b) || a.starts_with(b) || b.starts_with(a)
}

#[test]
fn no_circle_goes_through_two_files() {
    let mut lines = Vec::new();
    for house in houses() {
        let files = Files::of(&house);
        lines.extend(files.circles(&house));
    }
    assert!(
        lines.is_empty(),
        "{} imports are parts of circles:\n{}",
        lines.len(),
        lines.join("\n")
    );
}

#[test]
fn a_module_with_others_below_it_is_the_mod_rs_of_their_folder() {
    let mut wrong = Vec::new();
    for house in houses() {
        let files: BTreeSet<&String> = house.modules.iter().map(|(_, file)| file).collect();
        for file in &files {
            let Some((folder, _)) = file.rsplit_once('/') else {
                continue;
            };
            if files.contains(&format!("{folder}.rs")) {
                wrong.push(format!(
                    "{0}/{folder}.rs lies beside {0}/{folder}/; expected {0}/{folder}/mod.rs",
                    house.folder
                ));
            }
        }
    }
    wrong.dedup();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
