//! Tips led along paths by controllers: of simulated robots, and of plants of one's own.

use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use tdcr::control::plant::{Measurement, Plant, PlantError, Sighting};
use tdcr::control::tip_path::TipPath;
use tdcr::control::tracking::{Tracking, TrackingError};
use tdcr::pipeline::PipelineError;
use tdcr::sim::inverse::recording::Marker;
use tdcr::sim::robot::Command;
use tdcr::track::{
    self, ControllerName, Model, TrackError, TrackOptions, TrackSummary, Tracked, TruthOptions,
};

use crate::arrays::{array, contiguous};
use crate::errors::{Failure, Outcome};
use crate::rig::Rig;
use crate::robot::Robot;
use crate::run;
use crate::scene::Scene;

/// Period (s), approach (s), largest rate (1/s in the command's unit), tensions (N), trials.
type Options = (Option<f64>, f64, Option<f64>, Option<[f64; 2]>, usize);

/// Payload (kg), friction, backlash, error of spools, delay (s), how it is seen, noise of tensions (N), time step (s).
type Different = (f64, f64, f64, f64, f64, String, Option<f64>, Option<f64>);

/// Times, targets, tips, commands, tensions, estimates and their deviations, by periods; NaN where a number is not known.
type Rows<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
);

/// A path.
#[pyclass(frozen, module = "tdcr._tdcr")]
pub struct TipPathOf(TipPath);

#[pymethods]
impl TipPathOf {
    /// A curve by its name.
    #[staticmethod]
    fn curve(
        robot: PyRef<'_, Robot>,
        name: &str,
        centre: Option<[f64; 3]>,
        diameter: f64,
        duration: f64,
    ) -> Outcome<Self> {
        let Some(shape) = track::curve_named(name) else {
            return Err(Failure::input(format!(
                "path is '{name}'; expected 'circle', 'eight', 'square', 'lissajous', or rows of t, x, y, z (s, m)"
            )));
        };
        Ok(Self(track::closed_path(
            &robot.0, shape, centre, diameter, duration,
        )?))
    }

    /// Rows of t, x, y, z (s, m).
    #[staticmethod]
    fn rows(rows: PyReadonlyArray2<'_, f64>) -> Outcome<Self> {
        let count = numpy::PyUntypedArrayMethods::shape(&*rows)[0];
        let flat = contiguous(&rows, "path", &[count, 4])?;
        let path = track::path_of_rows(flat.as_chunks::<4>().0).map_err(TrackError::from)?;
        Ok(Self(path))
    }
}

fn options(
    controller: &str,
    (period, approach, rate, tension, trials): Options,
    seed: u64,
) -> Outcome<TrackOptions> {
    let named = ControllerName::ALL
        .into_iter()
        .find(|known| known.name() == controller);
    let Some(controller) = named else {
        let known = ControllerName::ALL.map(ControllerName::name).join("', '");
        let message = format!("controller is '{controller}'; expected one of '{known}'");
        return Err(Failure::input(message));
    };
    Ok(TrackOptions {
        controller,
        period,
        approach,
        rate,
        tension,
        trials,
        seed,
    })
}

/// Leads the tip of a simulated robot, which stands `around` obstacles and is modelled among those of `scene`, along a path: what `tdcr track --json` prints, the rows, times and errors of the open loop, and the
/// page.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn track_simulated<'py>(
    py: Python<'py>,
    robot: PyRef<'_, Robot>,
    truth: PyRef<'_, Robot>,
    scene: PyRef<'_, Scene>,
    around: PyRef<'_, Scene>,
    path: PyRef<'_, TipPathOf>,
    controller: &str,
    settings: Options,
    different: Different,
    seed: u64,
) -> Outcome<(String, Rows<'py>, Bound<'py, PyArray2<f64>>, String)> {
    let options = options(controller, settings, seed)?;
    let (payload, friction, backlash, gain_error, delay, noise, tension_noise, timestep) =
        different;
    let different = TruthOptions {
        payload,
        friction,
        backlash,
        gain_error,
        delay,
        noise: noise
            .parse()
            .map_err(|error| Failure::input(format!("noise: {error}")))?,
        tension_noise,
        timestep,
    };
    let truth = different.truth(truth.0.spec(), around.0.clone(), &options)?;
    let (robot, path) = (&robot.0, &path.0);
    let model = Model {
        robot,
        scene: &scene.0,
    };
    let tracked = run::long(py, None, |watch| {
        track::track_simulated(model, &truth, path, &options, &mut |_| !watch.stopped())
    })??;
    let open_loop = tracked.open_loop.as_ref().unwrap_or(&tracked.run).errors();
    let errors = array(py, open_loop.concat(), [open_loop.len(), 2])?;
    let page = track::page(robot, &tracked, Vec::new()).to_html();
    Ok((
        summary(robot, &tracked)?,
        rows(py, &tracked.run)?,
        errors,
        page,
    ))
}

/// Leads the tip of a plant of one's own along a path, from the command `start` or the model's at the path's first point.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn track_plant<'py>(
    py: Python<'py>,
    plant: Bound<'py, PyAny>,
    robot: PyRef<'_, Robot>,
    scene: PyRef<'_, Scene>,
    path: PyRef<'_, TipPathOf>,
    start: Option<PyReadonlyArray1<'_, f64>>,
    controller: &str,
    settings: Options,
    seed: u64,
) -> Outcome<(String, Rows<'py>, String)> {
    let mut options = options(controller, settings, seed)?;
    let (robot, path) = (&robot.0, &path.0);
    let model = Model {
        robot,
        scene: &scene.0,
    };
    let start = match start {
        Some(start) => robot.command(contiguous(&start, "start", &[robot.tendons().len()])?)?,
        None => run::long(py, None, |_| track::first_command(model, path, seed))??,
    };
    let period: f64 = plant.call_method0("period")?.extract()?;
    if !(period.is_finite() && period > 0.0) {
        let message = format!("the plant's period is {period} s; expected a finite number above 0");
        return Err(Failure::input(message));
    }
    options.period = Some(period);
    let mut own = OwnPlant {
        object: &plant,
        period,
        tip: robot.discs().len() - 1,
        tendons: robot.tendons().len(),
    };
    let mut go_on = |_: &_| py.check_signals().is_ok();
    let (run, trials) = track::track_plant(&mut own, model, &start, path, &options, &mut go_on)?;
    let tracked = Tracked {
        run,
        trials,
        open_loop: None,
        period,
        payload: f64::NAN,
        late: 0,
    };
    let page = track::page(robot, &tracked, Vec::new()).to_html();
    Ok((summary(robot, &tracked)?, rows(py, &tracked.run)?, page))
}

/// Leads the tip of a rig's robot along a path, modelled among the obstacles of `scene`, else of the rig's own; `payload` (kg) hangs from a simulated one's tip.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn track_rig<'py>(
    py: Python<'py>,
    rig: PyRef<'_, Rig>,
    scene: Option<PyRef<'_, Scene>>,
    path: PyRef<'_, TipPathOf>,
    payload: f64,
    controller: &str,
    settings: Options,
    seed: u64,
) -> Outcome<(String, Rows<'py>, String)> {
    let options = options(controller, settings, seed)?;
    let (scene, path) = (scene.as_ref().map(|scene| &scene.0), &path.0);
    let (robot, tracked) = rig.long(py, |rig, watch| {
        let goes_on = || !watch.stopped();
        let tracked = track::track_rig(rig, scene, path, payload, &options, &goes_on, &mut |_| {});
        (rig.robot().clone(), tracked)
    })?;
    let tracked = tracked?;
    let page = track::page(&robot, &tracked, Vec::new()).to_html();
    Ok((summary(&robot, &tracked)?, rows(py, &tracked.run)?, page))
}

/// A plant that a Python object is.
struct OwnPlant<'a, 'py> {
    object: &'a Bound<'py, PyAny>,
    period: f64,
    /// The distal disc.
    tip: usize,
    tendons: usize,
}

fn other(error: PyErr) -> PlantError {
    PlantError::Other(Box::new(error))
}

impl OwnPlant<'_, '_> {
    /// The numbers of a measurement's entry; `None` where it is missing.
    fn numbers(
        &self,
        found: &Bound<'_, PyAny>,
        key: &str,
        count: usize,
    ) -> PyResult<Option<Vec<f64>>> {
        let entry = found.call_method1("get", (key,))?;
        if entry.is_none() {
            return Ok(None);
        }
        let numbers: Vec<f64> = entry.extract()?;
        match numbers.len() == count {
            true => Ok(Some(numbers)),
            false => Err(Failure::input(format!(
                "the plant measures a {key} of {} numbers; expected {count}",
                numbers.len()
            ))
            .into()),
        }
    }

    /// Points of a measurement's entry `cloud`, shape (n, 3) (m); `None` where it is missing.
    fn cloud(found: &Bound<'_, PyAny>) -> PyResult<Option<Vec<nalgebra::Vector3<f64>>>> {
        let entry = found.call_method1("get", ("cloud",))?;
        if entry.is_none() {
            return Ok(None);
        }
        let rows: Vec<[f64; 3]> = entry.extract().map_err(|_| -> PyErr {
            Failure::input("the plant measures a cloud that is no array of shape (n, 3)".to_owned())
                .into()
        })?;
        Ok(Some(rows.into_iter().map(Into::into).collect()))
    }

    fn measured(&self) -> PyResult<Measurement> {
        let found = self.object.call_method0("measure")?;
        let tip = self.numbers(&found, "tip", 3)?;
        let sightings = tip.map(|tip| Sighting {
            marker: Marker {
                disc: self.tip,
                place: [0.0; 3].into(),
            },
            position: [tip[0], tip[1], tip[2]].into(),
        });
        Ok(Measurement {
            sightings: sightings.into_iter().collect(),
            cloud: Self::cloud(&found)?,
            tensions: self.numbers(&found, "tensions", self.tendons)?,
            lengths: self.numbers(&found, "lengths", self.tendons)?,
        })
    }
}

impl Plant for OwnPlant<'_, '_> {
    fn period(&self) -> f64 {
        self.period
    }

    fn measure(&mut self) -> Result<Measurement, PlantError> {
        self.measured().map_err(other)
    }

    fn command(&mut self, command: &Command) -> Result<(), PlantError> {
        let values = PyArray1::from_slice(self.object.py(), command.as_slice());
        (self.object.call_method1("command", (values,))).map_err(other)?;
        Ok(())
    }
}

impl From<TrackError> for Failure {
    fn from(error: TrackError) -> Self {
        match error {
            TrackError::Run(error) => match *error {
                TrackingError::Plant(PlantError::Other(other)) => match other.downcast::<PyErr>() {
                    Ok(raised) => Self::Python(*raised),
                    Err(other) => Self::input(other.to_string()),
                },
                other => Self::input(other.to_string()),
            },
            TrackError::Loads(error) => error.into(),
            // As every call that moves a rig says it.
            TrackError::Rig(stopped) => PipelineError::from(*stopped).into(),
            other => Self::input(other.to_string()),
        }
    }
}

fn summary(robot: &tdcr::sim::robot::Robot, tracked: &Tracked) -> Outcome<String> {
    let summary = TrackSummary::new(robot, tracked);
    serde_json::to_string(&summary).map_err(|error| Failure::input(error.to_string()))
}

fn rows<'py>(py: Python<'py>, run: &Tracking) -> Outcome<Rows<'py>> {
    let count = run.rows.len();
    let first = run.rows.first();
    let tendons = first.map_or(0, |row| row.command.len());
    let unknowns = first.map_or(0, |row| row.estimated.len());
    let table = |width: usize, row: &dyn Fn(&tdcr::control::tracking::TrackingRow) -> Vec<f64>| {
        let flat: Vec<f64> = run.rows.iter().flat_map(row).collect();
        array(py, flat, [count, width])
    };
    let unknown = vec![f64::NAN; tendons];
    Ok((
        PyArray1::from_vec(py, run.rows.iter().map(|row| row.time).collect()),
        table(3, &|row| row.target.as_slice().to_vec())?,
        table(3, &|row| match row.tip {
            Some(tip) => tip.as_slice().to_vec(),
            None => vec![f64::NAN; 3],
        })?,
        table(tendons, &|row| row.command.clone())?,
        table(tendons, &|row| {
            row.tensions.clone().unwrap_or_else(|| unknown.clone())
        })?,
        table(unknowns, &|row| {
            row.estimated.iter().map(|found| found.value).collect()
        })?,
        table(unknowns, &|row| {
            row.estimated.iter().map(|found| found.deviation).collect()
        })?,
    ))
}
