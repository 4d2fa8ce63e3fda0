//! Scores of predicted clouds, and data sets beside each other.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use tdcr::learn::data::{PredictedClouds, read_predictions};
use tdcr::learn::flow::Sampler;
use tdcr::learn::train::Model;
use tdcr::pages::{Evaluated, comparison_page, evaluation_page, methods_page};
use tdcr::pipeline::{
    CompareSettings, Comparer, EvalSettings, Evaluator, Reference, Results, ScoredMethod,
    visibility,
};

use crate::arrays::contiguous;
use crate::errors::{Failure, Outcome};
use crate::options::options_of;
use crate::predictor::{Predictor, SamplerOptions};
use crate::robot::Robot;
use crate::run;
use crate::stage::Stage;

/// What is scored: its name where it has one, and where its clouds come from.
#[derive(FromPyObject)]
pub struct Named<'py>(Option<String>, Source<'py>);

/// Where clouds come from.
#[derive(FromPyObject)]
pub enum Source<'py> {
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

/// What a page says of a method.
enum Shown {
    Model(PathBuf, Arc<Model>, Sampler),
    Clouds(String),
}

impl Shown {
    fn evaluated(&self) -> Evaluated<'_> {
        match self {
            Self::Clouds(name) => Evaluated::Clouds { name },
            Self::Model(file, model, sampler) => Evaluated::Model {
                file,
                model,
                sampler,
            },
        }
    }
}

impl Named<'_> {
    /// The method, one of several or alone, and what a page says of it under `label`.
    fn method(self, py: Python<'_>, label: &str, several: bool) -> Outcome<(ScoredMethod, Shown)> {
        let Self(name, source) = self;
        let clouds = || Shown::Clouds(label.to_owned());
        let (method, shown) = match source {
            Source::Model(predictor, sampler) => {
                let model = predictor.model.clone();
                let sampler = sampler.resolve(&model)?;
                let method = ScoredMethod::of_model(model.clone(), sampler)?;
                (method, Shown::Model(label.into(), model, sampler))
            }
            Source::Clouds(points, colors, commands) => {
                let clouds_given = predicted(&points, colors.as_ref(), commands.as_ref())?;
                (ScoredMethod::of_clouds(clouds_given), clouds())
            }
            Source::File(path) => {
                let read = py.detach(|| read_predictions(&path));
                let read = read.map_err(|error| Failure::Of("DataError", error.to_string()))?;
                let method = ScoredMethod::of_clouds(read);
                let method = match several {
                    true => method.read_in(&path),
                    false => method,
                };
                (method, clouds())
            }
        };
        Ok(match name {
            Some(name) => (method.named(&name), shown),
            None => (method, shown),
        })
    }
}

/// Scores methods on the test commands of the data set in the folder `data`: what `tdcr eval --json` says, and the page where one
/// is asked for, which calls them by `labels`.
#[pyfunction]
#[pyo3(signature = (scored, labels, data, options, worst, report, progress = None))]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn evaluate(
    py: Python<'_>,
    scored: Vec<Named<'_>>,
    labels: Vec<String>,
    data: PathBuf,
    options: &str,
    worst: usize,
    report: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<(String, Option<String>)> {
    let settings: EvalSettings = options_of(options)?;
    let several = scored.len() > 1;
    let named = scored.into_iter().zip(&labels);
    let methods = named.map(|(method, label)| method.method(py, label, several));
    let (methods, shown): (Vec<_>, Vec<_>) =
        methods.collect::<Outcome<Vec<_>>>()?.into_iter().unzip();
    let (results, page) = run::long(py, progress, |watch| {
        let evaluator = Evaluator::of_methods(methods, &data, settings)?;
        let evaluation = evaluator.run(None, &Stage::new(&["evaluate"], watch))?;
        let evaluated: Vec<Evaluated<'_>> = shown.iter().map(Shown::evaluated).collect();
        let alone = (!several).then(|| evaluated.first()).flatten();
        let model = alone.and_then(Evaluated::model);
        let results = Results::new(&evaluator, &evaluation, model, worst);
        let page = || match alone {
            Some(one) => {
                let page = evaluation_page(one, &data, &evaluator, &evaluation, &results)?;
                Ok::<_, Failure>(page.to_html())
            }
            None => {
                let page = methods_page(&evaluated, &data, &evaluator, &evaluation, &results)?;
                Ok(page.to_html())
            }
        };
        let page = report.then(page).transpose()?;
        Ok::<_, Failure>((results, page))
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
        ..PredictedClouds::default()
    })
}

/// Rows of `width` entries.
fn rows<T: Clone>(flat: &[T], width: usize) -> Vec<Vec<T>> {
    flat.chunks(width.max(1)).map(<[T]>::to_vec).collect()
}
