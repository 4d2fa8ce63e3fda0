//! Scores of predicted clouds, and data sets beside each other.

use std::path::{Path, PathBuf};

use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use tdcr::learn::data::{PredictedClouds, read_predictions};
use tdcr::pages::{Evaluated, comparison_page, evaluation_page};
use tdcr::pipeline::{
    CompareSettings, Comparer, EvalSettings, Evaluator, Reference, Results, visibility,
};

use crate::arrays::contiguous;
use crate::errors::{Failure, Outcome};
use crate::options::options_of;
use crate::predictor::{Predictor, SamplerOptions};
use crate::robot::Robot;
use crate::run;
use crate::stage::Stage;

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
#[pyo3(signature = (scored, data, options, worst, report, progress = None))]
pub fn evaluate(
    py: Python<'_>,
    scored: Scored<'_>,
    data: PathBuf,
    options: &str,
    worst: usize,
    report: Option<String>,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<(String, Option<String>)> {
    let settings: EvalSettings = options_of(options)?;
    let (model, clouds) = match scored {
        Scored::Model(predictor, sampler) => {
            let model = predictor.model.clone();
            let sampler = sampler.resolve(&model)?;
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
                Evaluator::of_model(model.clone(), *sampler, &data, settings)
            }
            (None, clouds) => Evaluator::of_clouds(clouds.unwrap_or_default(), &data, settings),
        }?;
        let evaluation = evaluator.run(None, &Stage::new(&["evaluate"], watch))?;
        let scored = model.as_ref().map(|(model, _)| &**model);
        let results = Results::new(&evaluator, &evaluation, scored, worst);
        let page = report.as_deref().map(|name| {
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

/// Compares the data set in the folder `a` with that in `b`, or with the simulator: what `tdcr compare --json` says, and the page
/// where one is asked for.
#[pyfunction]
#[pyo3(signature = (a, b, robot, base, options, worst, report, progress = None))]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn compare(
    py: Python<'_>,
    a: PathBuf,
    b: Option<PathBuf>,
    robot: Option<&Robot>,
    base: bool,
    options: &str,
    worst: usize,
    report: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<(String, Option<String>)> {
    let settings: CompareSettings = options_of(options)?;
    let robot = robot.map(|robot| robot.0.spec());
    let (comparison, page) = run::long(py, progress, |watch| {
        let other = match &b {
            Some(b) => Reference::Set(b),
            None => Reference::Simulator {
                robot,
                base: visibility(base),
            },
        };
        let comparer = Comparer::new(&a, other, &settings)?;
        let comparison = comparer.run(worst, &Stage::new(&["compare"], watch))?;
        let page = report.then(|| comparison_page(&a, b.as_deref(), &comparer, &comparison));
        Ok::<_, Failure>((comparison, page.transpose()?.map(|page| page.to_html())))
    })??;
    let text = serde_json::to_string(&comparison);
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
