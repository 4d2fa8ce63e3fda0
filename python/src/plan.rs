//! Motions among obstacles, planned.

use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray1};
use pyo3::prelude::*;
use tdcr::control::plan::{
    Goal, Insertion, MotionPlan, MotionPlanner, PlanError, PlanSettings, Stance,
};

use crate::arrays::{array, contiguous, write_points};
use crate::errors::{Failure, Outcome};
use crate::loads::Loads;
use crate::robot::Robot;
use crate::run;
use crate::scene::Scene;

/// A plan: commands, insertions (m), places of the discs (m), distances from obstacles (m), tensions (N) of each step; places that the
/// search reached, equilibria solved for, time (s).
type Planned<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    usize,
    usize,
    f64,
);

/// Plans a motion to a command and an insertion (m), or to a place of the tip (m).
#[pyfunction]
#[pyo3(signature = (robot, scene, loads, start, to, to_insertion, tip, clearance, tension, insertion, seed, nodes, seconds))]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn plan<'py>(
    py: Python<'py>,
    robot: PyRef<'_, Robot>,
    scene: PyRef<'_, Scene>,
    loads: PyRef<'_, Loads>,
    start: PyReadonlyArray1<'_, f64>,
    to: Option<PyReadonlyArray1<'_, f64>>,
    to_insertion: f64,
    tip: Option<[f64; 3]>,
    clearance: f64,
    tension: [f64; 2],
    insertion: Option<[f64; 2]>,
    seed: u64,
    nodes: usize,
    seconds: f64,
) -> Outcome<Planned<'py>> {
    let (robot, scene, loads) = (&robot.0, &scene.0, &loads.0);
    let tendons = robot.tendons().len();
    let from = Stance::from(robot.command(contiguous(&start, "from_", &[tendons])?)?);
    let goal = match (to, tip) {
        (None, Some(tip)) => Goal::Tip(Vector3::from(tip)),
        (Some(to), None) => Goal::Stance(Stance {
            command: robot.command(contiguous(&to, "to", &[tendons])?)?,
            insertion: to_insertion,
        }),
        _ => return Err(Failure::input("expected exactly one of `to` and `tip`")),
    };
    let settings = PlanSettings {
        clearance,
        tension,
        insertion: insertion.map(|range| Insertion { range }),
        seed,
        nodes,
        seconds,
    };
    let planned = run::long(py, None, |watch| {
        MotionPlanner::new(robot, scene, loads, settings)?
            .plan_while(&from, &goal, || !watch.stopped())
    })??;
    arrays(py, &planned, robot.discs().len(), tendons)
}

fn arrays<'py>(
    py: Python<'py>,
    plan: &MotionPlan,
    discs: usize,
    tendons: usize,
) -> Outcome<Planned<'py>> {
    let steps = &plan.steps;
    let commands = steps.iter().flat_map(|step| step.stance.command.as_slice());
    let mut positions = vec![0.0; steps.len() * discs * 3];
    for (step, out) in steps.iter().zip(positions.chunks_exact_mut(3 * discs)) {
        write_points(&step.positions, out);
    }
    let clearances = steps
        .iter()
        .map(|step| step.clearance.unwrap_or(f64::INFINITY));
    let tensions = steps.iter().flat_map(|step| step.tensions.iter().copied());
    Ok((
        array(py, commands.copied().collect(), [steps.len(), tendons])?,
        PyArray1::from_iter(py, steps.iter().map(|step| step.stance.insertion)),
        array(py, positions, [steps.len(), discs, 3])?,
        PyArray1::from_iter(py, clearances),
        array(py, tensions.collect(), [steps.len(), tendons])?,
        plan.effort.nodes,
        plan.effort.settled,
        plan.effort.seconds,
    ))
}

impl From<PlanError> for Failure {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Command(error) => error.into(),
            PlanError::Loads(error) => error.into(),
            PlanError::Target(error) => error.into(),
            PlanError::Setting { .. } => Self::input(error.to_string()),
            other => Self::Of("PlanError", other.to_string()),
        }
    }
}
