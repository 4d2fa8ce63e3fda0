//! Questions to the statics by rows.

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use tdcr::sim::robot::Command;

use crate::arrays::contiguous;
use crate::errors::{Failure, Outcome};
use crate::loads::{LoadRows, Loads};
use crate::robot::{Robot, of_rows};

/// Rows as they come from Python: robots, commands (rows, tendons), loads, payloads (rows,) and wrenches (rows, discs, 6).
pub type RowsArgument<'py> = (
    Vec<PyRef<'py, Robot>>,
    PyReadonlyArray2<'py, f64>,
    Vec<PyRef<'py, Loads>>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray3<'py, f64>>,
);

/// What each row is asked for: a robot, a command and loads.
pub struct Batch {
    /// One for all rows, or one a row; all of as many discs and tendons.
    robots: Vec<tdcr::sim::robot::Robot>,
    pub commands: Vec<Command>,
    pub loads: Vec<tdcr::sim::robot::Loads>,
    pub discs: usize,
    pub tendons: usize,
}

impl Batch {
    /// Checks the rows of a batch.
    pub fn new((robots, commands, loads, payload, wrench): &RowsArgument<'_>) -> Outcome<Self> {
        let rows = numpy::PyUntypedArrayMethods::shape(&**commands)[0];
        let robots = of_rows(robots, rows)?;
        let (discs, tendons) = (robots[0].discs().len(), robots[0].tendons().len());
        let values = contiguous(commands, "commands", &[rows, tendons])?;
        let rows_of_loads = LoadRows::new(loads, payload.as_ref(), wrench.as_ref(), rows, discs)?;
        let mut questions = Self {
            commands: Vec::with_capacity(rows),
            loads: Vec::with_capacity(rows),
            robots,
            discs,
            tendons,
        };
        for row in 0..rows {
            let values = &values[row * tendons..(row + 1) * tendons];
            let of_row = |failure: Failure| {
                if rows == 1 {
                    failure
                } else {
                    failure.of_row(row)
                }
            };
            let command = questions.robot(row).command(values);
            questions
                .commands
                .push(command.map_err(|error| of_row(error.into()))?);
            let loads = rows_of_loads.row(row).map_err(of_row)?;
            loads
                .check(questions.robot(row))
                .map_err(|error| of_row(error.into()))?;
            questions.loads.push(loads);
        }
        Ok(questions)
    }

    pub fn rows(&self) -> usize {
        self.commands.len()
    }

    pub fn robot(&self, row: usize) -> &tdcr::sim::robot::Robot {
        &self.robots[if self.robots.len() == 1 { 0 } else { row }]
    }

    /// The robot of all rows.
    pub fn one_robot(&self) -> Outcome<&tdcr::sim::robot::Robot> {
        match self.robots.as_slice() {
            [robot] => Ok(robot),
            several => {
                let message = format!("{} robots; expected one for all rows", several.len());
                Err(Failure::input(message))
            }
        }
    }

    /// A settler for a row, the one at hand where it is of the same robot.
    pub fn settler<'a>(
        &self,
        at_hand: &'a mut Option<tdcr::sim::statics::Settler>,
        row: usize,
    ) -> &'a mut tdcr::sim::statics::Settler {
        if self.robots.len() > 1 {
            *at_hand = None;
        }
        at_hand.get_or_insert_with(|| tdcr::sim::statics::Settler::new(self.robot(row)))
    }
}
