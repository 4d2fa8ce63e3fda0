//! Trained models, and the clouds that they predict.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{
    PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use rayon::prelude::*;
use serde_json::json;
use tdcr::learn::flow::{Method, Sampler};
use tdcr::learn::net::Precision;
use tdcr::learn::predict::Prediction;
use tdcr::learn::train::Model;
use tdcr::pipeline::SamplerPlan;
use tdcr::reach::{CloudSearch, reach_cloud};
use tdcr::sim::robot::Loads;

use crate::arrays::{array, contiguous};
use crate::errors::{Failure, Outcome, choice};
use crate::robot::Robot;
use crate::run::{self, Watch};

/// A trained model in the precision that it predicts in.
#[pyclass(frozen, module = "tdcr._tdcr")]
pub struct Predictor {
    pub model: Arc<Model>,
}

/// How a prediction follows the flow, as `tdcr predict` asks for it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct SamplerOptions {
    sampler: Option<String>,
    sampler_steps: Option<usize>,
    sampler_power: Option<f32>,
    sampler_tolerance: Option<f32>,
    sampler_denoise: Option<f32>,
    sampler_spare: Option<f32>,
}

/// What is predicted of each condition, as `tdcr predict` asks for it.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct PredictOptions {
    points: usize,
    seed: u64,
    sampler: SamplerOptions,
    /// Clouds that an uncertainty is estimated from; 0 for none.
    prior_samples: u64,
}

/// Points (B, N, 3) (m), colours (B, N, 3) where there are any, uncertainties (B, N) (m) where they are asked for and can be
/// told, evaluations (B,).
type Clouds<'py> = (
    Bound<'py, PyArray3<f32>>,
    Option<Bound<'py, PyArray3<u8>>>,
    Option<Bound<'py, PyArray2<f32>>>,
    Bound<'py, PyArray1<u32>>,
);

/// A prediction, and the uncertainty of each point.
type Cloud = (Prediction, Option<Vec<f32>>);

#[pymethods]
impl Predictor {
    #[new]
    #[pyo3(signature = (path, precision = None))]
    fn load(py: Python<'_>, path: PathBuf, precision: Option<&str>) -> Outcome<Self> {
        let asked = precision.map(named_precision).transpose()?;
        run::long(py, None, |_| {
            let model = Model::load(&path)?;
            let width = model.network.shape().width();
            let precision = asked.unwrap_or_else(|| Precision::fastest(width));
            let model = model.with_precision(precision);
            let model = model.map_err(|error| Failure::input(error.to_string()))?;
            let model = Arc::new(model);
            Ok(Self { model })
        })?
    }

    /// Writes the model to a file.
    fn save(&self, py: Python<'_>, path: PathBuf) -> Outcome<()> {
        Ok(py.detach(|| self.model.save(&path))?)
    }

    /// What is known of the model but for its weights.
    fn about(&self) -> Outcome<String> {
        let Model {
            provenance,
            settings,
            step,
            validation_distance,
            network,
            refinement,
            reach: _,
            uncertainty_factor,
        } = &*self.model;
        let about = json!({
            "provenance": provenance,
            "settings": settings,
            "shape": network.shape(),
            "step": step,
            "validation_cd": validation_distance * provenance.normalisation.scale.powi(2),
            "parameters": network.shape().learned_parameters(),
            "precision": network.precision().name(),
            "refined": refinement.is_some(),
            "uncertainty_factor": uncertainty_factor,
            "colors": network.shape().channels().count() > 3,
        });
        Ok(about.to_string())
    }

    /// The robot of the training clouds, if they said so.
    fn robot(&self) -> Outcome<Option<Robot>> {
        let subject = self.model.provenance.subject.as_ref();
        subject
            .map(|subject| Robot::new(subject.robot.clone()))
            .transpose()
    }

    /// Smallest and largest value of each number of a condition in training, and the scale of the points (m).
    fn units<'py>(
        &self,
        py: Python<'py>,
    ) -> (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, f64) {
        let units = &self.model.provenance.normalisation;
        let [min, max] =
            [&units.motor_min, &units.motor_max].map(|values| PyArray1::from_slice(py, values));
        (min, max, units.scale)
    }

    /// Clouds under conditions (B, D), each from the noise of the same seed.
    #[pyo3(signature = (conditions, options, progress = None))]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        conditions: PyReadonlyArray2<'py, f64>,
        options: PredictOptions,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> Outcome<Clouds<'py>> {
        let PredictOptions {
            points,
            seed,
            ref sampler,
            prior_samples,
        } = options;
        let sampler = sampler.resolve(&self.model)?;
        let (rows, dim) = (
            conditions.shape()[0],
            self.model.provenance.normalisation.motor_min.len(),
        );
        let values = contiguous(&conditions, "conditions", &[rows, dim])?;
        for (row, condition) in values.chunks_exact(dim).enumerate() {
            let checked = self.check(condition);
            checked.map_err(|failure| {
                if rows == 1 {
                    failure
                } else {
                    failure.of_row(row)
                }
            })?;
        }
        let sample = |condition: &[f64], k: u64| {
            (self.model).predict(condition, points, seed.wrapping_add(k), &sampler)
        };
        let cloud = |watch: &Watch, condition: &[f64]| -> Outcome<Option<Cloud>> {
            if watch.stopped() {
                return Ok(None);
            }
            let first = sample(condition, 0)?;
            let others: Result<Vec<_>, _> =
                (1..prior_samples).map(|k| sample(condition, k)).collect();
            let uncertainty = match prior_samples {
                0 => None,
                _ => first.uncertainty(&others?),
            };
            watch.advance(1);
            Ok(Some((first, uncertainty)))
        };
        let found: Vec<Outcome<Option<Cloud>>> = run::long(py, progress, |watch| {
            let rows = values.par_chunks_exact(dim);
            rows.map(|condition| cloud(watch, condition)).collect()
        })?;
        // None is left out: a call that is stopped has ended above.
        let found: Outcome<Vec<Cloud>> = found.into_iter().filter_map(Result::transpose).collect();
        arrays(py, &found?, points)
    }

    /// The condition, from `start` (D,) on, whose predicted cloud is nearest to a cloud (N, 3) (m): it, the mean distances (m) before the
    /// first step and after each, and the predicted cloud.
    fn reach<'py>(
        &self,
        py: Python<'py>,
        cloud: PyReadonlyArray2<'py, f32>,
        start: PyReadonlyArray1<'py, f64>,
        options: ReachOptions,
    ) -> Outcome<Reached<'py>> {
        let dim = self.model.provenance.normalisation.motor_min.len();
        let start = contiguous(&start, "start", &[dim])?;
        self.check(start)?;
        let count = cloud.shape()[0];
        let wanted = contiguous(&cloud, "cloud", &[count, 3])?.as_chunks::<3>().0;
        let sampler = options.sampler.resolve(&self.model)?;
        let search = CloudSearch {
            steps: options.steps,
            points: options.points,
            tolerance: options.tolerance,
            seed: options.seed,
        };
        let found = run::long(py, None, |watch| {
            reach_cloud(&self.model, &sampler, wanted, start, &search, &mut || {
                !watch.stopped()
            })
        })?;
        let found = found.map_err(|error| Failure::input(error.to_string()))?;
        let points = found.cloud.len();
        Ok((
            PyArray1::from_vec(py, found.condition),
            PyArray1::from_vec(py, found.distances),
            array(py, found.cloud.into_flattened(), [points, 3])?,
        ))
    }
}

/// How a command is looked for.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct ReachOptions {
    steps: usize,
    points: usize,
    tolerance: f64,
    seed: u64,
    sampler: SamplerOptions,
}

/// A condition (D,), mean distances (m), a cloud (N, 3) (m).
type Reached<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f32>>,
);

impl Predictor {
    /// Refuses a condition that the robot cannot be under.
    fn check(&self, condition: &[f64]) -> Outcome<()> {
        let Some(subject) = &self.model.provenance.subject else {
            return Ok(());
        };
        let robot = tdcr::sim::robot::Robot::new(subject.robot.clone())?;
        let (command, payload) = match (subject.payload, condition.split_last()) {
            (Some(_), Some((payload, command))) => (command, Some(*payload)),
            _ => (condition, None),
        };
        robot.command(command)?;
        payload.map_or(Ok(()), |mass| Loads::payload(mass).map(drop))?;
        Ok(())
    }
}

fn arrays<'py>(py: Python<'py>, found: &[Cloud], points: usize) -> Outcome<Clouds<'py>> {
    let shape = [found.len(), points, 3];
    let coordinates = found
        .iter()
        .flat_map(|(cloud, _)| cloud.points.as_flattened());
    let coordinates = array(py, coordinates.copied().collect(), shape)?;
    let colors: Option<Vec<u8>> = (found.iter())
        .map(|(cloud, _)| cloud.colors.as_deref())
        .collect::<Option<Vec<_>>>()
        .map(|colors| colors.concat().concat());
    let uncertainties: Option<Vec<f32>> = (found.iter())
        .map(|(_, uncertainty)| uncertainty.as_deref())
        .collect::<Option<Vec<_>>>()
        .map(|rows| rows.concat());
    let evaluations = found.iter().map(|(cloud, _)| cloud.evaluations as u32);
    Ok((
        coordinates,
        colors.map(|colors| array(py, colors, shape)).transpose()?,
        uncertainties
            .map(|rows| array(py, rows, [found.len(), points]))
            .transpose()?,
        PyArray1::from_iter(py, evaluations),
    ))
}

impl SamplerOptions {
    /// The sampler for a model.
    pub fn resolve(&self, model: &Model) -> Outcome<Sampler> {
        let methods = Method::ALL.map(|method| (method.name(), method));
        let method = self.sampler.as_deref();
        let method = method.map(|name| choice("sampler", name, &methods));
        let plan = SamplerPlan {
            sampler: method.transpose()?,
            sampler_steps: self.sampler_steps,
            sampler_power: self.sampler_power,
            sampler_tolerance: self.sampler_tolerance,
            sampler_denoise: self.sampler_denoise,
            sampler_spare: self.sampler_spare,
        };
        Ok(plan.resolve(model)?)
    }
}

/// An operand type by its name.
pub fn named_precision(name: &str) -> Outcome<Precision> {
    let known = Precision::ALL.map(|precision| (precision.name(), precision));
    choice("precision", name, &known)
}
