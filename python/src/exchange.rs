//! Clouds of other programs: read into data sets, written out of them.

use std::path::PathBuf;

use pyo3::prelude::*;
use tdcr::learn::data::{DataSet, ExportFormat, ImportSettings, LengthUnit};
use tdcr::pipeline::{export, import};

use crate::errors::{Outcome, choice};
use crate::run;
use crate::stage::Stage;

/// Makes a data set of a folder of clouds and motor files; returns what one should know besides.
#[pyfunction]
#[pyo3(signature = (folder, out, units, points, voxel, split, seed, progress = None))]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn import_clouds(
    py: Python<'_>,
    folder: PathBuf,
    out: PathBuf,
    units: &str,
    points: usize,
    voxel: Option<f64>,
    split: Option<PathBuf>,
    seed: u64,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<Vec<String>> {
    let known = [
        ("m", LengthUnit::Metre),
        ("cm", LengthUnit::Centimetre),
        ("mm", LengthUnit::Millimetre),
    ];
    let settings = ImportSettings {
        unit: choice("units", units, &known)?,
        points,
        voxel_size: voxel,
        split,
        seed,
    };
    let imported = run::long(py, progress, |watch| {
        import(&folder, &out, &settings, &Stage::new(&["import"], watch))
    })??;
    Ok(imported.notes)
}

/// Writes the clouds of a data set as files of their own; returns how many.
#[pyfunction]
#[pyo3(signature = (path, format, out, progress = None))]
pub fn export_clouds(
    py: Python<'_>,
    path: PathBuf,
    format: &str,
    out: PathBuf,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<usize> {
    let known = [("ply", ExportFormat::Ply), ("npz", ExportFormat::Npz)];
    let format = choice("format", format, &known)?;
    Ok(run::long(py, progress, |watch| {
        let set = DataSet::open(&path)?;
        export(&set, format, &out, &Stage::new(&["export"], watch))
    })??)
}
