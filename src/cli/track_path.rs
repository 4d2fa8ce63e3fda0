//! Files of paths in time.

use std::path::Path;

use anyhow::{Context, bail};
use tdcr::base::files::{LARGEST_TEXT, read_text};
use tdcr::base::rows::Splitter;

/// Reads rows of `t, x, y, z` (s, m) from CSV. Its first line may name the columns, units behind the names (`t (s)`); they are then found
/// among others. Empty lines and lines that begin with `#` are passed over.
pub(super) fn read_path(file: &Path) -> anyhow::Result<Vec<[f64; 4]>> {
    let name = file.display();
    let text =
        read_text(file, LARGEST_TEXT).with_context(|| format!("cannot read a path from {name}"))?;
    let mut splitter = Splitter::new(b',');
    let mut places = None;
    let mut rows = Vec::new();
    for (index, line) in text.lines().enumerate() {
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        let cells = splitter.trimmed(line);
        let at = || format!("{name}, line {}", index + 1);
        let places: &[usize; 4] = match &mut places {
            Some(places) => places,
            none => {
                let named = cells.iter().any(|cell| cell.parse::<f64>().is_err());
                let found = match named {
                    true => columns(&cells).with_context(at)?,
                    false => [0, 1, 2, 3],
                };
                let found = none.insert(found);
                if named {
                    continue;
                }
                found
            }
        };
        let mut row = [0.0; 4];
        for (value, &place) in row.iter_mut().zip(places) {
            let Some(cell) = cells.get(place) else {
                bail!(
                    "{}: {} cells; expected a time and x, y, z (s, m)",
                    at(),
                    cells.len()
                );
            };
            *value =
                (cell.parse()).with_context(|| format!("{}: `{cell}` is not a number", at()))?;
        }
        rows.push(row);
    }
    Ok(rows)
}

/// Where the columns are that a header names.
fn columns(cells: &[String]) -> anyhow::Result<[usize; 4]> {
    let bare = |cell: &String| match cell.split_once('(') {
        Some((name, _)) => name.trim().to_owned(),
        None => cell.clone(),
    };
    let names: Vec<String> = cells.iter().map(bare).collect();
    let mut places = [0; 4];
    for (place, wanted) in places.iter_mut().zip(["t", "x", "y", "z"]) {
        let found = names.iter().position(|name| name == wanted);
        *place = found.with_context(|| {
            format!(
                "the columns are {}; expected t, x, y and z (s, m) among them",
                names.join(", ")
            )
        })?;
    }
    Ok(places)
}
