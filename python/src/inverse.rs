//! Commands for target shapes, and parameters from measured positions.

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray3};
use pyo3::prelude::*;
use tdcr::sim::geometry::Beads;
use tdcr::sim::inverse::calibration::{
    self, CalibrationError, CalibrationSettings, Finding, FitState, Observation, Unknown,
};
use tdcr::sim::inverse::shape::{
    self, Arrival, Bound as End, ContactGoals, Goal, Outcome as Ending, PathPoint, Press, Search,
    ShapeSolution, Target,
};

use crate::arrays::{array, contiguous};
use crate::contact::{ContactRows, Touched, arrays};
use crate::errors::{Failure, Outcome};
use crate::loads::Loads;
use crate::options::{self, TableArgument};
use crate::robot::{Robot, parameters};
use crate::run;
use crate::scene::Scene;
use crate::statics::{Batch, EquilibriumRows, Numbers, RowsArgument};

/// A target as it comes from Python: disc, "position", "direction" or "orientation", its numbers, lever (m), weight.
type TargetTuple = (usize, String, Vec<f64>, f64, f64);

fn target((disc, kind, numbers, lever, weight): TargetTuple) -> Outcome<Target> {
    let goal = match (kind.as_str(), numbers.as_slice()) {
        ("position", &[x, y, z]) => Goal::Position(Vector3::new(x, y, z)),
        ("direction", &[x, y, z]) => {
            let axis = Unit::new_normalize(Vector3::new(x, y, z));
            Goal::Direction { axis, lever }
        }
        ("orientation", &[w, x, y, z]) => {
            let orientation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
            Goal::Orientation { orientation, lever }
        }
        (kind, numbers) => {
            let message = format!(
                "a target is the {kind} {numbers:?}; expected a position or direction (x, y, z), or an orientation (w, x, y, z)"
            );
            return Err(Failure::input(message));
        }
    };
    Ok(Target { disc, goal, weight })
}

/// A force as it comes from Python: obstacle, disc, force (N), lever (m/N), weight.
type PressTuple = (usize, Option<usize>, f64, f64, f64);

fn press((obstacle, disc, force, lever, weight): PressTuple) -> Press {
    Press {
        obstacle,
        disc,
        force,
        lever,
        weight,
    }
}

/// An obstacle, a disc, and a number that belongs to them.
type ObstacleTuple = (usize, usize, f64);

/// The best command found: command, equilibrium, error of each target (m), how the search ended, the tendons that a bound
/// holds back, the gap (m), steps, what it touches among obstacles, forces (N), the obstacles that keep it away with their prices, the
/// nearest with its gap (m).
type Solution<'py> = (
    Bound<'py, PyArray1<f64>>,
    EquilibriumRows,
    Bound<'py, PyArray1<f64>>,
    &'static str,
    Vec<(usize, &'static str)>,
    f64,
    usize,
    Option<ContactRows>,
    Bound<'py, PyArray1<f64>>,
    Vec<ObstacleTuple>,
    Option<ObstacleTuple>,
);

/// A solution of a robot whose beads have a shape error (m), for Python.
fn solution<'py>(
    py: Python<'py>,
    found: &ShapeSolution,
    shape_error: f64,
) -> Outcome<Solution<'py>> {
    let touched = |among| arrays(py, &[Touched::at_rest(among, shape_error)]);
    let equilibrium = &found.equilibrium;
    let tendons = equilibrium.tendon_tensions.len();
    let mut numbers = Numbers::new(1, equilibrium.positions.len(), tendons);
    numbers.rows()[0].write(equilibrium);
    let none = Vec::new();
    let (ended, active, obstacles, gap) = match &found.outcome {
        Ending::Reached => ("reached", Vec::new(), &none, 0.0),
        Ending::Stalled { gap } => ("stalled", Vec::new(), &none, *gap),
        Ending::TooNear { .. } => ("too near", Vec::new(), &none, f64::NAN),
        Ending::Unreachable {
            active,
            obstacles,
            gap,
        } => {
            let end = |bound| match bound {
                End::Low => "low",
                End::High => "high",
            };
            let active = active.iter().map(|a| (a.tendon, end(a.bound))).collect();
            ("unreachable", active, obstacles, *gap)
        }
    };
    Ok((
        PyArray1::from_slice(py, found.command.as_slice()),
        numbers.into_arrays(py)?,
        PyArray1::from_slice(py, &found.errors),
        ended,
        active,
        gap,
        found.steps,
        found.among.as_ref().map(touched).transpose()?,
        PyArray1::from_slice(py, &found.forces),
        (obstacles.iter())
            .map(|one| (one.obstacle, one.disc, one.price))
            .collect(),
        (found.nearest).map(|nearest| (nearest.obstacle, nearest.disc, nearest.gap)),
    ))
}

/// Finds commands for targets.
#[pyclass(frozen, module = "tdcr._tdcr")]
pub struct ShapeController(shape::ShapeController);

#[pymethods]
impl ShapeController {
    #[new]
    #[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
    fn new(
        py: Python<'_>,
        robot: PyRef<'_, Robot>,
        scene: PyRef<'_, Scene>,
        loads: PyRef<'_, Loads>,
        tolerance: f64,
        samples: usize,
        seed: u64,
        starts: usize,
        max_steps: usize,
    ) -> Outcome<Self> {
        let search = Search {
            tolerance,
            samples,
            seed,
            starts,
            max_steps,
        };
        let (robot, scene, loads) = (&robot.0, &scene.0, &loads.0);
        let made = run::long(py, None, |_| {
            shape::ShapeController::among(robot, scene, loads, search)
        })?;
        Ok(Self(made?))
    }

    /// The command under which the robot comes nearest to the targets, with a clearance (m) and forces.
    #[pyo3(signature = (targets, presses, clearance=None))]
    fn reach<'py>(
        &self,
        py: Python<'py>,
        targets: Vec<TargetTuple>,
        presses: Vec<PressTuple>,
        clearance: Option<f64>,
    ) -> Outcome<Solution<'py>> {
        let targets: Vec<Target> = targets.into_iter().map(target).collect::<Outcome<_>>()?;
        let contact = ContactGoals {
            presses: presses.into_iter().map(press).collect(),
            clearance,
        };
        let found = run::long(py, None, |_| self.0.reach_with(&targets, &contact))??;
        solution(py, &found, shape_error(self.0.robot()))
    }

    /// A path of targets, from where the robot settles under `start`, if that is given.
    #[pyo3(signature = (start=None))]
    fn path(&self, start: Option<PyReadonlyArray1<'_, f64>>) -> Outcome<ShapePath> {
        let robot = self.0.robot();
        let Some(start) = start else {
            return Ok(ShapePath::new(self.0.path(), robot));
        };
        let start = robot.command(contiguous(&start, "start", &[robot.tendons().len()])?)?;
        Ok(ShapePath::new(self.0.path_from(&start)?, robot))
    }
}

/// A path of targets that the robot is led along without jumps.
#[pyclass(module = "tdcr._tdcr")]
pub struct ShapePath {
    path: shape::ShapePath,
    /// Of the beads that stand for the discs (m).
    shape_error: f64,
}

impl ShapePath {
    fn new(path: shape::ShapePath, robot: &tdcr::sim::robot::Robot) -> Self {
        let shape_error = shape_error(robot);
        Self { path, shape_error }
    }
}

/// By how much the beads that stand for a robot's discs may differ from these (m).
fn shape_error(robot: &tdcr::sim::robot::Robot) -> f64 {
    Beads::new(robot).shape_error()
}

#[pymethods]
impl ShapePath {
    /// The command for the next targets: the solution, how the robot arrives, the commands on the way, the largest changes of
    /// a command and of a disc's place (m).
    #[allow(clippy::type_complexity, reason = "a tuple for Python")]
    fn follow<'py>(
        &mut self,
        py: Python<'py>,
        targets: Vec<TargetTuple>,
    ) -> Outcome<(
        Solution<'py>,
        &'static str,
        Bound<'py, PyArray2<f64>>,
        f64,
        f64,
    )> {
        let targets: Vec<Target> = targets.into_iter().map(target).collect::<Outcome<_>>()?;
        let path = &mut self.path;
        let PathPoint {
            solution: found,
            arrival,
            via,
            command_change,
            disc_change,
        } = run::long(py, None, |_| path.follow(&targets))??;
        let arrival = match arrival {
            Arrival::First => "first",
            Arrival::Followed => "followed",
            Arrival::Switched => "switched",
        };
        let tendons = found.command.as_slice().len();
        let flat: Vec<f64> = via
            .iter()
            .flat_map(|command| command.as_slice())
            .copied()
            .collect();
        let via = array(py, flat, [via.len(), tendons])?;
        Ok((
            solution(py, &found, self.shape_error)?,
            arrival,
            via,
            command_change,
            disc_change,
        ))
    }
}

/// What was found of an unknown: kind, value, standard error, interval, the others that it is confounded with, whether the
/// measurements say little of it beside its prior.
type FindingTuple = (&'static str, f64, f64, [f64; 2], Vec<usize>, bool);

/// A calibrated robot.
#[pyclass(frozen, get_all, module = "tdcr._tdcr")]
pub struct Calibration {
    robot: Py<Robot>,
    findings: Vec<FindingTuple>,
    correlations: Py<PyArray2<f64>>,
    noise: f64,
    degrees_of_freedom: usize,
    condition: f64,
    state: &'static str,
    residual_rms: f64,
    steps: usize,
}

/// Fits unknowns of one robot to positions of discs, shape (rows, measured discs, 3); those that are not numbers were not measured.
/// `priors` is the file or the JSON text of what is known of the unknowns, `error` (m) how large errors of measurement are.
#[pyfunction]
#[pyo3(signature = (unknowns, rows, discs, positions, priors=None, error=None))]
pub fn calibrate(
    py: Python<'_>,
    unknowns: Vec<(String, Vec<String>)>,
    rows: RowsArgument<'_>,
    discs: Vec<usize>,
    positions: PyReadonlyArray3<'_, f64>,
    priors: Option<TableArgument>,
    error: Option<f64>,
) -> Outcome<Calibration> {
    let given = options::priors(priors.as_ref())?;
    let settings = CalibrationSettings {
        priors: given.priors.clone(),
        error,
    };
    let rows = Batch::new(&rows)?;
    let spec = rows.one_robot()?.spec().clone();
    let unknowns: Vec<Unknown> = (unknowns.iter())
        .map(|(name, keys)| Ok(Unknown::shared(name, parameters(keys)?)))
        .collect::<Outcome<_>>()?;
    let shape = [rows.rows(), discs.len(), 3];
    let measured = contiguous(&positions, "positions", &shape)?
        .as_chunks::<3>()
        .0;
    let observation = |row: usize| Observation {
        command: rows.commands[row].clone(),
        loads: rows.loads[row].clone(),
        positions: (discs.iter())
            .zip(&measured[row * discs.len()..(row + 1) * discs.len()])
            .filter(|(_, place)| place.iter().all(|x| !x.is_nan()))
            .map(|(&disc, &place)| (disc, place.into()))
            .collect(),
    };
    let observations: Vec<Observation> = (0..rows.rows()).map(observation).collect();
    let fit = run::long(py, None, |_| {
        calibration::calibrate(&spec, &unknowns, &observations, &settings)
    })?;
    let fit = fit.map_err(|error| match error {
        CalibrationError::Prior(error) => given.refused(&error).into(),
        other => Failure::from(other),
    })?;
    let (nan, none) = (f64::NAN, Vec::new);
    let finding = |finding: &Finding| match finding {
        Finding::Identified(e) => (
            "identified",
            e.value,
            e.standard_error,
            e.interval,
            none(),
            e.prior_only,
        ),
        Finding::Confounded { with } => ("confounded", nan, nan, [nan; 2], with.clone(), false),
        Finding::Undetermined { standard_error } => (
            "undetermined",
            nan,
            *standard_error,
            [nan; 2],
            none(),
            false,
        ),
        Finding::NoEffect => ("no effect", nan, nan, [nan; 2], none(), false),
        Finding::AtBound(value) => ("at bound", *value, nan, [nan; 2], none(), false),
    };
    let found = &fit.identification;
    let count = found.findings.len();
    // Symmetric, so its order of entries does not matter.
    let correlations = array(py, found.correlations.as_slice().to_vec(), [count, count])?;
    Ok(Calibration {
        robot: Py::new(py, Robot(tdcr::sim::robot::Robot::new(fit.spec)?))?,
        findings: found.findings.iter().map(finding).collect(),
        correlations: correlations.unbind(),
        noise: found.noise,
        degrees_of_freedom: found.degrees_of_freedom,
        condition: found.condition,
        state: match fit.state {
            FitState::Converged => "converged",
            FitState::AtBound(_) => "at bound",
            _ => "halted",
        },
        residual_rms: fit.residual_rms,
        steps: fit.steps,
    })
}
