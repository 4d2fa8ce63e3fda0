//! Studies: sweeps that one file, or one dictionary, describes.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use tdcr::base::Part;
use tdcr::study::{Finished, Study, StudyError, merge, run as run_study};

use crate::errors::{Failure, Outcome};
use crate::hint;
use crate::run;
use crate::scene::Scene;
use crate::stage::Stage;

/// Runs the study in the file `path`, or that of the JSON `text`, into the folder `out`, or a part of it, among the obstacles of `scene` if
/// one is given: what `tdcr study --json`
/// says, and notes on what was passed over in robots' files of other tools. `progress` is told of configurations.
#[pyfunction]
#[pyo3(signature = (path, text, out, part = None, scene = None, progress = None))]
pub fn study(
    py: Python<'_>,
    path: PathBuf,
    text: Option<String>,
    out: PathBuf,
    part: Option<String>,
    scene: Option<PyRef<'_, Scene>>,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<(String, Vec<String>)> {
    let part: Option<Part> = part.map(|part| part.parse()).transpose()?;
    let scene = scene.map(|scene| scene.0.clone());
    let (study, notes) = match text {
        None => Study::load_with_notes(&path, scene.as_ref())?,
        Some(text) => Study::from_json_with_notes(&text, Path::new(""), &path, scene.as_ref())?,
    };
    let finished = run::long(py, progress, |watch| {
        run_study(&study, &out, part, &Stage::new(&["study"], watch))
    })??;
    let notes = notes.iter().map(ToString::to_string).collect();
    Ok((json(&finished)?, notes))
}

/// Puts the parts of a study in folders together in the folder `out`.
#[pyfunction]
pub fn merge_study(py: Python<'_>, parts: Vec<PathBuf>, out: PathBuf) -> Outcome<String> {
    let finished = run::long(py, None, |watch| {
        merge(&parts, &out, &Stage::new(&[], watch))
    })??;
    json(&finished)
}

fn json(finished: &Finished) -> Outcome<String> {
    let text = serde_json::to_string(finished);
    text.map_err(|error| Failure::Of("TdcrError", error.to_string()))
}

impl From<StudyError> for Failure {
    fn from(error: StudyError) -> Self {
        let hint = hint::of_study(&error);
        let class = match error {
            StudyError::Read { .. }
            | StudyError::Parse { .. }
            | StudyError::File { .. }
            | StudyError::Design(_)
            | StudyError::NoPart { .. }
            | StudyError::OtherParts { .. } => "InputError",
            _ => "DataError",
        };
        Self::with_hint(class, &error, hint)
    }
}
