//! Data sets: read, made, put together.

use std::ops::ControlFlow;
use std::path::PathBuf;

use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use tdcr::learn::data::{self, DataSet, Meta, PayloadRange, Split, SplitSamples};
use tdcr::pipeline::{self, CollectSettings};

use crate::arrays::array;
use crate::errors::{Failure, Outcome};
use crate::options::options_of;
use crate::robot::Robot;
use crate::run;
use crate::scene::Scene;
use crate::stage::Stage;

/// Samples that are read at once: what an exception waits for, and the memory beside the arrays.
const SAMPLES_AT_ONCE: usize = 32;

/// A data set on disk, of which nothing is kept but its meta and where its samples are.
#[pyclass(frozen, module = "tdcr._tdcr")]
pub struct Dataset {
    set: DataSet,
    splits: [SplitSamples; 3],
}

/// Arrays of samples, before they are arrays.
#[derive(Default)]
struct Numbers {
    conditions: Vec<f32>,
    points: Vec<f32>,
    colors: Vec<u8>,
}

/// Conditions (B, D), points (B, N, 3) (m) and colours (B, N, 3) of samples.
type Samples<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray3<f32>>,
    Bound<'py, PyArray3<u8>>,
);

/// Smallest and largest value of each motor, and the scale of the points (m).
type Units<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, f64);

#[pymethods]
impl Dataset {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> Outcome<Self> {
        py.detach(|| {
            let set = DataSet::open(&path)?;
            let [train, val, test] = Split::ALL.map(|split| set.samples(split));
            let splits = [train?, val?, test?];
            Ok(Self { set, splits })
        })
    }

    /// `meta.json`; none in data sets of other programs.
    fn meta(&self) -> Outcome<Option<String>> {
        let text = self.set.meta().map(serde_json::to_string).transpose();
        text.map_err(|error| Failure::Of("DataError", error.to_string()))
    }

    /// The robot that the clouds show, if the data set says so.
    fn robot(&self) -> Outcome<Option<Robot>> {
        let robot = self.set.meta().and_then(Meta::robot);
        robot.map(|robot| Robot::new(robot.clone())).transpose()
    }

    /// Smallest and largest value of each number of a condition, and the scale of the points.
    fn units<'py>(&self, py: Python<'py>) -> Units<'py> {
        let units = self.set.normalisation();
        let [min, max] =
            [&units.motor_min, &units.motor_max].map(|values| PyArray1::from_slice(py, values));
        (min, max, units.scale)
    }

    /// Samples, points a cloud and numbers a condition of split `split`.
    fn sizes(&self, split: usize) -> Outcome<(usize, usize, usize)> {
        let samples = self.split(split)?;
        Ok((
            samples.len(),
            samples.points_per_cloud(),
            samples.condition_dim(),
        ))
    }

    /// Conditions of split `split`, shape (B, D).
    fn conditions<'py>(&self, py: Python<'py>, split: usize) -> Outcome<Bound<'py, PyArray2<f32>>> {
        let dim = self.split(split)?.condition_dim();
        let conditions = py.detach(|| self.set.conditions(Split::ALL[split]))?;
        let rows: Vec<f32> = conditions.iter().flat_map(|c| c.values()).collect();
        Ok(array(py, rows, [conditions.len(), dim])?)
    }

    /// Samples `start` to before `stop` of split `split`.
    #[pyo3(signature = (split, start, stop, progress = None))]
    fn read<'py>(
        &self,
        py: Python<'py>,
        split: usize,
        start: usize,
        stop: usize,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> Outcome<Samples<'py>> {
        let samples = self.split(split)?;
        let numbers = run::long(py, progress, |watch| {
            let mut numbers = Numbers::default();
            for first in (start..stop).step_by(SAMPLES_AT_ONCE) {
                if watch.stopped() {
                    break;
                }
                let read = samples.read(first..stop.min(first + SAMPLES_AT_ONCE))?;
                for sample in &read {
                    numbers.conditions.extend(sample.condition.values());
                    let points = sample.cloud.points.as_flattened();
                    numbers.points.extend_from_slice(points);
                    let colors = sample.cloud.colors.as_flattened();
                    numbers.colors.extend_from_slice(colors);
                }
                watch.advance(read.len());
            }
            Ok::<_, Failure>(numbers)
        })??;
        let (count, points) = (stop.saturating_sub(start), samples.points_per_cloud());
        Ok((
            array(py, numbers.conditions, [count, samples.condition_dim()])?,
            array(py, numbers.points, [count, points, 3])?,
            array(py, numbers.colors, [count, points, 3])?,
        ))
    }
}

impl Dataset {
    fn split(&self, split: usize) -> Outcome<&SplitSamples> {
        let found = self.splits.get(split);
        found.ok_or_else(|| Failure::input(format!("split {split}; expected 0 to 2")))
    }
}

/// What is wrong with the readable data set in a folder. `progress` is told of shards.
#[pyfunction]
#[pyo3(signature = (path, progress = None))]
pub fn check_data(
    py: Python<'_>,
    path: PathBuf,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<Vec<String>> {
    let findings = run::long(py, progress, |watch| {
        data::check_with(&path, |_, _| {
            watch.advance(1);
            match watch.stopped() {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        })
    })??;
    Ok(findings.iter().map(ToString::to_string).collect())
}

/// Makes a data set, or a part of one, in the folder `out`.
#[pyfunction]
#[pyo3(signature = (robot, scene, out, options, progress = None))]
pub fn collect(
    py: Python<'_>,
    robot: &Robot,
    scene: &Scene,
    out: PathBuf,
    options: &str,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<()> {
    let settings: CollectSettings = options_of(options)?;
    run::long(py, progress, |watch| {
        pipeline::collect(
            robot.0.spec(),
            &scene.0,
            &settings,
            &out,
            &Stage::new(&["collect"], watch),
        )
    })??;
    Ok(())
}

/// Puts the parts of a data set together in the folder `out`.
#[pyfunction]
#[pyo3(signature = (parts, out, progress = None))]
pub fn merge(
    py: Python<'_>,
    parts: Vec<PathBuf>,
    out: PathBuf,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<()> {
    run::long(py, progress, |watch| {
        pipeline::merge(&parts, &out, &Stage::new(&["merge"], watch))
    })??;
    Ok(())
}

/// A range of payloads from its ends (kg).
pub fn payload_range((min, max): (f64, f64)) -> PayloadRange {
    PayloadRange { min, max }
}
