//! What a Rust file imports, as far as plain reading tells: `use` declarations, and paths that start with `crate`, `super`,
//! `self` or a crate of ours; and its texts. Tests within the file are left out.

use std::ops::Range;

/// A file, read.
pub struct Source {
    pub imports: Vec<Import>,
    /// Modules in files of their own that are compiled for tests only.
    pub tests: Vec<String>,
    /// The literals of strings, with the line in which each begins.
    pub texts: Vec<(usize, String)>,
}

/// A path to something elsewhere.
pub struct Import {
    /// From 1.
    pub line: usize,
    /// Its steps, as seen from the file's own module.
    pub path: Vec<String>,
    /// What it is called in this file, of a `use` declaration.
    pub name: Option<String>,
    /// Whether others see it here: `pub use`.
    pub is_door: bool,
}

impl Source {
    pub fn parse(text: &str) -> Self {
        let (mut code, strings) = code(text);
        let (tests, removed) = remove_tests(&mut code);
        let text: Vec<char> = text.chars().collect();
        let line_of = |at: usize| 1 + code[..at].iter().filter(|c| **c == '\n').count();
        let texts = strings
            .into_iter()
            .filter(|string| !removed.iter().any(|test| test.contains(&string.start)))
            .map(|string| (line_of(string.start), text[string].iter().collect()))
            .collect();
        let within = inline_modules(&code);
        let mut imports = Vec::new();
        let mut at = 0;
        while let Some(start) = (at..code.len()).find(|at| starts_word(&code, *at)) {
            let word = word(&code, start);
            at = start + word.len();
            let (mut paths, mut is_door) = (Vec::new(), false);
            if word == "use" {
                let end = (at..code.len())
                    .find(|at| code[*at] == ';')
                    .unwrap_or(code.len());
                let tree: String = code[at..end].iter().collect();
                expand(&tree, &[], &mut paths);
                is_door = is_public(&code[..start]);
                at = end;
            } else if is_path_root(&word) && !is_visibility(&code[..start]) {
                let mut path = vec![word];
                while code[at..].starts_with(&[':', ':']) && starts_word(&code, at + 2) {
                    path.push(self::word(&code, at + 2));
                    at += 2 + path[path.len() - 1].len();
                }
                if path.len() > 1 {
                    paths.push((path, None));
                }
            }
            if paths.is_empty() {
                continue;
            }
            let line = line_of(start);
            // Within a module of this file, `super` is the file's own module.
            let depth = within.iter().filter(|range| range.contains(&start)).count();
            for (mut path, name) in paths {
                let above = path
                    .iter()
                    .take_while(|step| *step == "super")
                    .count()
                    .min(depth);
                path.drain(..above);
                if !path.is_empty() && above == 0
                    || path.first().is_some_and(|step| step == "super")
                {
                    imports.push(Import {
                        line,
                        path,
                        name,
                        is_door,
                    });
                }
            }
        }
        Self {
            imports,
            tests,
            texts,
        }
    }
}

/// The text with blanks for comments and literals, and where the strings were.
fn code(text: &str) -> (Vec<char>, Vec<Range<usize>>) {
    let mut code: Vec<char> = text.chars().collect();
    let mut strings = Vec::new();
    let mut at = 0;
    while at < code.len() {
        let rest = &code[at..];
        let length = match rest {
            ['/', '/', ..] => rest.iter().position(|c| *c == '\n').unwrap_or(rest.len()),
            ['/', '*', ..] => block_comment(rest),
            ['"', ..] => string(rest),
            ['r', '"' | '#', ..] if starts_word(&code, at) || code[at - 1] == 'b' => {
                raw_string(rest)
            }
            ['\'', '\\', _, ..] => 3 + rest[3..].iter().position(|c| *c == '\'').unwrap_or(0) + 1,
            ['\'', _, '\'', ..] => 3,
            _ => 0,
        };
        if length > 0 && matches!(rest[0], '"' | 'r') {
            strings.push(at..at + length);
        }
        for c in &mut code[at..at + length] {
            if *c != '\n' {
                *c = ' ';
            }
        }
        at += length.max(1);
    }
    (code, strings)
}

fn block_comment(rest: &[char]) -> usize {
    let mut depth = 0;
    let mut at = 0;
    while at < rest.len() {
        match &rest[at..] {
            ['/', '*', ..] => (depth, at) = (depth + 1, at + 2),
            ['*', '/', ..] => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            break;
        }
    }
    at
}

fn string(rest: &[char]) -> usize {
    let mut at = 1;
    while at < rest.len() && rest[at] != '"' {
        at += if rest[at] == '\\' { 2 } else { 1 };
    }
    (at + 1).min(rest.len())
}

/// Length of a raw string, 0 where none begins.
fn raw_string(rest: &[char]) -> usize {
    let hashes = rest[1..].iter().take_while(|c| **c == '#').count();
    if rest.get(1 + hashes) != Some(&'"') {
        return 0;
    }
    let end: Vec<char> = std::iter::once('"')
        .chain(std::iter::repeat_n('#', hashes))
        .collect();
    let body = &rest[hashes + 2..];
    let length = body.windows(end.len()).position(|window| window == end);
    length.map_or(rest.len(), |length| hashes + 2 + length + end.len())
}

/// Blanks what is compiled for tests only; the names of modules among it that are in other files, and where all of it was.
fn remove_tests(code: &mut [char]) -> (Vec<String>, Vec<Range<usize>>) {
    let mark: Vec<char> = "#[cfg(test)]".chars().collect();
    let (mut tests, mut removed) = (Vec::new(), Vec::new());
    while let Some(start) = code.windows(mark.len()).position(|window| window == mark) {
        let end = end_of_item(code, start);
        let item: String = code[start + mark.len()..end].iter().collect();
        if let Some((_, name)) = item
            .trim_end_matches(';')
            .rsplit_once("mod ")
            .filter(|_| item.ends_with(';'))
        {
            tests.push(name.trim().to_owned());
        }
        code[start..end]
            .iter_mut()
            .filter(|c| **c != '\n')
            .for_each(|c| *c = ' ');
        removed.push(start..end);
    }
    (tests, removed)
}

/// The end of the item at `start`: past its last brace, or its semicolon.
fn end_of_item(code: &[char], start: usize) -> usize {
    let mut depth = 0;
    for (at, c) in code.iter().enumerate().skip(start) {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 && matches!(c, ';' | '}') {
            return at + 1;
        }
    }
    code.len()
}

/// Where modules within the file are.
fn inline_modules(code: &[char]) -> Vec<Range<usize>> {
    let starts = (0..code.len()).filter(|at| starts_word(code, *at) && word(code, *at) == "mod");
    let ranges = starts.map(|start| start..end_of_item(code, start));
    ranges.filter(|range| code[range.end - 1] == '}').collect()
}

fn is_path_root(word: &str) -> bool {
    matches!(word, "crate" | "super" | "self" | "tdcr") || word.starts_with("tdcr_")
}

/// Whether the declaration that follows has a `pub` before it.
fn is_public(before: &[char]) -> bool {
    let start = before.iter().rposition(|c| matches!(c, ';' | '{' | '}'));
    let before: String = before[start.map_or(0, |at| at + 1)..].iter().collect();
    let last = before.lines().next_back().unwrap_or_default().trim_start();
    last.starts_with("pub")
}

/// Whether what follows is the place in `pub(in place)`.
fn is_visibility(before: &[char]) -> bool {
    let before: String = before.iter().rev().take(8).rev().collect();
    before.trim_end().ends_with("(in")
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Whether a word starts at `at` that is not a later step of a path.
fn starts_word(code: &[char], at: usize) -> bool {
    let before = at.checked_sub(1).map(|before| code[before]);
    code.get(at).is_some_and(|c| is_word(*c)) && !before.is_some_and(is_word)
}

fn word(code: &[char], at: usize) -> String {
    code[at..].iter().take_while(|c| is_word(**c)).collect()
}

/// The paths of a `use` declaration with their names: `a::{b, c::d as e}` is `a::b`, called `b`, and `a::c::d`, called `e`.
fn expand(tree: &str, above: &[String], paths: &mut Vec<(Vec<String>, Option<String>)>) {
    let steps = |text: &str| -> Vec<String> {
        let text = text.split(" as ").next().unwrap_or_default();
        let steps = text
            .split("::")
            .map(str::trim)
            .filter(|step| !step.is_empty());
        above
            .iter()
            .cloned()
            .chain(steps.map(str::to_owned))
            .collect()
    };
    let Some((before, inner)) = tree.split_once('{') else {
        let mut path = steps(tree);
        if path.len() > above.len() {
            // `a::{self}` is `a`.
            path.truncate(
                path.len() - usize::from(path.len() > 1 && path.ends_with(&["self".to_owned()])),
            );
            let renamed = tree
                .split_once(" as ")
                .map(|(_, name)| name.trim().to_owned());
            let name = renamed.or_else(|| path.last().cloned());
            paths.push((path, name));
        }
        return;
    };
    let above = steps(before);
    let inner = inner.rsplit_once('}').map_or(inner, |(inner, _)| inner);
    let (mut depth, mut start) = (0, 0);
    for (at, c) in inner.char_indices().chain([(inner.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                expand(&inner[start..at], &above, paths);
                start = at + 1;
            }
            _ => {}
        }
    }
}
