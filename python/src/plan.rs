//! Motions among obstacles, planned.

use std::cell::Cell;

use nalgebra::Vector3;
use numpy::{
    PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use tdcr::control::plan::follow_the_leader::{
    BaseMotion, DeploymentError, DeploymentStage, DeploymentTask, deploy_while,
};
use tdcr::control::plan::{
    Goal, Insertion, MotionPlan, MotionPlanner, PlanError, PlanSettings, Stance,
};

use crate::arrays::{array, contiguous, write_points, write_quaternions};
use crate::errors::{Failure, Outcome, choice};
use crate::hint;
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
#[pyo3(signature = (robot, scene, loads, start, to, to_insertion, tip, clearance, tension, insertion, seed, nodes, seconds, progress=None))]
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
    progress: Option<&Bound<'py, PyAny>>,
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
    let planned = run::long(py, progress, |watch| {
        let reached = Cell::new(0);
        MotionPlanner::new(robot, scene, loads, settings)?.plan_while(&from, &goal, |nodes| {
            watch.advance(nodes.saturating_sub(reached.replace(nodes)));
            !watch.stopped()
        })
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

/// A deployment: arc lengths (m), commands, poses of the base (m; w, x, y, z), places of the discs (m), deviations (m), errors of the tip
/// (m), forces of contacts (N).
type Deployed<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
);

/// Deploys a robot in a scene along a curve through points, shape (points, 3) (m).
#[pyfunction]
#[pyo3(signature = (robot, scene, loads, curve, base, stages, progress=None))]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn follow_the_leader<'py>(
    py: Python<'py>,
    robot: PyRef<'_, Robot>,
    scene: PyRef<'_, Scene>,
    loads: PyRef<'_, Loads>,
    curve: PyReadonlyArray2<'_, f64>,
    base: &str,
    stages: usize,
    progress: Option<&Bound<'py, PyAny>>,
) -> Outcome<Deployed<'py>> {
    let motion = choice(
        "base",
        base,
        &[
            ("free", BaseMotion::Free),
            ("carriage", BaseMotion::Carriage),
        ],
    )?;
    let (robot, scene, loads) = (&robot.0, &scene.0, &loads.0);
    let shape = [curve.shape()[0], 3];
    let points = contiguous(&curve, "curve", &shape)?.as_chunks::<3>().0;
    let points: Vec<Vector3<f64>> = points.iter().map(|point| Vector3::from(*point)).collect();
    let task = DeploymentTask {
        robot,
        scene,
        loads,
        points: &points,
        motion,
        stages,
    };
    let found = run::long(py, progress, |watch| {
        deploy_while(&task, |_, _| {
            watch.advance(1);
            !watch.stopped()
        })
    })??;
    let stages = &found.stages;
    let (count, discs, tendons) = (stages.len(), robot.discs().len(), robot.tendons().len());
    let numbers = |of: fn(&DeploymentStage) -> f64| PyArray1::from_iter(py, stages.iter().map(of));
    let commands = stages.iter().flat_map(|stage| stage.command.as_slice());
    let base = stages
        .iter()
        .flat_map(|stage| stage.base.translation.vector.data.0[0]);
    let turns: Vec<_> = stages.iter().map(|stage| stage.base.rotation).collect();
    let mut orientations = vec![0.0; 4 * count];
    write_quaternions(&turns, &mut orientations);
    let mut positions = vec![0.0; count * discs * 3];
    for (stage, out) in stages.iter().zip(positions.chunks_exact_mut(3 * discs)) {
        write_points(&stage.positions, out);
    }
    Ok((
        numbers(|stage| stage.arc_length),
        array(py, commands.copied().collect(), [count, tendons])?,
        array(py, base.collect(), [count, 3])?,
        array(py, orientations, [count, 4])?,
        array(py, positions, [count, discs, 3])?,
        numbers(|stage| stage.deviation),
        numbers(|stage| stage.tip_error),
        numbers(DeploymentStage::contact_force),
    ))
}

impl From<DeploymentError> for Failure {
    fn from(error: DeploymentError) -> Self {
        match error {
            DeploymentError::Loads(error) => error.into(),
            error => {
                let class = match error {
                    DeploymentError::Unsettled { .. } => "PlanError",
                    _ => "InputError",
                };
                Self::with_hint(class, &error, hint::of_deployment(&error))
            }
        }
    }
}

impl From<PlanError> for Failure {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::Command(error) => error.into(),
            PlanError::Loads(error) => error.into(),
            PlanError::Target(error) => error.into(),
            PlanError::Setting { .. } => Self::input(error.to_string()),
            other => Self::with_hint("PlanError", &other, hint::of_plan(&other)),
        }
    }
}
