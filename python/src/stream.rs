//! Fresh samples of a simulated robot.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use tdcr::learn::data::{
    Normalisation, ObstacleVariation, Recipe, Sample, Simulator, StreamSpec, Subject,
};
use tdcr::learn::net::Channels;
use tdcr::learn::symmetry::Reduction;
use tdcr::learn::train::Provenance;

use crate::arrays::array;
use crate::data::payload_range;
use crate::errors::{Failure, Outcome, text};
use crate::options::sensor;
use crate::robot::Robot;
use crate::run;
use crate::scene::Scene;
use tdcr::pipeline::visibility;

/// A condition (D,), points (N, 3) and colours (N, 3).
type Arrays<'py> = (
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray2<u8>>,
);

/// The samples `index`, `index + stride`, ... of a stream. Sample `i` is a function of the stream's settings and `i` alone.
///
/// It keeps no threads: a sample is made when it is asked for, by the threads of the process that asks.
#[pyclass(module = "tdcr._tdcr")]
pub struct Stream {
    spec: StreamSpec,
    units: Normalisation,
    reduction: Reduction,
    simulator: Simulator,
    index: u64,
    stride: u64,
}

#[pymethods]
impl Stream {
    #[new]
    #[pyo3(signature = (robot, base, payload, points, voxel, noise, seed, index, stride, reduction, scene=None, vary_obstacles=None))]
    #[expect(clippy::too_many_arguments, reason = "the settings of a stream")]
    fn new(
        robot: &Robot,
        base: bool,
        payload: Option<(f64, f64)>,
        points: usize,
        voxel: f64,
        noise: Option<&str>,
        seed: u64,
        index: u64,
        stride: u64,
        reduction: Option<&str>,
        scene: Option<PyRef<'_, Scene>>,
        vary_obstacles: Option<(f64, f64)>,
    ) -> Outcome<Self> {
        let recipe = Recipe {
            subject: Subject {
                robot: robot.0.spec().clone(),
                base: visibility(base),
                payload: payload.map(payload_range),
                scene: scene.map(|scene| scene.0.clone()).unwrap_or_default(),
                obstacles: vary_obstacles.map(|(shift, turn)| ObstacleVariation { shift, turn }),
            },
            voxel_size: voxel,
            sensor: sensor(noise)?,
        };
        recipe.check()?;
        let spec = StreamSpec {
            recipe,
            points,
            seed,
        };
        let units = spec.normalisation()?;
        let reduction = reduction.map(|text| read_reduction(text, units.motor_min.len()));
        Ok(Self {
            units,
            reduction: reduction.transpose()?.unwrap_or_default(),
            simulator: Simulator::new(&robot.0, &spec.recipe),
            spec,
            index,
            stride,
        })
    }

    /// Index of the next sample.
    #[getter]
    fn index(&self) -> u64 {
        self.index
    }

    /// All settings that samples are functions of, as JSON.
    fn spec(&self) -> Outcome<String> {
        text(serde_json::to_string(&self.spec))
    }

    /// Subject and normalisation of the samples, as JSON.
    fn provenance(&self) -> Outcome<String> {
        text(serde_json::to_string(&Provenance {
            subject: Some(self.spec.recipe.subject.clone()),
            normalisation: self.units.clone(),
            reduction: self.reduction.clone(),
        }))
    }

    /// How samples are reduced by the symmetries that they have, with or without their colours, as JSON, and the same in words.
    fn find_reduction(&self, py: Python<'_>, colors: bool) -> Outcome<(String, String)> {
        let channels = match colors {
            true => Channels::XyzRgb,
            false => Channels::Xyz,
        };
        let recipe = &self.spec.recipe;
        let found = py.detach(|| recipe.symmetries(channels))?;
        Ok((
            text(serde_json::to_string(&found.reduction()))?,
            found.to_string(),
        ))
    }

    /// The next sample, in physical units and then in those of the normalisation: condition, points, colours. After one that
    /// cannot be made, the stream goes on with the next.
    fn next<'py>(&mut self, py: Python<'py>) -> Outcome<(Arrays<'py>, Arrays<'py>)> {
        let (spec, simulator, index) = (&self.spec, &mut self.simulator, self.index);
        // Past the end of 64 bits it starts over, which no run reaches.
        self.index = self.index.wrapping_add(self.stride);
        let sample = run::long(py, None, |_| spec.sample(simulator, index))??;
        let (Sample { condition, cloud }, dimensionless) =
            self.reduction.sample(sample, &self.units)?;
        let metres = cloud.points.into_flattened();
        let mut normalised = metres.clone();
        self.units.normalise_points(&mut normalised);
        let colors = cloud.colors.into_flattened();
        let arrays = |condition: Vec<f32>, points: Vec<f32>| -> PyResult<Arrays<'py>> {
            let shape = [points.len() / 3, 3];
            Ok((
                PyArray1::from_vec(py, condition),
                array(py, points, shape)?,
                array(py, colors.clone(), shape)?,
            ))
        };
        Ok((
            arrays(condition.values().collect(), metres)?,
            arrays(dimensionless, normalised)?,
        ))
    }
}

/// A reduction from JSON, of conditions of so many values, checked.
pub fn read_reduction(text: &str, values: usize) -> Outcome<Reduction> {
    let refuse = |problem: String| Failure::input(format!("the reduction: {problem}"));
    let reduction: Reduction =
        serde_json::from_str(text).map_err(|error| refuse(error.to_string()))?;
    reduction.check(values).map_err(refuse)?;
    Ok(reduction)
}
