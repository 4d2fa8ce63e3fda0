//! Drawings of data sets, and the demo.

use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::PyBytes;
use tdcr::pages::{self, DataDrawing, DemoSettings, SetInfo};
use tdcr::pipeline::Survey;

use crate::errors::{Outcome, text};
use crate::predictor::named_precision;
use crate::run;
use crate::stage::Stage;
use crate::training::named_symmetry;

/// What `tdcr data info --json` says of the data set in a folder.
#[pyfunction]
pub fn data_info(py: Python<'_>, path: PathBuf) -> Outcome<String> {
    let info = py.detach(|| SetInfo::new(&path, &Survey::open(&path)?))?;
    text(serde_json::to_string(&info))
}

/// Draws the data sets in folders: the content of the file `out`, whose extension says what is drawn. `progress` is told of
/// robots that settle.
#[pyfunction]
#[pyo3(signature = (paths, out, clouds, progress = None))]
pub fn draw_data<'py>(
    py: Python<'py>,
    paths: Vec<PathBuf>,
    out: PathBuf,
    clouds: usize,
    progress: Option<&Bound<'py, PyAny>>,
) -> Outcome<Bound<'py, PyBytes>> {
    let drawing = DataDrawing::of(&out, paths.len())?;
    let drawn = run::long(py, progress, |watch| {
        drawing.draw(&paths, clouds, &Stage::new(&["settle"], watch))
    })??;
    Ok(PyBytes::new(py, &drawn))
}

/// How large a demo is, as `tdcr demo` asks for it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct DemoOptions {
    samples: usize,
    steps: u64,
    precision: Option<String>,
    symmetry: String,
    seed: u64,
}

/// Runs the demo in the folder `out`: what `tdcr demo --json` says. `progress` is told of samples, steps and test commands.
#[pyfunction]
#[pyo3(signature = (out, options, progress = None))]
pub fn demo(
    py: Python<'_>,
    out: PathBuf,
    options: DemoOptions,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<String> {
    let precision = options.precision.as_deref().map(named_precision);
    let settings = DemoSettings {
        samples: options.samples,
        steps: options.steps,
        precision: precision.transpose()?,
        symmetry: named_symmetry(&options.symmetry)?,
        seed: options.seed,
    };
    let made = run::long(py, progress, |watch| {
        let stages = Stage::new(&["collect", "train", "evaluate"], watch);
        pages::demo(&settings, &out, &stages)
    })??;
    text(serde_json::to_string(&made.metrics))
}
