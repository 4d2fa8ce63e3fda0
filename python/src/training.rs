//! Training runs.

use std::path::PathBuf;

use numpy::PyArray1;
use pyo3::prelude::*;
use tdcr::learn::data::{Recipe, StreamSpec, Subject};
use tdcr::learn::net::{Channels, ContextLayers, ContextShape, Precision, TimeFeatures};
use tdcr::learn::symmetry::SymmetryUse;
use tdcr::learn::train::{Model, Optimizer, TrainSettings};
use tdcr::pipeline::{self, Preset, StreamSettings, TrainPlan, Trained, TrainingData};

use crate::data::{payload_range, sensor, visibility};
use crate::errors::{Failure, Outcome, choice};
use crate::predictor::named_precision;
use crate::robot::Robot;
use crate::run;
use crate::stage::Stage;

/// Loss of every step; steps of validations and their Chamfer distances (m²); operand type of the products.
type Run<'py> = (
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<u64>>,
    Bound<'py, PyArray1<f64>>,
    &'static str,
);

/// What a run is asked for, as `tdcr train` takes it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct TrainOptions {
    preset: String,
    width: Option<usize>,
    depth: Option<usize>,
    embedding: Option<usize>,
    condition_blocks: Option<usize>,
    octaves: Option<usize>,
    time_features: Option<String>,
    context: Option<Context>,
    colors: Option<bool>,
    color_weight: Option<f32>,
    steps: Option<u64>,
    clouds: Option<usize>,
    points: Option<usize>,
    precision: Option<String>,
    optimizer: Option<String>,
    learning_rate: Option<f64>,
    warmup: Option<u64>,
    validate_every: Option<u64>,
    patience: Option<u64>,
    coupling: String,
    time_exponent: f32,
    late_times: Option<f32>,
    prior_cut: Option<f32>,
    refinement_steps: Option<u64>,
    surface_prior: Option<Py<Robot>>,
    symmetry: Option<String>,
    prior_deviation: Option<f32>,
    seed: u64,
}

/// The use of symmetries of this name.
pub fn named_symmetry(name: &str) -> Outcome<SymmetryUse> {
    choice(
        "symmetry",
        name,
        &SymmetryUse::ALL.map(|one| (one.name(), one)),
    )
}

/// The features of the flow time of this name.
fn named_time_features(name: &str) -> Outcome<TimeFeatures> {
    choice(
        "time_features",
        name,
        &TimeFeatures::ALL.map(|one| (one.name(), one)),
    )
}

/// Sizes of the context network of a hybrid.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Context {
    layers: Option<String>,
    channels: Option<[usize; 3]>,
    resolutions: Option<[usize; 3]>,
    blocks: Option<usize>,
    context: Option<usize>,
}

/// A stream that takes the place of a data set.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct StreamOptions {
    base: bool,
    payload: Option<(f64, f64)>,
    stream_points: usize,
    voxel: f64,
    noise: Option<String>,
    window: usize,
    fresh: usize,
    validation: Option<PathBuf>,
}

/// What a run trains on.
#[derive(FromPyObject)]
pub enum Source<'py> {
    /// Robot and options of a stream.
    Stream(PyRef<'py, Robot>, StreamOptions),
    /// Folder of a data set, and the model in whose units it is to be read.
    Set(PathBuf, Option<PathBuf>),
}

impl Context {
    fn shape(&self, preset: &Preset) -> Outcome<ContextShape> {
        let layers = match &self.layers {
            None => preset.layers,
            Some(name) => {
                let all = ContextLayers::ALL.map(|layers| (layers.name(), layers));
                choice("layers", name, &all)?
            }
        };
        let mut shape = ContextShape::of(layers);
        for (stage, size) in shape.stages.iter_mut().enumerate() {
            size.channels = self
                .channels
                .map_or(size.channels, |channels| channels[stage]);
            size.resolution = self
                .resolutions
                .map_or(size.resolution, |edges| edges[stage]);
        }
        shape.blocks = self.blocks.unwrap_or(shape.blocks);
        shape.features = self.context.unwrap_or(shape.features);
        Ok(shape)
    }
}

impl TrainOptions {
    fn plan(&self) -> Outcome<TrainPlan> {
        let optimizers = [("adamw", Optimizer::AdamW), ("muon", Optimizer::MUON)];
        let optimizer = self.optimizer.as_deref();
        let optimizer = optimizer.map(|name| choice("optimizer", name, &optimizers));
        let precision = self.precision.as_deref().map(named_precision);
        let usual = TrainPlan::default();
        let presets = Preset::ALL.map(|preset| (preset.name, preset));
        let preset = choice("preset", &self.preset, &presets)?;
        let context = self.context.as_ref();
        Ok(TrainPlan {
            preset,
            width: self.width,
            depth: self.depth,
            embedding: self.embedding,
            condition_blocks: self.condition_blocks,
            octaves: self.octaves,
            time_features: (self.time_features.as_deref())
                .map(named_time_features)
                .transpose()?,
            context: context.map(|context| context.shape(&preset)).transpose()?,
            channels: self.colors.map(|colors| match colors {
                true => Channels::XyzRgb,
                false => Channels::Xyz,
            }),
            color_weight: self.color_weight.unwrap_or(usual.color_weight),
            steps: self.steps,
            clouds: self.clouds,
            points: self.points,
            precision: precision.transpose()?,
            optimizer: optimizer.transpose()?,
            learning_rate: self.learning_rate,
            warmup_steps: self.warmup,
            validate_every: self.validate_every,
            patience: self.patience,
            coupling: self.coupling.parse()?,
            time_exponent: self.time_exponent,
            late_times: self.late_times,
            prior_cut: self.prior_cut,
            refinement_steps: self.refinement_steps,
            surface_prior: (self.surface_prior.as_ref()).map(|robot| robot.get().0.spec().clone()),
            symmetry: self.symmetry.as_deref().map(named_symmetry).transpose()?,
            prior_deviation: self.prior_deviation,
            seed: self.seed,
        })
    }
}

impl Source<'_> {
    fn data(&self, seed: u64) -> Outcome<TrainingData> {
        Ok(match self {
            Self::Set(dir, None) => TrainingData::Set(dir.clone()),
            Self::Set(dir, Some(model)) => {
                let units = Model::load(model)?.provenance.normalisation;
                TrainingData::SetIn(dir.clone(), Box::new(units))
            }
            Self::Stream(robot, options) => {
                let subject = Subject {
                    robot: robot.0.spec().clone(),
                    base: visibility(options.base),
                    payload: options.payload.map(payload_range),
                };
                let recipe = Recipe {
                    subject,
                    voxel_size: options.voxel,
                    sensor: sensor(options.noise.as_deref())?,
                };
                TrainingData::Stream(Box::new(StreamSettings {
                    spec: StreamSpec {
                        recipe,
                        points: options.stream_points,
                        seed,
                    },
                    window: options.window,
                    fresh: options.fresh,
                    validation: options.validation.clone(),
                }))
            }
        })
    }
}

/// Trains a network in the folder `out`.
#[pyfunction]
#[pyo3(signature = (source, out, options, init = None, progress = None))]
pub fn train<'py>(
    py: Python<'py>,
    source: Source<'py>,
    out: PathBuf,
    options: TrainOptions,
    init: Option<PathBuf>,
    progress: Option<&Bound<'py, PyAny>>,
) -> Outcome<Run<'py>> {
    let data = source.data(options.seed)?;
    let plan = options.plan()?;
    let (trained, precision) = run::long(py, progress, |watch| {
        let (size, settings) = plan.settle(&data)?;
        let initial = init.map(|file| Model::load(&file)).transpose()?;
        let stage = Stage::new(&["train"], watch);
        let trained = pipeline::train(&data, &out, size, &settings, initial.as_ref(), &stage)?;
        Ok::<_, Failure>((trained, settings.precision))
    })??;
    Ok(told(py, &trained, precision))
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
        let sampler = pipeline::student_sampler(options.evaluations, options.power);
        let width = teacher.network.shape().width();
        let settings = TrainSettings {
            seed: options.seed,
            precision: precision.unwrap_or_else(|| Precision::fastest(width)),
            ..pipeline::distillation(&teacher.settings, sampler, options.steps)
        };
        let stage = Stage::new(&["train"], watch);
        let trained = pipeline::distill(&teacher, &data, &out, &settings, &stage)?;
        Ok::<_, Failure>((trained, settings.precision))
    })??;
    Ok(told(py, &trained, precision))
}

fn told<'py>(py: Python<'py>, trained: &Trained, precision: Precision) -> Run<'py> {
    let steps = trained.validations.iter().map(|(step, _)| *step);
    let distances = trained.validations.iter().map(|(_, distance)| *distance);
    (
        PyArray1::from_slice(py, &trained.losses),
        PyArray1::from_iter(py, steps),
        PyArray1::from_iter(py, distances),
        precision.name(),
    )
}
