//! Scores of predicted clouds.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use tdcr::learn::data::{PredictedClouds, read_predictions};
use tdcr::learn::train::FlowPredictor;
use tdcr::pages::{Evaluated, evaluation_page};
use tdcr::pipeline::{EvalSettings, Evaluator, Results};

use crate::arrays::contiguous;
use crate::errors::{Failure, Outcome};
use crate::predictor::{Predictor, SamplerOptions};
use crate::run;
use crate::stage::Stage;

/// How clouds are scored, as `tdcr eval` asks for it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct ScoringOptions {
    points: usize,
    emd_points: usize,
    seed: u64,
    worst: usize,
    /// What is scored, as a page on it calls it; `None` for no page.
    report: Option<String>,
}

/// What is scored.
#[derive(FromPyObject)]
pub enum Scored<'py> {
    /// A model, and how its flow is followed.
    Model(PyRef<'py, Predictor>, SamplerOptions),
    /// Clouds (T, N, 3) (m), colours (T, N, 3) and conditions (T, D) of the test commands.
    Clouds(
        PyReadonlyArray3<'py, f32>,
        Option<PyReadonlyArray3<'py, u8>>,
        Option<PyReadonlyArray2<'py, f32>>,
    ),
    /// A file of clouds.
    File(PathBuf),
}

/// Scores clouds on the test commands of the data set in the folder `data`: what `tdcr eval --json` says, and the page where one
/// is asked for.
#[pyfunction]
#[pyo3(signature = (scored, data, options, progress = None))]
pub fn evaluate(
    py: Python<'_>,
    scored: Scored<'_>,
    data: PathBuf,
    options: ScoringOptions,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<(String, Option<String>)> {
    let settings = EvalSettings {
        points: options.points,
        emd_points: options.emd_points,
        seed: options.seed,
    };
    let (model, clouds) = match scored {
        Scored::Model(predictor, sampler) => {
            let model = predictor.model.clone();
            let sampler = sampler.settle(&model)?;
            (Some((model, sampler)), None)
        }
        Scored::Clouds(points, colors, commands) => {
            let clouds = predicted(&points, colors.as_ref(), commands.as_ref())?;
            (None, Some(clouds))
        }
        Scored::File(path) => {
            let read = py.detach(|| read_predictions(&path));
            let clouds = read.map_err(|error| Failure::Of("DataError", error.to_string()))?;
            (None, Some(clouds))
        }
    };
    let (results, page) = run::long(py, progress, |watch| {
        let evaluator = match (&model, clouds) {
            (Some((model, sampler)), _) => {
                let predictor = FlowPredictor::new(model.clone(), *sampler);
                Evaluator::new(Arc::new(predictor), &data, settings)
            }
            (None, clouds) => Evaluator::of_clouds(clouds.unwrap_or_default(), &data, settings),
        }?;
        let evaluation = evaluator.run(None, &Stage::new(&["evaluate"], watch))?;
        let scored = model.as_ref().map(|(model, _)| &**model);
        let results = Results::new(&evaluator, &evaluation, scored, options.worst);
        let page = options.report.as_deref().map(|name| {
            let evaluated = match &model {
                Some((model, sampler)) => Evaluated::Model {
                    file: Path::new(name),
                    model,
                    sampler,
                },
                None => Evaluated::Clouds { name },
            };
            evaluation_page(&evaluated, &data, &evaluator, &evaluation, &results)
        });
        Ok::<_, Failure>((results, page.transpose()?.map(|page| page.to_html())))
    })??;
    let text = serde_json::to_string(&results);
    let text = text.map_err(|error| Failure::Of("TdcrError", error.to_string()))?;
    Ok((text, page))
}

fn predicted(
    points: &PyReadonlyArray3<'_, f32>,
    colors: Option<&PyReadonlyArray3<'_, u8>>,
    commands: Option<&PyReadonlyArray2<'_, f32>>,
) -> Outcome<PredictedClouds> {
    let &[clouds, count, _] = points.shape() else {
        return Err(Failure::input("predictions are no clouds"));
    };
    let shape = [clouds, count, 3];
    let flat = contiguous(points, "predictions", &shape)?;
    let colors = colors.map(|colors| {
        let flat = contiguous(colors, "colors", &shape)?;
        Ok::<_, Failure>(rows(flat.as_chunks().0, count))
    });
    let commands = commands.map(|commands| {
        let dim = commands.shape()[1];
        let flat = contiguous(commands, "commands", &[clouds, dim])?;
        Ok::<_, Failure>(rows(flat, dim))
    });
    Ok(PredictedClouds {
        points: rows(flat.as_chunks().0, count),
        colors: colors.transpose()?,
        commands: commands.transpose()?,
    })
}

/// Rows of `width` entries.
fn rows<T: Clone>(flat: &[T], width: usize) -> Vec<Vec<T>> {
    flat.chunks(width.max(1)).map(<[T]>::to_vec).collect()
}
