//! Training runs.

use std::path::PathBuf;

use numpy::PyArray1;
use pyo3::prelude::*;
use tdcr::learn::net::Precision;
use tdcr::learn::options::{self, Resolved, TrainOptions};
use tdcr::learn::symmetry::SymmetryUse;
use tdcr::learn::train::{Model, TrainSettings};
use tdcr::pipeline::{self, StreamOptions, Trained, TrainingData};

use crate::errors::{Failure, Outcome, choice, text};
use crate::options::options_of;
use crate::predictor::named_precision;
use crate::robot::Robot;
use crate::run;
use crate::scene::Scene;
use crate::stage::Stage;

/// Loss of every step; steps of validations and their Chamfer distances (m²); operand type of the products.
type Run<'py> = (
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<u64>>,
    Bound<'py, PyArray1<f64>>,
    &'static str,
);

/// Every option of a run: name, kind, placeholder, choices, whether it may be left out, help, heading; as JSON.
#[pyfunction]
pub fn train_options() -> Outcome<String> {
    text(serde_json::to_string(&options::cli::options()))
}

/// The use of symmetries of this name.
pub fn named_symmetry(name: &str) -> Outcome<SymmetryUse> {
    choice(
        "symmetry",
        name,
        &SymmetryUse::ALL.map(|one| (one.name(), one)),
    )
}

/// What a run trains on.
#[derive(FromPyObject)]
pub enum Source<'py> {
    /// Robot of a stream, options in JSON, and a scene.
    Stream(PyRef<'py, Robot>, String, Option<PyRef<'py, Scene>>),
    /// Folder of a data set.
    Set(PathBuf),
}

impl Source<'_> {
    fn data(&self, asked: &TrainOptions) -> Outcome<TrainingData> {
        Ok(match (self, &asked.normalisation_from) {
            (Self::Set(dir), None) => TrainingData::Set(dir.clone()),
            (Self::Set(dir), Some(model)) => {
                let units = Model::load(model)?.provenance.normalisation;
                TrainingData::SetIn(dir.clone(), Box::new(units))
            }
            (Self::Stream(robot, options, scene), _) => {
                let options: StreamOptions = options_of(options)?;
                let scene = (scene.as_ref()).map_or_else(Default::default, |scene| scene.0.clone());
                let stream = options.settings(robot.0.spec().clone(), scene, asked.seed);
                TrainingData::Stream(Box::new(stream))
            }
        })
    }
}

/// Trains a network in the folder `out`, with options in JSON but for the robot of the prior.
#[pyfunction]
#[pyo3(signature = (source, out, options, surface_prior = None, progress = None))]
pub fn train<'py>(
    py: Python<'py>,
    source: Source<'py>,
    out: PathBuf,
    options: &str,
    surface_prior: Option<PyRef<'py, Robot>>,
    progress: Option<&Bound<'py, PyAny>>,
) -> Outcome<Run<'py>> {
    let mut options = options_of::<TrainOptions>(options)?;
    options.surface_prior = surface_prior.map(|robot| robot.0.spec().clone().into());
    options.check()?;
    let data = source.data(&options)?;
    let (trained, precision) = run::long(py, progress, |watch| {
        let Resolved { shape, settings } = options.resolve(&data.facts()?)?;
        let initial = options.init.as_deref().map(Model::load).transpose()?;
        let stage = Stage::new(&["train"], watch);
        let trained = pipeline::train(&data, &out, shape, &settings, initial.as_ref(), &stage)?;
        Ok::<_, Failure>((trained, settings.precision))
    })??;
    Ok(arrays_of_run(py, &trained, precision))
}

/// What a distillation is asked for, as `tdcr distill` takes it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct DistillOptions {
    evaluations: usize,
    power: f32,
    steps: u64,
    precision: Option<String>,
    seed: u64,
}

/// Distils the model in the file `model` in the folder `out`.
#[pyfunction]
#[pyo3(signature = (model, data, out, options, progress = None))]
pub fn distill<'py>(
    py: Python<'py>,
    model: PathBuf,
    data: PathBuf,
    out: PathBuf,
    options: DistillOptions,
    progress: Option<&Bound<'py, PyAny>>,
) -> Outcome<Run<'py>> {
    let precision = options.precision.as_deref().map(named_precision);
    let precision = precision.transpose()?;
    let (trained, precision) = run::long(py, progress, |watch| {
        let teacher = Model::load(&model)?;
        let width = teacher.network.shape().width();
        let settings = TrainSettings {
            seed: options.seed,
            precision: precision.unwrap_or_else(|| Precision::fastest(width)),
            ..pipeline::distillation(&teacher, options.evaluations, options.power, options.steps)
        };
        let stage = Stage::new(&["train"], watch);
        let trained = pipeline::distill(&teacher, &data, &out, &settings, &stage)?;
        Ok::<_, Failure>((trained, settings.precision))
    })??;
    Ok(arrays_of_run(py, &trained, precision))
}

fn arrays_of_run<'py>(py: Python<'py>, trained: &Trained, precision: Precision) -> Run<'py> {
    let steps = trained.validations.iter().map(|(step, _)| *step);
    let distances = trained.validations.iter().map(|(_, distance)| *distance);
    (
        PyArray1::from_slice(py, &trained.losses),
        PyArray1::from_iter(py, steps),
        PyArray1::from_iter(py, distances),
        precision.name(),
    )
}
