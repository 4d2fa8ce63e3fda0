//! The figures of a study: for each output, what it does along the variable that runs along the axis.

use super::axes::Axes;
use super::distribution::distributions;
use super::drawing::Drawing;
use crate::report::StudyFigure;
use crate::study::error::StudyError;
use crate::study::outputs::columns::{SETTLED, STATUS, outputs, places};
use crate::study::outputs::record::Record;
use crate::study::outputs::table::Table;
use crate::study::outputs::thinned::Thinned;
use crate::study::spec::cases::Cases;
use crate::study::spec::{Column, Kind};

/// Values that a distribution is of, at most.
const MOST_VALUES: usize = 10_000;
/// Outputs that tell no more than others, or nothing along an axis.
const NOT_DRAWN: [&str; 8] = [
    "tip_x",
    "tip_y",
    "tip_qw",
    "tip_qx",
    "tip_qy",
    "tip_qz",
    "motion_mid",
    "force_mid",
];
/// All figures on the outputs in a table, but for workspaces.
pub(super) fn draw(
    cases: &Cases,
    record: &Record,
    table: &Table,
) -> Result<Vec<StudyFigure>, StudyError> {
    let study = &record.study;
    let columns = places(table.columns);
    let drawn: Vec<Column> = outputs(study)
        .into_iter()
        .filter(|column| column.kind != Kind::Text && !NOT_DRAWN.contains(&column.name.as_str()))
        .collect();
    let mut drawings: Vec<Drawing> = (Axes::of(study).into_iter())
        .map(|axes| Drawing::new(axes, &drawn, &columns))
        .collect();
    let mut all: Vec<Thinned<f64>> = vec![Thinned::new(MOST_VALUES); drawn.len()];
    let status = columns.get(STATUS).copied().unwrap_or_default();
    table.rows(|row, cells| {
        if cells[status] != SETTLED {
            return Ok(());
        }
        let digits = cases.digits(row);
        let cell = |name: &str| {
            columns
                .get(name)
                .and_then(|place| cells[*place].parse().ok())
        };
        for drawing in &mut drawings {
            drawing.add(row, &digits, &cells, cell);
        }
        for (values, column) in all.iter_mut().zip(&drawn) {
            if let Some(value) = cell(&column.name) {
                values.add(row, value);
            }
        }
        Ok(())
    })?;
    let note = note(record);
    let mut figures = Vec::new();
    for drawing in &drawings {
        figures.extend(drawing.figures(study, &note));
    }
    if drawings.is_empty() {
        figures.extend(distributions(study, &drawn, &all, &note));
    }
    Ok(figures)
}

/// What was held fixed, and what is left out.
fn note(record: &Record) -> String {
    let study = &record.study;
    let mut text = study.robot_phrase();
    let fixed = study
        .set
        .iter()
        .map(|(what, value)| format!("{what} {value}{}", unit_of(study.unit(what))));
    let fixed: Vec<String> = fixed.collect();
    if !fixed.is_empty() {
        text += &format!(" Held fixed: {}.", fixed.join(", "));
    }
    let commands = study
        .levels
        .iter()
        .map(|l| &l.what)
        .chain(study.set.iter().map(|(what, _)| what));
    let commanded = study.samples_command()
        || commands
            .into_iter()
            .any(|what| what.name().starts_with("command"));
    if !commanded {
        text += " Command: the middle of each tendon's range.";
    }
    match record.rows - record.settled {
        0 => {}
        some => {
            text += &format!(
                " {some} of {} configurations did not settle and are left out.",
                record.rows
            )
        }
    }
    text
}

fn unit_of(unit: &str) -> String {
    match unit {
        "" => String::new(),
        unit => format!(" {unit}"),
    }
}
