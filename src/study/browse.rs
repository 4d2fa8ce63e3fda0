//! A finished study, row by row: the numbers of its table, and the robot of each row.

use std::fmt;
use std::path::Path;

use tdcr_sim::robot::{Command, Loads, Robot};
use tdcr_sim::scene::Scene;

use super::error::StudyError;
use super::outputs::record::{RECORD, Record};
use super::outputs::table::Table;
use super::spec::cases::Cases;
use super::spec::{Column, Kind, Study, case};

/// Most rows whose numbers are kept: more are thinned evenly.
const MOST: usize = 20_000;

/// A finished study's rows.
#[derive(Clone, PartialEq)]
pub struct Rows {
    study: Study,
    first_row: usize,
    count: usize,
    /// Columns of numbers.
    columns: Vec<Column>,
    numbers: Vec<usize>,
    values: Vec<Vec<Option<f64>>>,
}

/// What a row of a study is of.
#[derive(Clone, Debug)]
pub struct Configuration {
    /// The robot.
    pub robot: Robot,
    /// What is around it.
    pub scene: Scene,
    /// What pulls at it.
    pub loads: Loads,
    /// What its tendons are told.
    pub command: Command,
}

impl Rows {
    /// Reads the folder of a finished study. Of more than 20,000 rows, so many are kept, evenly spread.
    ///
    /// # Errors
    /// [`StudyError::NoPart`] where there is no finished study, [`StudyError::Table`] for a table that was changed.
    pub fn open(dir: &Path) -> Result<Self, StudyError> {
        let Some(record) = Record::read(dir)? else {
            return Err(StudyError::NoPart {
                path: dir.to_owned(),
                reason: format!("there is no {RECORD} in it"),
            });
        };
        let is_number = |column: &&Column| matches!(column.kind, Kind::Number | Kind::Whole);
        let places: Vec<usize> = (0..record.columns.len())
            .filter(|&place| is_number(&&record.columns[place]))
            .collect();
        let every = record.rows.div_ceil(MOST).max(1);
        let (mut numbers, mut values) = (Vec::new(), Vec::new());
        Table::new(dir, &record).rows(|row, cells| {
            if (row - record.first_row) % every == 0 {
                numbers.push(row);
                let cell = |&place: &usize| cells[place].parse().ok();
                values.push(places.iter().map(cell).collect());
            }
            Ok(())
        })?;
        Ok(Self {
            first_row: record.first_row,
            count: record.rows,
            columns: record.columns.iter().filter(is_number).cloned().collect(),
            numbers,
            values,
            study: record.study,
        })
    }

    /// The study.
    pub fn study(&self) -> &Study {
        &self.study
    }

    /// The columns of numbers.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// The rows whose numbers are kept, by their numbers in the table.
    pub fn numbers(&self) -> &[usize] {
        &self.numbers
    }

    /// Their numbers, in the order of the columns; `None` in an empty cell.
    pub fn values(&self) -> &[Vec<Option<f64>>] {
        &self.values
    }

    /// What row `row` of the table is of.
    ///
    /// # Errors
    /// [`RowError`] for a row that the table does not have, and for one whose robot is none.
    pub fn configuration(&self, row: usize) -> Result<Configuration, RowError> {
        let rows = self.first_row..self.first_row + self.count;
        if !rows.contains(&row) {
            let reason = format!("the table has rows {} to {}", rows.start, rows.end - 1);
            return Err(RowError { row, reason });
        }
        let refused = |reason: String| RowError { row, reason };
        let cases = Cases::new(&self.study).map_err(|refusal| refused(refusal.to_string()))?;
        let case = cases.case(row);
        let robot = case::robot(&self.study, &case.settings).map_err(refused)?;
        Ok(Configuration {
            scene: case::scene(&self.study, &case.settings).map_err(refused)?,
            loads: case::loads(&robot, &case.settings).map_err(refused)?,
            command: case::command(&robot, &case.settings, case.command.as_deref())
                .map_err(refused)?,
            robot,
        })
    }
}

impl fmt::Debug for Rows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut told = f.debug_struct("Rows");
        told.field("title", &self.study.title);
        told.field("count", &self.count).finish_non_exhaustive()
    }
}

/// Why a row cannot be shown.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("row {row}: {reason}")]
pub struct RowError {
    /// The row.
    pub row: usize,
    /// What is wrong.
    pub reason: String,
}
