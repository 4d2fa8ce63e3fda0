//! Rows of arrays in and out.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use numpy::ndarray::{Dimension, IntoDimension};
use numpy::{Element, IntoPyArray, PyArray, PyArrayMethods, PyReadonlyArray};
use pyo3::prelude::*;

use crate::errors::{Failure, Outcome};

/// Numbers of an array in C order, if its shape is `shape`.
pub fn contiguous<'a, T: Element, D: Dimension>(
    array: &'a PyReadonlyArray<'_, T, D>,
    name: &str,
    shape: &[usize],
) -> Outcome<&'a [T]> {
    if numpy::PyUntypedArrayMethods::shape(&**array) != shape {
        let found = numpy::PyUntypedArrayMethods::shape(&**array);
        let message = format!("{name} has shape {found:?}, expected {shape:?}");
        return Err(Failure::input(message));
    }
    (array.as_slice()).map_err(|_| Failure::input(format!("{name} is not contiguous in C order")))
}

/// A new array of `shape`, which has as many entries as there are `values`.
pub fn array<'py, T: Element, I: IntoDimension>(
    py: Python<'py>,
    values: Vec<T>,
    shape: I,
) -> PyResult<Bound<'py, PyArray<T, I::Dim>>> {
    values.into_pyarray(py).reshape(shape)
}

/// Writes points one after another.
pub fn write_points(points: &[Vector3<f64>], out: &mut [f64]) {
    for (out, point) in out.as_chunks_mut::<3>().0.iter_mut().zip(points) {
        *out = (*point).into();
    }
}

/// Writes quaternions (w, x, y, z) one after another.
pub fn write_quaternions(quaternions: &[UnitQuaternion<f64>], out: &mut [f64]) {
    for (out, q) in out.as_chunks_mut::<4>().0.iter_mut().zip(quaternions) {
        *out = [q.w, q.i, q.j, q.k];
    }
}

/// Numbers that are read one after another, as they were written.
pub struct Tape<'a>(pub &'a [f64]);

impl<'a> Tape<'a> {
    /// The next `count` numbers; fewer where the tape ends.
    pub fn take(&mut self, count: usize) -> &'a [f64] {
        let (taken, rest) = self.0.split_at(count.min(self.0.len()));
        self.0 = rest;
        taken
    }

    /// The next number.
    pub fn number(&mut self) -> f64 {
        self.take(1).first().copied().unwrap_or(f64::NAN)
    }

    /// The next `count` points.
    pub fn points(&mut self, count: usize) -> Vec<Vector3<f64>> {
        let points = self.take(3 * count).as_chunks::<3>().0.iter();
        points.map(|point| Vector3::from(*point)).collect()
    }

    /// The next `count` unit quaternions (w, x, y, z), to the last bit.
    pub fn quaternions(&mut self, count: usize) -> Vec<UnitQuaternion<f64>> {
        let turns = self.take(4 * count).as_chunks::<4>().0.iter();
        turns
            .map(|&[w, i, j, k]| UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k)))
            .collect()
    }
}

/// Points one after another.
pub fn flat_points(points: &[Vector3<f64>]) -> impl Iterator<Item = f64> {
    points.iter().flat_map(|point| point.data.0[0])
}

/// Quaternions (w, x, y, z) one after another.
pub fn flat_quaternions(quaternions: &[UnitQuaternion<f64>]) -> impl Iterator<Item = f64> {
    quaternions.iter().flat_map(|q| [q.w, q.i, q.j, q.k])
}

/// Quaternions (w, x, y, z) one after another, made unit ones; those that are but for rounding stay what they are.
pub fn quaternions(flat: &[f64]) -> Vec<UnitQuaternion<f64>> {
    let unit = |&[w, i, j, k]: &[f64; 4]| {
        let q = Quaternion::new(w, i, j, k);
        if (q.norm_squared() - 1.0).abs() < 1e-14 {
            UnitQuaternion::new_unchecked(q)
        } else {
            UnitQuaternion::from_quaternion(q)
        }
    };
    flat.as_chunks::<4>().0.iter().map(unit).collect()
}
