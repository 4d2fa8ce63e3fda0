//! Derivatives of equilibria, by rows, in scenes or without.
//!
//! Quaternions (w, x, y, z) are of unit length, and so is every neighbour that a derivative speaks of: a change of a pose is a
//! rotation vector `omega` in the world frame, with `dq = 1/2 (0, omega) q`.

use nalgebra::{UnitQuaternion, Vector3};
use numpy::{PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use rayon::prelude::*;
use tdcr::sim::contact::ContactSensitivity;
use tdcr::sim::pose::{PoseTangent, rotation_cotangent};
use tdcr::sim::robot::Parameter;
use tdcr::sim::sensitivity::Sensitivity;

use crate::arrays::{array, contiguous};
use crate::contact::{Scenes, ScenesArgument};
use crate::errors::{Failure, Outcome};
use crate::robot::parameters_of;
use crate::run;
use crate::statics::{Batch, RowsArgument, SMALL};

/// What becomes of rows without derivatives: not settled, or on the brink of instability.
#[derive(Clone, Copy, PartialEq)]
pub enum OnFailure {
    /// The call fails, and names the first of them.
    Raise,
    /// Their derivatives are not numbers.
    Nan,
}

impl OnFailure {
    pub fn of(raises: bool) -> Self {
        if raises { Self::Raise } else { Self::Nan }
    }
}

/// Change (w, x, y, z) of a quaternion under a rotation vector.
pub fn quaternion_change(q: &UnitQuaternion<f64>, rotation: &Vector3<f64>) -> [f64; 4] {
    let v = q.imag();
    let change = (rotation * q.w + rotation.cross(&v)) * 0.5;
    [-0.5 * rotation.dot(&v), change.x, change.y, change.z]
}

/// Computes each row's numbers from its sensitivity, in parallel.
fn by_rows(
    py: Python<'_>,
    rows: &Batch,
    scenes: Option<&Scenes>,
    width: usize,
    failures: OnFailure,
    write: impl Fn(usize, &Sensitivity, &[UnitQuaternion<f64>], &mut [f64]) -> Outcome<()> + Sync,
) -> Outcome<Vec<f64>> {
    let Some(scenes) = scenes else {
        return each_row(py, rows, width, failures, |settler, row, out| {
            let (command, loads) = (&rows.commands[row], &rows.loads[row]);
            let settled = rows.settler(settler, row).settle(command, loads);
            let sensitivity = rows.robot(row).sensitivity(command, loads, settled)?;
            write(row, &sensitivity, &settled.orientations, out)
        });
    };
    by_rows_among(py, rows, scenes, width, failures, |row, among, q, out| {
        write(row, among.parameters(), q, out)
    })
}

/// Computes each row's numbers from its sensitivity among obstacles, in parallel.
pub fn by_rows_among(
    py: Python<'_>,
    rows: &Batch,
    scenes: &Scenes,
    width: usize,
    failures: OnFailure,
    write: impl Fn(usize, &ContactSensitivity, &[UnitQuaternion<f64>], &mut [f64]) -> Outcome<()> + Sync,
) -> Outcome<Vec<f64>> {
    each_row(py, rows, width, failures, |settler, row, out| {
        let (command, loads) = (&rows.commands[row], &rows.loads[row]);
        let settler = scenes.settler(rows, settler, row);
        settler.settle(command, loads)?;
        let sensitivity = settler.sensitivity(command, loads)?;
        let settled = &settler.found().equilibrium;
        write(row, &sensitivity, &settled.orientations, out)
    })
}

/// Computes each row's numbers with a settler that each thread keeps, in parallel.
pub fn each_row<S>(
    py: Python<'_>,
    rows: &Batch,
    width: usize,
    failures: OnFailure,
    write: impl Fn(&mut Option<S>, usize, &mut [f64]) -> Outcome<()> + Sync,
) -> Outcome<Vec<f64>> {
    let mut numbers = vec![0.0; width * rows.rows()];
    if width == 0 {
        return Ok(numbers);
    }
    let differentiate = |settler: &mut Option<S>, row: usize, out: &mut [f64]| {
        let failure = write(settler, row, out).err()?;
        out.fill(f64::NAN);
        // What is wrong with the question is told in any case.
        let told =
            failures == OnFailure::Raise || !matches!(failure, Failure::Of("SensitivityError", _));
        told.then_some((row, failure))
    };
    let failed = match rows.rows() == 1 && rows.discs <= SMALL {
        true => py.detach(|| differentiate(&mut None, 0, &mut numbers)),
        false => run::long(py, None, |watch| {
            let outcomes = numbers.par_chunks_exact_mut(width).enumerate().map_init(
                || None,
                |settler, (row, out)| match watch.stopped() {
                    true => None,
                    false => differentiate(settler, row, out),
                },
            );
            outcomes.flatten().min_by_key(|(row, _)| *row)
        })?,
    };
    match failed {
        Some((row, failure)) if rows.rows() > 1 => Err(failure.of_row(row)),
        Some((_, failure)) => Err(failure),
        None => Ok(numbers),
    }
}

/// Derivatives of a cost by disc poses, from those by origins (1/m) and quaternions (w, x, y, z).
pub fn pose_cotangents(
    cotangents: &[[f64; 7]],
    turned: &[UnitQuaternion<f64>],
) -> Vec<PoseTangent> {
    let of_pose = |(&[px, py, pz, w, x, y, z], q): (&[f64; 7], &UnitQuaternion<f64>)| PoseTangent {
        position: Vector3::new(px, py, pz),
        rotation: rotation_cotangent(q, [w, x, y, z]),
    };
    cotangents.iter().zip(turned).map(of_pose).collect()
}

/// The scenes of rows, if there are any.
fn scenes_of(scenes: Option<&ScenesArgument<'_>>, rows: &Batch) -> Outcome<Option<Scenes>> {
    scenes
        .map(|scenes| Scenes::new(scenes, rows.rows()))
        .transpose()
}

/// Jacobian of the disc poses by parameters for each row, shape (rows, 6 discs, parameters): for each disc the change of its
/// origin (m) and its rotation vector (rad), world frame.
#[pyfunction]
#[pyo3(signature = (rows, names, raises, scenes=None))]
pub fn jacobian_rows<'py>(
    py: Python<'py>,
    rows: RowsArgument<'_>,
    names: Vec<String>,
    raises: bool,
    scenes: Option<ScenesArgument<'_>>,
) -> Outcome<Bound<'py, PyArray3<f64>>> {
    let rows = Batch::new(&rows)?;
    let scenes = scenes_of(scenes.as_ref(), &rows)?;
    let names = parameters_of(rows.robot(0), &names)?;
    let (poses, width) = (6 * rows.discs, names.len());
    let whole_command = (0..rows.tendons)
        .map(Parameter::Command)
        .eq(names.iter().copied());
    let jacobian = |_, sensitivity: &Sensitivity, _: &[_], out: &mut [f64]| -> Outcome<()> {
        let jacobian = match whole_command {
            true => sensitivity.command_jacobian(),
            false => sensitivity.jacobian(&names)?,
        };
        for (out, row) in out.chunks_exact_mut(width).zip(jacobian.row_iter()) {
            out.iter_mut()
                .zip(row.iter())
                .for_each(|(out, entry)| *out = *entry);
        }
        Ok(())
    };
    let numbers = by_rows(
        py,
        &rows,
        scenes.as_ref(),
        poses * width,
        OnFailure::of(raises),
        jacobian,
    )?;
    Ok(array(py, numbers, [rows.rows(), poses, width])?)
}

/// Change of the disc poses of each row, shape (rows, discs, 7), when its parameters change at `rates`, shape (rows,
/// parameters): origins (m), then quaternions.
#[pyfunction]
#[pyo3(signature = (rows, names, rates, raises, scenes=None))]
pub fn jvp_rows<'py>(
    py: Python<'py>,
    rows: RowsArgument<'_>,
    names: Vec<String>,
    rates: PyReadonlyArray2<'_, f64>,
    raises: bool,
    scenes: Option<ScenesArgument<'_>>,
) -> Outcome<Bound<'py, PyArray3<f64>>> {
    let rows = Batch::new(&rows)?;
    let scenes = scenes_of(scenes.as_ref(), &rows)?;
    let names = parameters_of(rows.robot(0), &names)?;
    let rates = contiguous(&rates, "rates", &[rows.rows(), names.len()])?.to_vec();
    let jvp =
        |row: usize, sensitivity: &Sensitivity, turned: &[_], out: &mut [f64]| -> Outcome<()> {
            let rates = &rates[row * names.len()..(row + 1) * names.len()];
            let direction: Vec<(Parameter, f64)> =
                names.iter().copied().zip(rates.iter().copied()).collect();
            let changes = sensitivity.jvp(&direction)?;
            for ((out, change), q) in out
                .as_chunks_mut::<7>()
                .0
                .iter_mut()
                .zip(changes)
                .zip(turned)
            {
                let [w, x, y, z] = quaternion_change(q, &change.rotation);
                let p = change.position;
                *out = [p.x, p.y, p.z, w, x, y, z];
            }
            Ok(())
        };
    let numbers = by_rows(
        py,
        &rows,
        scenes.as_ref(),
        7 * rows.discs,
        OnFailure::of(raises),
        jvp,
    )?;
    Ok(array(py, numbers, [rows.rows(), rows.discs, 7])?)
}

/// Derivative of a cost of each row by its parameters, shape (rows, parameters), from that by its disc poses, shape (rows,
/// discs, 7): origins (1/m), then quaternions.
#[pyfunction]
#[pyo3(signature = (rows, names, cotangents, raises, scenes=None))]
pub fn vjp_rows<'py>(
    py: Python<'py>,
    rows: RowsArgument<'_>,
    names: Vec<String>,
    cotangents: PyReadonlyArray3<'_, f64>,
    raises: bool,
    scenes: Option<ScenesArgument<'_>>,
) -> Outcome<Bound<'py, PyArray2<f64>>> {
    let rows = Batch::new(&rows)?;
    let scenes = scenes_of(scenes.as_ref(), &rows)?;
    let names = parameters_of(rows.robot(0), &names)?;
    let cotangents = contiguous(&cotangents, "cotangents", &[rows.rows(), rows.discs, 7])?;
    let cotangents = cotangents.as_chunks::<7>().0.to_vec();
    let vjp =
        |row: usize, sensitivity: &Sensitivity, turned: &[_], out: &mut [f64]| -> Outcome<()> {
            let of_row = &cotangents[row * rows.discs..(row + 1) * rows.discs];
            let poses = pose_cotangents(of_row, turned);
            out.copy_from_slice(&sensitivity.vjp(&poses, &names)?);
            Ok(())
        };
    let numbers = by_rows(
        py,
        &rows,
        scenes.as_ref(),
        names.len(),
        OnFailure::of(raises),
        vjp,
    )?;
    Ok(array(py, numbers, [rows.rows(), names.len()])?)
}
