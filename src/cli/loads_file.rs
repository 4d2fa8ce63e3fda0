//! Files of loads that vary from command to command.
//!
//! A CSV file whose first line names its columns: `fx9 (N)`, `fy9`, `fz9` are the force on the origin of disc 9, `mx9 (N m)`, `my9`, `mz9`
//! the moment on it, in the world's frame; `fxtip` is of the distal disc. Units behind names, empty lines, lines that begin with `#` and other columns are
//! passed over, so that the contacts' forces of a table of `tdcr simulate` are read as they are. Columns that are missing are 0. Each row is that of one command; with a column
//! `time` (s) rows are at those times from the start of the motion, and loads are linear between them.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use tdcr::base::files::{LARGEST_TEXT, read_text};
use tdcr::base::rows::Splitter;
use tdcr::sim::robot::{Frame, Loads, Robot, Wrench};

/// Loads that vary.
pub(super) struct LoadsFile {
    name: PathBuf,
    /// Discs that are loaded.
    discs: Vec<usize>,
    /// Of each row the time (s), where there is a column of it.
    times: Option<Vec<f64>>,
    /// Of each row a force (N) and a moment (N m) on each loaded disc.
    rows: Vec<Vec<[f64; 6]>>,
}

/// What a column is.
#[derive(Clone, Copy)]
enum Column {
    Time,
    /// A part of the wrench on one of the loaded discs.
    Part {
        place: usize,
        part: usize,
    },
    Other,
}

const PARTS: [&str; 6] = ["fx", "fy", "fz", "mx", "my", "mz"];
const EXPECTED: &str =
    "expected columns fx9, fy9, fz9 (N), mx9, my9, mz9 (N m) of discs by their number, or fxtip";

impl LoadsFile {
    /// Reads loads on the discs of `robot`.
    pub fn read(file: &Path, robot: &Robot) -> anyhow::Result<Self> {
        let name = file.display();
        let text = read_text(file, LARGEST_TEXT)
            .with_context(|| format!("cannot read loads from {name}"))?;
        let mut splitter = Splitter::new(b',');
        let lines = (1..).zip(text.lines().map(str::trim));
        let mut lines = lines
            .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
            .map(|(number, line)| (number, splitter.trimmed(line)));
        let Some((number, header)) = lines.next() else {
            bail!("{name} is empty; {EXPECTED}");
        };
        let mut discs = Vec::new();
        let columns = columns(&header, robot.discs().len(), &mut discs)
            .with_context(|| format!("{name} line {number}"))?;
        let has_time = columns.iter().any(|column| matches!(column, Column::Time));
        let (mut rows, mut times) = (Vec::new(), Vec::<f64>::new());
        for (number, cells) in lines {
            let at = || format!("{name} line {number}");
            let (time, row) = wrenches(&columns, &header, &cells, discs.len()).with_context(at)?;
            if let (Some(&before), Some(time)) = (times.last(), time) {
                ensure!(
                    before < time,
                    "{}: the time {time} s, after {before} s; expected times that ascend",
                    at()
                );
            }
            times.extend(time);
            rows.push(row);
        }
        ensure!(
            !rows.is_empty(),
            "{name} has no loads below the names of its columns"
        );
        Ok(Self {
            name: file.to_owned(),
            discs,
            times: has_time.then_some(times),
            rows,
        })
    }

    /// Refuses a file without times that has another number of rows than there are commands.
    pub fn check_rows(&self, commands: usize) -> anyhow::Result<()> {
        ensure!(
            self.times.is_some() || self.rows.len() == commands,
            "{} has {} rows of loads, and there are {commands} commands; expected a row for each, or a column time (s)",
            self.name.display(),
            self.rows.len()
        );
        Ok(())
    }

    /// `loads` and those of the step `step`, which ends at `time` (s).
    pub fn beside(&self, loads: &Loads, step: usize, time: f64) -> anyhow::Result<Loads> {
        let mut all = loads.clone();
        for (place, &disc) in self.discs.iter().enumerate() {
            let [fx, fy, fz, mx, my, mz] = self.wrench(place, step, time);
            if [fx, fy, fz, mx, my, mz] != [0.0; 6] {
                all = all.with_wrench(Wrench {
                    force: [fx, fy, fz],
                    moment: [mx, my, mz],
                    ..Wrench::none(disc, Frame::World)
                })?;
            }
        }
        Ok(all)
    }

    fn wrench(&self, place: usize, step: usize, time: f64) -> [f64; 6] {
        let Some(times) = &self.times else {
            return self.rows[step][place];
        };
        let next = times.partition_point(|&t| t <= time).min(times.len() - 1);
        let last = next.saturating_sub(1);
        let span = times[next] - times[last];
        let part = match span > 0.0 {
            true => ((time - times[last]) / span).clamp(0.0, 1.0),
            false => 0.0,
        };
        let [last, next] = [last, next].map(|row| self.rows[row][place]);
        std::array::from_fn(|k| last[k] + part * (next[k] - last[k]))
    }
}

/// The time of a line, where it has one, and the wrenches on `discs` loaded discs.
fn wrenches(
    columns: &[Column],
    header: &[String],
    cells: &[String],
    discs: usize,
) -> anyhow::Result<(Option<f64>, Vec<[f64; 6]>)> {
    ensure!(
        cells.len() == columns.len(),
        "{} entries, expected {}, one for each column named in the first line",
        cells.len(),
        columns.len()
    );
    let (mut time, mut row) = (None, vec![[0.0; 6]; discs]);
    for ((column, cell), title) in columns.iter().zip(cells).zip(header) {
        let value = || {
            let value = cell.parse().ok().filter(|value: &f64| value.is_finite());
            value.with_context(|| format!("column `{title}`: `{cell}` is no finite number"))
        };
        match *column {
            Column::Time => time = Some(value()?),
            Column::Part { place, part } => row[place][part] = value()?,
            Column::Other => {}
        }
    }
    Ok((time, row))
}

/// What the columns of a header are; `discs` gets the discs that are loaded.
fn columns(header: &[String], count: usize, discs: &mut Vec<usize>) -> anyhow::Result<Vec<Column>> {
    let mut seen: Vec<String> = Vec::new();
    let mut columns = Vec::with_capacity(header.len());
    for title in header {
        let name = title
            .split(['(', '['])
            .next()
            .unwrap_or_default()
            .trim()
            .to_lowercase();
        let column = column(&name, count, discs)?;
        if !matches!(column, Column::Other) {
            let name = match name.as_str() {
                "t" => "time".to_owned(),
                _ => name.replace("tip", &(count - 1).to_string()),
            };
            ensure!(!seen.contains(&name), "the column `{title}` is there twice");
            seen.push(name);
        }
        columns.push(column);
    }
    ensure!(
        !discs.is_empty(),
        "the columns are {}; {EXPECTED}",
        header.join(", ")
    );
    Ok(columns)
}

fn column(name: &str, count: usize, discs: &mut Vec<usize>) -> anyhow::Result<Column> {
    if name == "time" || name == "t" {
        return Ok(Column::Time);
    }
    let found = PARTS
        .iter()
        .enumerate()
        .find_map(|(part, prefix)| Some((part, name.strip_prefix(prefix)?)));
    let Some((part, disc)) = found else {
        return Ok(Column::Other);
    };
    let disc = match disc {
        "tip" => count - 1,
        number => {
            (number.parse().ok().filter(|&disc: &usize| disc < count)).with_context(|| {
                format!(
                    "the column `{name}` is of no disc: the robot has discs 0 to {}",
                    count - 1
                )
            })?
        }
    };
    let place = discs.iter().position(|&other| other == disc);
    let place = place.unwrap_or_else(|| {
        discs.push(disc);
        discs.len() - 1
    });
    Ok(Column::Part { place, part })
}
