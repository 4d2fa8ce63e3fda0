//! The columns of a study's table, and what its rows are found by.

use std::collections::BTreeMap;

use serde_json::Value;

use super::table::Cell;
use crate::study::spec::cases::Cases;
use crate::study::spec::variable::{Setting, Target};
use crate::study::spec::{Column, Kind, Output, Study};

/// What is in a row besides outputs.
pub(in crate::study) const ROW: &str = "row";
pub(in crate::study) const STATUS: &str = "status";
/// What the status of a row that settled says.
pub(in crate::study) const SETTLED: &str = "settled";

/// The columns of a study's table.
pub(in crate::study) fn columns(study: &Study, cases: &Cases) -> Vec<Column> {
    let mut columns = vec![Column::new(ROW, "", Kind::Whole)];
    columns.extend(inputs(study));
    if study.samples_command() {
        let count = cases.case(0).command.map_or(0, |command| command.len());
        let sampled = study
            .sampled
            .iter()
            .find(|sampled| sampled.what.target == Target::Command);
        let unit = sampled.map_or("", |sampled| study.unit(&sampled.what));
        let named = |tendon: usize| Column::new(&format!("c{tendon}"), unit, Kind::Number);
        columns.extend((0..count).map(named));
    }
    columns.push(Column::new(STATUS, "", Kind::Text));
    columns.extend(outputs(study));
    columns
}

/// Columns of the variables, but for a sampled command.
pub(in crate::study) fn inputs(study: &Study) -> Vec<Column> {
    let levels = study.levels.iter().map(|levels| {
        let values = || levels.values.iter();
        let kind = match () {
            () if values().all(|value| value.as_i64().is_some()) => Kind::Whole,
            () if values().all(Value::is_number) => Kind::Number,
            () => Kind::Text,
        };
        Column::new(levels.what.name(), study.unit(&levels.what), kind)
    });
    let sampled = (study.scalars())
        .map(|sampled| Column::new(sampled.what.name(), study.unit(&sampled.what), Kind::Number));
    levels.chain(sampled).collect()
}

/// Columns of what is wanted. A workspace is made of the tips' places.
pub(in crate::study) fn outputs(study: &Study) -> Vec<Column> {
    let limited = study.tension_limit.is_some();
    let mut wants = study.want.clone();
    if needs_tip(study) {
        wants.insert(0, Output::Tip);
    }
    wants
        .into_iter()
        .flat_map(|want| want.columns(limited))
        .collect()
}

/// Whether the tips are computed though the study does not ask for them.
pub(in crate::study) fn needs_tip(study: &Study) -> bool {
    study.want.iter().any(|want| want.is_of_tips()) && !study.want.contains(&Output::Tip)
}

/// Values of some levels as cells.
pub(in crate::study) fn level_cells(settings: &[Setting]) -> Vec<Cell> {
    // The seed of a study is a number as any other.
    settings.iter().map(|setting| cell(&setting.1)).collect()
}

pub(in crate::study) fn cell(value: &Value) -> Cell {
    match (value.as_i64(), value.as_f64(), value) {
        (Some(whole), ..) => Cell::Whole(whole),
        (None, Some(number), _) => Cell::Number(number),
        (_, _, Value::String(text)) => Cell::Text(text.clone()),
        (_, _, other) => Cell::Text(other.to_string()),
    }
}

/// Places of columns by name.
pub(in crate::study) fn places(columns: &[Column]) -> BTreeMap<&str, usize> {
    columns
        .iter()
        .enumerate()
        .map(|(place, column)| (column.name.as_str(), place))
        .collect()
}
