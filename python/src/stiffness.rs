//! How stiff robots are where they settle, by rows.

use numpy::PyArray1;
use pyo3::prelude::*;

use crate::arrays::array;
use crate::contact::{Scenes, ScenesArgument};
use crate::errors::Outcome;
use crate::sensitivity::{OnFailure, each_row};
use crate::statics::{Batch, RowsArgument};

/// Smallest stiffness of each row where it settles from the straight pose, in its scene or without, shape (rows,) (N m/rad); not a
/// number where it does not settle.
#[pyfunction]
#[pyo3(signature = (rows, scenes=None))]
pub fn smallest_stiffness_rows<'py>(
    py: Python<'py>,
    rows: RowsArgument<'_>,
    scenes: Option<ScenesArgument<'_>>,
) -> Outcome<Bound<'py, PyArray1<f64>>> {
    let rows = Batch::new(&rows)?;
    let numbers = match scenes {
        None => each_row(py, &rows, 1, OnFailure::Raise, |settler, row, out| {
            let (command, loads) = (&rows.commands[row], &rows.loads[row]);
            let settled = rows.settler(settler, row).settle(command, loads);
            out[0] = match settled.converged {
                true => (rows.robot(row)).smallest_stiffness(command, loads, settled),
                false => f64::NAN,
            };
            Ok(())
        }),
        Some(scenes) => {
            let scenes = Scenes::new(&scenes, rows.rows())?;
            each_row(py, &rows, 1, OnFailure::Raise, |settler, row, out| {
                let (command, loads) = (&rows.commands[row], &rows.loads[row]);
                let settler = scenes.settler(&rows, settler, row);
                let is_settled = settler.settle(command, loads)?.equilibrium.converged;
                out[0] = match is_settled {
                    true => settler.smallest_stiffness(command, loads),
                    false => f64::NAN,
                };
                Ok(())
            })
        }
    }?;
    Ok(array(py, numbers, [rows.rows()])?)
}
