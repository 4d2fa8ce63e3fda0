//! `summary.csv`: a row for each combination of levels, over all that is sampled.

use std::io::Write;
use std::path::Path;

use nalgebra::Vector3;
use tdcr_base::files::AtomicFile;
use tdcr_base::stats::quantile;

use super::columns::{SETTLED, STATUS, inputs, level_cells, outputs, places};
use super::dexterity::{self, Dexterity, TipAxis};
use super::record::Record;
use super::table::{Cell, Table, header, push_line};
use super::thinned::Thinned;
use super::workspace::{self, Workspace};
use crate::study::error::StudyError;
use crate::study::spec::cases::Cases;
use crate::study::spec::{Column, Kind, Output};

/// Quantiles of each output, with what its column's name ends in.
const QUANTILES: [(&str, f64); 3] = [("p10", 0.1), ("median", 0.5), ("p90", 0.9)];
/// Columns of the tip's pose.
const TIP: [&str; 7] = [
    "tip_x", "tip_y", "tip_z", "tip_qw", "tip_qx", "tip_qy", "tip_qz",
];
/// Most tips that a workspace is made of, and most values that a quantile is of.
pub(in crate::study) const MOST_TIPS: usize = 10_000;
const MOST_VALUES: usize = 10_000;
/// Most tips that a dexterity is of.
const MOST_AXES: usize = 200_000;

/// Writes the summary of a study that samples something.
pub(in crate::study) fn write(
    cases: &Cases,
    record: &Record,
    table: &Table,
    dir: &Path,
) -> Result<(), StudyError> {
    let study = &record.study;
    if study.sample.is_none() {
        return Ok(());
    }
    let path = dir.join("summary.csv");
    let fail = |source| StudyError::Write {
        path: path.clone(),
        source,
    };
    let mut file = AtomicFile::create(&path).map_err(fail)?;
    let levels = study.levels.len();
    let numbers: Vec<Column> = outputs(study).into_iter().filter(is_averaged).collect();
    let mut columns: Vec<Column> = inputs(study)[..levels].to_vec();
    columns.extend(["rows", "settled"].map(|name| Column::new(name, "", Kind::Whole)));
    for column in &numbers {
        let named = |(end, _)| {
            Column::new(
                &format!("{}_{end}", column.name),
                &column.unit,
                Kind::Number,
            )
        };
        columns.extend(QUANTILES.map(named));
    }
    let wants_workspace = study.want.contains(&Output::Workspace);
    if wants_workspace {
        columns.extend(workspace::columns());
    }
    let wants_dexterity = study.want.contains(&Output::Dexterity);
    if wants_dexterity {
        columns.extend(dexterity::columns());
    }
    file.write_all(header(&columns).as_bytes()).map_err(fail)?;

    let base = Vector3::from(study.robot.base.position);
    let mut groups = Groups::new(table.columns, &numbers, study.samples());
    let mut add = |group: &mut Group| {
        let mut cells = level_cells(&cases.levels(group.combination));
        cells.extend([group.rows, group.settled].map(|count| Cell::Whole(count as i64)));
        for values in &mut group.values {
            let sorted = values.sorted();
            cells.extend(QUANTILES.map(|(_, share)| Cell::Number(quantile(&sorted, share))));
        }
        if wants_workspace {
            let tips = group.tips.take();
            cells.extend(Workspace::new(tips, study.alpha).cells(&base));
        }
        if wants_dexterity {
            let axes = group.axes.take();
            cells.extend(Dexterity::new(axes, study.dexterity_radius).cells());
        }
        let mut line = String::new();
        push_line(&mut line, &cells);
        file.write_all(line.as_bytes()).map_err(fail)
    };
    table.rows(|row, cells| match groups.add(row, &cells) {
        Some(mut finished) => add(&mut finished),
        None => Ok(()),
    })?;
    if let Some(mut last) = groups.group.take() {
        add(&mut last)?;
    }
    file.commit().map_err(fail)
}

/// Whether a column has quantiles: one of numbers, but for those of an orientation, which mean nothing apart.
fn is_averaged(column: &Column) -> bool {
    column.kind != Kind::Text && !column.name.starts_with("tip_q")
}

/// The rows of one combination of levels.
pub(in crate::study) struct Group {
    pub combination: usize,
    rows: usize,
    settled: usize,
    values: Vec<Thinned<f64>>,
    /// Places of the tip (m).
    pub tips: Thinned<Vector3<f64>>,
    /// The same with the tip's axis.
    pub axes: Thinned<TipAxis>,
}

/// Rows put together by combinations, which follow one another.
pub(in crate::study) struct Groups {
    samples: usize,
    status: usize,
    values: Vec<usize>,
    tip: Option<[usize; 7]>,
    pub group: Option<Group>,
}

impl Groups {
    /// Of rows with `columns`, of which `numbers` are put together.
    pub fn new(columns: &[Column], numbers: &[Column], samples: usize) -> Self {
        let places = places(columns);
        let place = |name: &str| places.get(name).copied();
        let tip = TIP.map(place).into_iter().collect::<Option<Vec<_>>>();
        Self {
            samples,
            status: place(STATUS).unwrap_or_default(),
            values: numbers
                .iter()
                .filter_map(|column| place(&column.name))
                .collect(),
            tip: tip.and_then(|tip| tip.try_into().ok()),
            group: None,
        }
    }

    /// Adds a row; returns the combination that ended before it.
    pub fn add(&mut self, row: usize, cells: &[String]) -> Option<Group> {
        let combination = row / self.samples;
        let ended = self.group.take_if(|group| group.combination != combination);
        let group = self.group.get_or_insert_with(|| Group {
            combination,
            rows: 0,
            settled: 0,
            values: vec![Thinned::new(MOST_VALUES); self.values.len()],
            tips: Thinned::new(MOST_TIPS),
            axes: Thinned::new(MOST_AXES),
        });
        group.rows += 1;
        group.settled += usize::from(cells[self.status] == SETTLED);
        let number = |place: usize| cells[place].parse::<f64>().ok();
        for (values, &place) in group.values.iter_mut().zip(&self.values) {
            if let Some(value) = number(place) {
                values.add(row, value);
            }
        }
        let tip = self.tip.map(|tip| tip.map(number));
        if let Some(
            [
                Some(x),
                Some(y),
                Some(z),
                Some(qw),
                Some(qx),
                Some(qy),
                Some(qz),
            ],
        ) = tip
        {
            let place = Vector3::new(x, y, z);
            group.tips.add(row, place);
            group.axes.add(row, TipAxis::new(place, [qw, qx, qy, qz]));
        }
        ended
    }
}
