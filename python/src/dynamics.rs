//! Motion by rows of commands.

use numpy::{PyArray1, PyArray3, PyArray4, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use rayon::prelude::*;
use tdcr::sim::chain::Configuration;
use tdcr::sim::dynamics::{DynamicsError, State};
use tdcr::sim::robot::Command;
use tdcr::sim::simulation::{Simulation, SimulationError};

use crate::arrays::{Tape, array, contiguous, quaternions, write_points, write_quaternions};
use crate::contact::{ContactRows, Touched, arrays};
use crate::errors::Outcome;
use crate::loads::Loads;
use crate::motions::{Around, End, Motions, Start, ended, failures};
use crate::objects;
use crate::robot::Robot;
use crate::run::{self, Watch};
use crate::steps::Steps;

type SimRobot = tdcr::sim::robot::Robot;
type SimMovingRobot = tdcr::sim::simulation::MovingRobot;

impl Motions {
    /// Moves a row from its start to its end.
    fn run(
        &self,
        at_hand: &mut Option<SimMovingRobot>,
        row: usize,
        watch: &Watch,
        out: &mut Row<'_>,
    ) -> Outcome<End> {
        let moving = match self.start(at_hand, row)? {
            Ok(moving) => moving,
            Err(error @ SimulationError::NotSettled(_)) => return Ok(End::Failed(error.into())),
            Err(SimulationError::Dynamics(error @ DynamicsError::Unstable { .. })) => {
                return Ok(End::Refused(error.into()));
            }
            Err(error) => return Err(error.into()),
        };
        for step in 0..self.length {
            if watch.stopped() {
                break;
            }
            let command = self.command(row, step)?;
            let loads = self.loads(row, step)?;
            match moving.advance(&command, &loads) {
                Ok(()) => out.write(step, moving, self),
                Err(SimulationError::Dynamics(error)) => return Ok(ended(step, moving, error)),
                Err(error) => return Err(error.into()),
            }
            watch.advance(1);
        }
        Ok(End::Whole)
    }
}

/// Motions by rows: axes of each array are rows, then commands. What follows a failure is not a number.
#[pyclass(frozen, get_all, module = "tdcr._tdcr")]
pub struct MotionRows {
    positions: Py<PyArray4<f64>>,
    quaternions: Py<PyArray4<f64>>,
    configuration: Py<PyArray4<f64>>,
    velocity: Py<PyArray4<f64>>,
    lengths: Py<PyArray3<f64>>,
    tensions: Py<PyArray3<f64>>,
    /// How many commands each row was moved by.
    steps: Py<PyArray1<u32>>,
    /// The scene's objects, by rows, commands and objects.
    objects: Py<PyArray4<f64>>,
    /// What is touched after each command, row after row, in a scene.
    contacts: Py<ContactRows>,
    /// Rows that could not go on: class of the exception, and why.
    failures: Vec<(usize, &'static str, String)>,
}

/// Where the motion of one row goes.
struct Row<'a> {
    positions: &'a mut [f64],
    quaternions: &'a mut [f64],
    configuration: &'a mut [f64],
    velocity: &'a mut [f64],
    lengths: &'a mut [f64],
    tensions: &'a mut [f64],
    steps: &'a mut u32,
    objects: &'a mut [f64],
    /// What is touched after each command, in a scene.
    touched: Vec<Touched>,
}

impl Row<'_> {
    fn write(&mut self, step: usize, moving: &SimMovingRobot, of: &Motions) {
        let scene = moving.scene();
        let (n, t) = (of.discs, of.tendons);
        let pose = moving.pose();
        let part = |width: usize| step * width..(step + 1) * width;
        write_points(pose.positions, &mut self.positions[part(3 * n)]);
        write_quaternions(pose.orientations, &mut self.quaternions[part(4 * n)]);
        write_quaternions(&pose.configuration.0, &mut self.configuration[part(4 * n)]);
        self.velocity[part(3 * n)].copy_from_slice(&moving.state().velocity);
        self.lengths[part(t)].copy_from_slice(pose.tendon_lengths);
        self.tensions[part(t)].copy_from_slice(pose.tendon_tensions);
        let width = objects::WIDTH * moving.objects().len();
        objects::write(moving, &mut self.objects[part(width)]);
        if of.scenes.is_some() && !scene.is_empty() {
            let error = moving.shape_error();
            (self.touched).push(Touched::in_motion(moving.contacts(), scene, error));
        }
        *self.steps = u32::try_from(step + 1).unwrap_or(u32::MAX);
    }
}

/// Equal parts of `values`, one for each row, however wide.
pub fn parts<T>(values: &mut [T], rows: usize) -> impl Iterator<Item = &mut [T]> {
    let width = values.len().checked_div(rows).unwrap_or(0);
    let mut rest = values;
    (0..rows).map(move |_| {
        let (part, after) = std::mem::take(&mut rest).split_at_mut(width);
        rest = after;
        part
    })
}

/// Moves each row through its commands, on all threads. `progress` is told how many more commands are done.
#[pyfunction]
#[pyo3(signature = (robots, commands, loads, payload, wrench, start, steps, around, progress=None))]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn rollout_rows(
    py: Python<'_>,
    robots: Vec<PyRef<'_, Robot>>,
    commands: PyReadonlyArray3<'_, f64>,
    loads: Vec<PyRef<'_, Loads>>,
    payload: Option<PyReadonlyArray1<'_, f64>>,
    wrench: Option<PyReadonlyArray3<'_, f64>>,
    start: Start<'_>,
    steps: PyRef<'_, Steps>,
    around: Around<'_>,
    progress: Option<Bound<'_, PyAny>>,
) -> Outcome<MotionRows> {
    let motions = Motions::new(
        &robots,
        &commands,
        &loads,
        payload.as_ref(),
        wrench.as_ref(),
        &start,
        *steps,
    )?
    .among(&around)?;
    let (rows, length) = (motions.rows, motions.length);
    let (n, t) = (motions.discs, motions.tendons);
    let none = |width: usize| vec![f64::NAN; rows * length * width];
    let [mut positions, mut velocity] = [none(3 * n), none(3 * n)];
    let [mut quaternions, mut configuration] = [none(4 * n), none(4 * n)];
    let [mut lengths, mut tensions] = [none(t), none(t)];
    let count = motions
        .scenes
        .as_ref()
        .map_or(0, |scenes| objects::count(scenes.of_row(0)));
    let mut things = none(objects::WIDTH * count);
    let mut taken = vec![0; rows];
    let (ends, touched) = run::long(py, progress.as_ref(), |watch| {
        let poses = parts(&mut positions, rows).zip(parts(&mut quaternions, rows));
        let states = parts(&mut configuration, rows).zip(parts(&mut velocity, rows));
        let tendons = parts(&mut lengths, rows).zip(parts(&mut tensions, rows));
        let rest = parts(&mut things, rows).zip(&mut taken);
        let out = (poses.zip(states)).zip(tendons.zip(rest)).map(
            |(
                ((positions, quaternions), (configuration, velocity)),
                ((lengths, tensions), (objects, steps)),
            )| {
                Row {
                    positions,
                    quaternions,
                    configuration,
                    velocity,
                    lengths,
                    tensions,
                    steps,
                    objects,
                    touched: Vec::new(),
                }
            },
        );
        let mut out: Vec<Row<'_>> = out.collect();
        let ends: Vec<Outcome<End>> = (out.par_iter_mut().enumerate())
            .map_init(
                || None,
                |at_hand, (row, out)| motions.run(at_hand, row, watch, out),
            )
            .collect();
        let touched: Vec<Touched> = out.into_iter().flat_map(|row| row.touched).collect();
        (ends, touched)
    })?;
    let failures = failures(ends, &motions)?;
    Ok(MotionRows {
        positions: array(py, positions, [rows, length, n, 3])?.unbind(),
        quaternions: array(py, quaternions, [rows, length, n, 4])?.unbind(),
        configuration: array(py, configuration, [rows, length, n, 4])?.unbind(),
        velocity: array(py, velocity, [rows, length, n, 3])?.unbind(),
        lengths: array(py, lengths, [rows, length, t])?.unbind(),
        tensions: array(py, tensions, [rows, length, t])?.unbind(),
        steps: array(py, taken, [rows])?.unbind(),
        objects: array(py, things, [rows, length, count, objects::WIDTH])?.unbind(),
        contacts: Py::new(py, arrays(py, &touched)?)?,
        failures,
    })
}

/// A state as it comes from Python: shapes (discs, 4) and (discs, 3).
pub fn state(
    robot: &SimRobot,
    configuration: &PyReadonlyArray2<'_, f64>,
    velocity: &PyReadonlyArray2<'_, f64>,
) -> Outcome<State> {
    let n = robot.discs().len();
    Ok(State {
        configuration: Configuration(quaternions(contiguous(
            configuration,
            "configuration",
            &[n, 4],
        )?)),
        velocity: contiguous(velocity, "velocity", &[n, 3])?.to_vec(),
    })
}

/// The same, to the last bit: rotations are not made unit ones.
pub fn state_as_it_was(
    robot: &SimRobot,
    configuration: &PyReadonlyArray2<'_, f64>,
    velocity: &PyReadonlyArray2<'_, f64>,
) -> Outcome<State> {
    let n = robot.discs().len();
    let rotations = contiguous(configuration, "configuration", &[n, 4])?;
    Ok(State {
        configuration: Configuration(Tape(rotations).quaternions(n)),
        velocity: contiguous(velocity, "velocity", &[n, 3])?.to_vec(),
    })
}

pub fn command_of(robot: &SimRobot, command: &PyReadonlyArray1<'_, f64>) -> Outcome<Command> {
    Ok(robot.command(contiguous(command, "command", &[robot.tendons().len()])?)?)
}
