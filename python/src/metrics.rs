//! Distances between clouds, by rows.

use std::num::NonZeroUsize;

use numpy::{PyArray1, PyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use rayon::prelude::*;
use tdcr::learn::metrics::{self, Emd, GroundCost, MetricError};

use crate::arrays::{array, contiguous};
use crate::errors::{Failure, Outcome};
use crate::run::{self, Watch};

/// Clouds `(B, N, 3)` (m).
struct Clouds<'a> {
    points: &'a [[f32; 3]],
    count: usize,
}

impl<'a> Clouds<'a> {
    fn new(name: &str, clouds: &'a PyReadonlyArray3<'_, f32>) -> Outcome<Self> {
        let &[rows, count, _] = clouds.shape() else {
            return Err(Failure::input(format!("{name} are no clouds")));
        };
        let flat = contiguous(clouds, name, &[rows, count, 3])?;
        let points = flat.as_chunks().0;
        Ok(Self { points, count })
    }

    fn row(&self, row: usize) -> &'a [[f32; 3]] {
        &self.points[row * self.count..][..self.count]
    }
}

/// What `metric` gives of each pair of clouds, on all threads.
fn by_rows<T: Send>(
    py: Python<'_>,
    p: &PyReadonlyArray3<'_, f32>,
    q: &PyReadonlyArray3<'_, f32>,
    progress: Option<&Bound<'_, PyAny>>,
    metric: impl Fn(&[[f32; 3]], &[[f32; 3]]) -> Result<T, MetricError> + Sync,
) -> Outcome<Vec<T>> {
    let rows = p.shape()[0];
    if q.shape()[0] != rows {
        let message = format!(
            "{rows} clouds p and {} clouds q; expected pairs",
            q.shape()[0]
        );
        return Err(Failure::input(message));
    }
    let (first, second) = (Clouds::new("p", p)?, Clouds::new("q", q)?);
    let of_row = |watch: &Watch, row: usize| {
        if watch.stopped() {
            return Ok(None);
        }
        let found = metric(first.row(row), second.row(row)).map_err(|error| {
            let failure = Failure::input(error.to_string());
            if rows == 1 {
                failure
            } else {
                failure.of_row(row)
            }
        })?;
        watch.advance(1);
        Ok(Some(found))
    };
    let found: Vec<Outcome<Option<T>>> = run::long(py, progress, |watch| {
        (0..rows)
            .into_par_iter()
            .map(|row| of_row(watch, row))
            .collect()
    })?;
    // None is left out: a call that is stopped has ended above.
    found.into_iter().filter_map(Result::transpose).collect()
}

/// Chamfer distances (m²).
#[pyfunction]
#[pyo3(signature = (p, q, progress = None))]
pub fn chamfer_rows<'py>(
    py: Python<'py>,
    p: PyReadonlyArray3<'py, f32>,
    q: PyReadonlyArray3<'py, f32>,
    progress: Option<&Bound<'py, PyAny>>,
) -> Outcome<Bound<'py, PyArray1<f64>>> {
    let distances = by_rows(py, &p, &q, progress, metrics::chamfer)?;
    Ok(PyArray1::from_vec(py, distances))
}

/// Values, gaps and matchings (B, N).
type Matchings<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<i64>>,
);

/// Earth mover's distances (m, or m² if `squared`), with gaps and matchings: exact, or by groups of about `group` points.
#[pyfunction]
#[pyo3(signature = (p, q, squared, group = None, progress = None))]
pub fn emd_rows<'py>(
    py: Python<'py>,
    p: PyReadonlyArray3<'py, f32>,
    q: PyReadonlyArray3<'py, f32>,
    squared: bool,
    group: Option<usize>,
    progress: Option<&Bound<'py, PyAny>>,
) -> Outcome<Matchings<'py>> {
    let cost = match squared {
        true => GroundCost::SquaredDistance,
        false => GroundCost::Distance,
    };
    let group = match group.map(NonZeroUsize::new) {
        Some(None) => return Err(Failure::input("group is 0; expected 1 or more points")),
        group => group.flatten(),
    };
    let found = by_rows(py, &p, &q, progress, |p, q| match group {
        None => metrics::emd_with(p, q, cost),
        Some(group) => metrics::emd_approximate(p, q, cost, group),
    })?;
    let of = |pick: fn(&Emd) -> f64| PyArray1::from_vec(py, found.iter().map(pick).collect());
    let matchings = found.iter().flat_map(|emd| &emd.matching);
    let matchings = matchings.map(|&partner| partner as i64).collect();
    let shape = [found.len(), p.shape()[1]];
    Ok((
        of(|emd| emd.value),
        of(|emd| emd.gap),
        array(py, matchings, shape)?,
    ))
}
