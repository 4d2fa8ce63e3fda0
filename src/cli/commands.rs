//! Files of commands and of points: one after another, as CSV or JSON.
//!
//! A JSON file (`.json`) is a list of lists of numbers. A CSV file has a line for each; its cells may be quoted, empty lines and
//! lines that begin with `#` are passed over. Its first line may name the columns, units behind the names (`c0 (m)`). Columns `c0`, `c1`
//! and so on are then the command, `payload` is the payload, and `x`, `y`, `z` a point, in any order and among others,
//! so that the tables of `settle` and `reach` are read as they are. Under other names, all columns are read but
//! `payload`, in their order.

use std::path::Path;

use anyhow::{Context, bail, ensure};
use tdcr::base::files::{LARGEST_TEXT, read_text};
use tdcr::base::rows::Splitter;

/// A command of a file.
pub(super) struct Row {
    /// One number per tendon.
    pub command: Vec<f64>,
    /// Payload (kg), in a file with a column of this name.
    pub payload: Option<f64>,
}

impl Row {
    /// The command, where no payload may stand beside it.
    pub fn unloaded(self) -> anyhow::Result<Vec<f64>> {
        match self.payload {
            None | Some(0.0) => Ok(self.command),
            Some(mass) => bail!(
                "the column payload has {mass} kg, and a payload cannot change here; expected 0, and --payload KG for all"
            ),
        }
    }
}

/// Reads commands. `make` takes them one by one; what it refuses is told with its place.
pub(super) fn read_commands<T>(
    file: &Path,
    make: impl Fn(Row) -> anyhow::Result<T>,
) -> anyhow::Result<Vec<T>> {
    read(file, "commands", command_columns, |mut numbers, columns| {
        let payload = match columns {
            Some(Columns { payload: true, .. }) => numbers.pop(),
            _ => None,
        };
        make(Row {
            command: numbers,
            payload,
        })
    })
}

/// Reads points (m).
pub(super) fn read_points(file: &Path) -> anyhow::Result<Vec<[f64; 3]>> {
    read(file, "points", point_columns, |numbers, _| {
        let found = numbers.len();
        let point = numbers.try_into().ok();
        point.with_context(|| format!("a point has 3 numbers, found {found}"))
    })
}

/// The columns to read of a CSV file whose first line names them.
struct Columns {
    /// Their places, in the order in which they are wanted.
    places: Vec<usize>,
    /// Whether the last of them is a payload.
    payload: bool,
    /// Columns in all.
    count: usize,
}

fn read<T>(
    file: &Path,
    what: &str,
    columns: impl Fn(&[&str]) -> anyhow::Result<Columns>,
    make: impl Fn(Vec<f64>, Option<&Columns>) -> anyhow::Result<T>,
) -> anyhow::Result<Vec<T>> {
    let name = file.display();
    let text =
        read_text(file, LARGEST_TEXT).with_context(|| format!("cannot read {what} from {name}"))?;
    let mut made = Vec::new();
    if file
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
    {
        let rows: Vec<Vec<f64>> = serde_json::from_str(&text)
            .with_context(|| format!("{name} is not a list of lists of numbers"))?;
        for (number, row) in rows.into_iter().enumerate() {
            made.push(make(row, None).with_context(|| format!("{name} entry {number}"))?);
        }
    } else {
        let mut splitter = Splitter::new(b',');
        let lines = (1..).zip(text.lines().map(str::trim));
        let mut rows = lines
            .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
            .map(|(number, line)| (number, splitter.trimmed(line)))
            .peekable();
        let at = |number: usize| format!("{name} line {number}");
        let header = match rows.next_if(|(_, cells)| is_header(cells)) {
            Some((number, cells)) => Some(columns(&names(&cells)).with_context(|| at(number))?),
            None => None,
        };
        for (number, cells) in rows {
            let row = numbers(&cells, header.as_ref());
            let row = row.and_then(|row| make(row, header.as_ref()));
            made.push(row.with_context(|| at(number))?);
        }
    }
    if made.is_empty() {
        bail!("{name} has no {what}; expected one per line, or a JSON list of them");
    }
    Ok(made)
}

/// Whether a row names columns: it has no number.
fn is_header(cells: &[String]) -> bool {
    cells.iter().all(|cell| cell.parse::<f64>().is_err())
}

/// The names in a header, without units.
fn names(cells: &[String]) -> Vec<&str> {
    let name = |cell: &str| cell.find(['(', '[']).unwrap_or(cell.len());
    let names = cells.iter().map(|cell| cell[..name(cell)].trim());
    names.collect()
}

/// The numbers of a row, those of all columns without a header.
fn numbers(cells: &[String], header: Option<&Columns>) -> anyhow::Result<Vec<f64>> {
    let number =
        |text: &String| (text.parse::<f64>()).with_context(|| format!("`{text}` is not a number"));
    let Some(columns) = header else {
        return cells.iter().map(number).collect();
    };
    ensure!(
        cells.len() == columns.count,
        "the line has {} entries, expected {}, one for each column named in the first line",
        cells.len(),
        columns.count
    );
    columns
        .places
        .iter()
        .map(|&place| number(&cells[place]))
        .collect()
}

/// Columns that say how the base moves, in tables of `plan` and `deploy`.
const BASE: [&str; 2] = ["insertion", "base_x"];

fn command_columns(names: &[&str]) -> anyhow::Result<Columns> {
    if let Some(name) = names.iter().find(|name| BASE.contains(name)) {
        tracing::warn!(
            "the column {name} moves the base, which stays where it is here: the commands alone are read"
        );
    }
    let numbered = |(place, name): (usize, &&str)| {
        let number: usize = name.strip_prefix(['c', 'C'])?.parse().ok()?;
        Some((number, place))
    };
    let is_payload = |name: &&str| name.eq_ignore_ascii_case("payload");
    let mut command: Vec<(usize, usize)> = names.iter().enumerate().filter_map(numbered).collect();
    command.sort_unstable();
    let expected = 0..command.len();
    ensure!(
        expected.eq(command.iter().map(|&(number, _)| number)),
        "the columns of the command are {}; expected c0, c1 and so on, each once",
        list(command.iter().map(|(number, _)| format!("c{number}")))
    );
    let mut places: Vec<usize> = match command.is_empty() {
        false => command.into_iter().map(|(_, place)| place).collect(),
        true => (0..names.len())
            .filter(|&place| !is_payload(&names[place]))
            .collect(),
    };
    let payloads: Vec<usize> = (0..names.len())
        .filter(|&place| is_payload(&names[place]))
        .collect();
    ensure!(
        payloads.len() <= 1,
        "{} columns are named payload, expected one at most",
        payloads.len()
    );
    places.extend(&payloads);
    Ok(Columns {
        places,
        payload: !payloads.is_empty(),
        count: names.len(),
    })
}

fn point_columns(names: &[&str]) -> anyhow::Result<Columns> {
    let place = |axis: &str| {
        names
            .iter()
            .position(|name| name.eq_ignore_ascii_case(axis))
    };
    let axes: Option<Vec<usize>> = ["x", "y", "z"].into_iter().map(place).collect();
    let places = axes.with_context(|| {
        let found = list(names.iter().map(ToString::to_string));
        format!("the columns are {found}; expected x, y and z")
    })?;
    Ok(Columns {
        places,
        payload: false,
        count: names.len(),
    })
}

fn list(names: impl Iterator<Item = String>) -> String {
    names.collect::<Vec<_>>().join(", ")
}
