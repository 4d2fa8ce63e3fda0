//! Pictures of 3-D Gaussians on arrays, and their derivatives: the part of splatting that PyTorch is too slow for on a processor.
//!
//! Gaussians come projected onto the image planes. Those of a picture are sorted by depth, listed by bands of rows, and blended from
//! front to back, Gaussian by Gaussian in the pixels of its ellipse. Written from the formulas of Kerbl, Kopanas, Leimkühler and
//! Drettakis, "3D Gaussian splatting for real-time radiance field rendering" (2023).

mod backward;
mod bands;
mod forward;

use numpy::PyUntypedArrayMethods;
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use self::bands::{Projected, ROWS};
use crate::arrays::{array, contiguous};
use crate::errors::{Failure, Outcome};
use crate::run;

/// Gaussians as arrays: means (N, G, 2), covariances (N, G, 3), depths (N, G), opacities (G), colours (N, G, 3).
#[derive(FromPyObject)]
pub struct Gaussians<'py>(
    PyReadonlyArray3<'py, f32>,
    PyReadonlyArray3<'py, f32>,
    PyReadonlyArray2<'py, f32>,
    PyReadonlyArray1<'py, f32>,
    PyReadonlyArray3<'py, f32>,
);

impl Gaussians<'_> {
    fn projected(
        &self,
        size: [usize; 2],
        near: f32,
        rows: Option<usize>,
    ) -> Outcome<Projected<'_>> {
        let Self(means, covariances, depths, opacities, colors) = self;
        let &[pictures, count] = depths.shape() else {
            return Err(Failure::input("depths are no rows"));
        };
        let rows = rows.unwrap_or(ROWS);
        if rows == 0 || size.contains(&0) || count == 0 {
            let message = format!(
                "pictures of {size:?} pixels, {count} Gaussians, bands of {rows} rows; expected 1 or more of each"
            );
            return Err(Failure::input(message));
        }
        let means = contiguous(means, "means", &[pictures, count, 2])?;
        let covariances = contiguous(covariances, "covariances", &[pictures, count, 3])?;
        Ok(Projected {
            means: means.as_chunks().0,
            covariances: covariances.as_chunks().0,
            depths: contiguous(depths, "depths", &[pictures, count])?,
            near,
            opacities: contiguous(opacities, "opacities", &[count])?,
            colors: contiguous(colors, "colors", &[pictures, count, 3])?
                .as_chunks()
                .0,
            size,
            rows,
        })
    }
}

/// Colours (N, P, 3), opacities (N, P) and median depths (N, P) of pictures of `size` pixels, width and height, of Gaussians beyond
/// the depth `near`.
#[pyfunction]
#[pyo3(signature = (gaussians, size, near, rows = None))]
#[allow(clippy::type_complexity, reason = "a tuple of Python's")]
pub fn blend_gaussians<'py>(
    py: Python<'py>,
    gaussians: Gaussians<'py>,
    size: [usize; 2],
    near: f32,
    rows: Option<usize>,
) -> Outcome<(
    Bound<'py, PyArray3<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<f32>>,
)> {
    let projected = gaussians.projected(size, near, rows)?;
    let found = run::short(py, || forward::pictures(&projected))?;
    let shape = [projected.pictures(), size[0] * size[1]];
    Ok((
        array(py, found.colors, [shape[0], shape[1], 3])?,
        array(py, found.opacities, shape)?,
        array(py, found.depths, shape)?,
    ))
}

/// Derivatives by means, covariances, opacities and colours, from those by the colours (N, P, 3) and opacities (N, P) of the
/// pictures.
#[pyfunction]
#[pyo3(signature = (gaussians, size, near, by_colors, by_opacities, rows = None))]
#[allow(clippy::type_complexity, reason = "a tuple of Python's")]
pub fn blend_gaussians_backward<'py>(
    py: Python<'py>,
    gaussians: Gaussians<'py>,
    size: [usize; 2],
    near: f32,
    by_colors: PyReadonlyArray3<'py, f32>,
    by_opacities: PyReadonlyArray2<'py, f32>,
    rows: Option<usize>,
) -> Outcome<(
    Bound<'py, PyArray3<f32>>,
    Bound<'py, PyArray3<f32>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray3<f32>>,
)> {
    let projected = gaussians.projected(size, near, rows)?;
    let [pictures, count] = [projected.pictures(), projected.opacities.len()];
    let pixels = size[0] * size[1];
    let by_colors = contiguous(&by_colors, "derivatives by colours", &[pictures, pixels, 3])?;
    let by_opacities = contiguous(
        &by_opacities,
        "derivatives by opacities",
        &[pictures, pixels],
    )?;
    let found = run::short(py, || {
        backward::gradient(&projected, by_colors, by_opacities)
    })?;
    Ok((
        array(py, found.means, [pictures, count, 2])?,
        array(py, found.covariances, [pictures, count, 3])?,
        array(py, found.opacities, [count])?,
        array(py, found.colors, [pictures, count, 3])?,
    ))
}
