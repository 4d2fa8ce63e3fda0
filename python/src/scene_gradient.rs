//! Derivatives of equilibria by what is around the robot, by rows: obstacles, and the motion of the base.
//!
//! A motion is a displacement of an origin (m) and a rotation about it (rad), world axes.

use nalgebra::Vector3;
use numpy::{PyArray2, PyArray3, PyReadonlyArray3};
use pyo3::prelude::*;
use tdcr::sim::contact::{ContactSensitivity, ObstacleGradient};
use tdcr::sim::dynamics::ObstacleTangent;
use tdcr::sim::pose::PoseTangent;

use crate::arrays::{array, contiguous};
use crate::contact::{Scenes, ScenesArgument};
use crate::errors::{Failure, Outcome};
use crate::sensitivity::{OnFailure, by_rows_among, pose_cotangents};
use crate::statics::{Batch, RowsArgument};

/// The numbers of a motion.
fn numbers(motion: &PoseTangent) -> [f64; 6] {
    let (p, r) = (motion.position, motion.rotation);
    [p.x, p.y, p.z, r.x, r.y, r.z]
}

/// Writes derivatives by obstacles as 7 numbers each: by the motion and by the compliance.
pub fn write_obstacles(gradients: &[ObstacleGradient], out: &mut [f64]) {
    for (out, gradient) in out.as_chunks_mut::<7>().0.iter_mut().zip(gradients) {
        out[..6].copy_from_slice(&numbers(&gradient.pose));
        out[6] = gradient.compliance;
    }
}

/// Changes of obstacles, of 7 numbers each: of the motion and of the compliance.
pub fn read_obstacles(numbers: &[f64]) -> Vec<ObstacleTangent> {
    let of_obstacle = |&[x, y, z, a, b, c, compliance]: &[f64; 7]| ObstacleTangent {
        pose: PoseTangent {
            position: Vector3::new(x, y, z),
            rotation: Vector3::new(a, b, c),
        },
        compliance,
    };
    let obstacles = numbers.as_chunks::<7>().0.iter();
    obstacles.map(of_obstacle).collect()
}

/// Derivative of a cost of each row by its surroundings, shape (rows, 6 + 7 obstacles): by the motion of the base, and of each
/// obstacle by its motion and its compliance (m/N); from that by its disc poses, shape (rows, discs, 7): origins (1/m), then
/// quaternions.
#[pyfunction]
pub fn scene_vjp_rows<'py>(
    py: Python<'py>,
    rows: RowsArgument<'_>,
    scenes: ScenesArgument<'_>,
    cotangents: PyReadonlyArray3<'_, f64>,
    raises: bool,
) -> Outcome<Bound<'py, PyArray2<f64>>> {
    let rows = Batch::new(&rows)?;
    let scenes = Scenes::new(&scenes, rows.rows())?;
    let cotangents = contiguous(&cotangents, "cotangents", &[rows.rows(), rows.discs, 7])?;
    let cotangents = cotangents.as_chunks::<7>().0.to_vec();
    let vjp = |row: usize, among: &ContactSensitivity, turned: &[_], out: &mut [f64]| {
        let of_row = &cotangents[row * rows.discs..(row + 1) * rows.discs];
        let gradient = among.vjp(&pose_cotangents(of_row, turned));
        let (base, obstacles) = out.split_at_mut(6);
        base.copy_from_slice(&numbers(&gradient.base));
        write_obstacles(&gradient.obstacles, obstacles);
        Ok(())
    };
    let width = 6 + 7 * scenes.obstacles();
    let numbers = by_rows_among(py, &rows, &scenes, width, OnFailure::of(raises), vjp)?;
    Ok(array(py, numbers, [rows.rows(), width])?)
}

/// Jacobian of the disc poses of each row by the motion of an obstacle and its compliance (m/N), shape (rows, 6 discs, 7): for
/// each disc the change of its origin (m) and its rotation vector (rad), world frame.
#[pyfunction]
pub fn obstacle_jacobian_rows<'py>(
    py: Python<'py>,
    rows: RowsArgument<'_>,
    scenes: ScenesArgument<'_>,
    obstacle: usize,
    raises: bool,
) -> Outcome<Bound<'py, PyArray3<f64>>> {
    let rows = Batch::new(&rows)?;
    let scenes = Scenes::new(&scenes, rows.rows())?;
    let count = scenes.obstacles();
    if obstacle >= count {
        let message = format!("obstacle {obstacle} of {count}; expected one of the scene");
        return Err(Failure::input(message));
    }
    let jacobian = |_, among: &ContactSensitivity, _: &[_], out: &mut [f64]| {
        let motion = among.obstacle_jacobian(obstacle);
        for (out, row) in out.chunks_exact_mut(7).zip(motion.row_iter()) {
            out.iter_mut()
                .zip(row.iter())
                .for_each(|(out, entry)| *out = *entry);
        }
        for (out, change) in (out.chunks_exact_mut(6 * 7)).zip(among.by_compliance(obstacle)) {
            for (row, entry) in numbers(&change).into_iter().enumerate() {
                out[7 * row + 6] = entry;
            }
        }
        Ok(())
    };
    let width = 6 * rows.discs * 7;
    let numbers = by_rows_among(py, &rows, &scenes, width, OnFailure::of(raises), jacobian)?;
    Ok(array(py, numbers, [rows.rows(), 6 * rows.discs, 7])?)
}

/// Jacobian of the disc poses of each row by the motion of the base, shape (rows, 6 discs, 6), the rest as of
/// [`obstacle_jacobian_rows`].
#[pyfunction]
pub fn base_jacobian_rows<'py>(
    py: Python<'py>,
    rows: RowsArgument<'_>,
    scenes: ScenesArgument<'_>,
    raises: bool,
) -> Outcome<Bound<'py, PyArray3<f64>>> {
    let rows = Batch::new(&rows)?;
    let scenes = Scenes::new(&scenes, rows.rows())?;
    let jacobian = |_, among: &ContactSensitivity, _: &[_], out: &mut [f64]| {
        let motion = among.base_jacobian();
        for (out, row) in out.chunks_exact_mut(6).zip(motion.row_iter()) {
            out.iter_mut()
                .zip(row.iter())
                .for_each(|(out, entry)| *out = *entry);
        }
        Ok(())
    };
    let width = 6 * rows.discs * 6;
    let numbers = by_rows_among(py, &rows, &scenes, width, OnFailure::of(raises), jacobian)?;
    Ok(array(py, numbers, [rows.rows(), 6 * rows.discs, 6])?)
}
