//! Motion by rows of commands.

use std::borrow::Cow;

use nalgebra::UnitQuaternion;
use numpy::{
    PyArray1, PyArray3, PyArray4, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyReadonlyArray4,
};
use pyo3::prelude::*;
use rayon::prelude::*;
use tdcr::sim::chain::Configuration;
use tdcr::sim::dynamics::{DynamicsError, State};
use tdcr::sim::robot::Command;
use tdcr::sim::simulation::{Simulation, SimulationError};

use crate::arrays::{Tape, array, contiguous, quaternions, write_points, write_quaternions};
use crate::contact::{ContactRows, Touched, arrays};
use crate::errors::{Failure, Outcome};
use crate::loads::{LoadRows, Loads};
use crate::objects;
use crate::robot::{Robot, of_rows};
use crate::run::{self, Watch};
use crate::scene::Scene;
use crate::steps::Steps;

type SimRobot = tdcr::sim::robot::Robot;
type SimScene = tdcr::sim::scene::Scene;
type SimLoads = tdcr::sim::robot::Loads;
type SimMovingRobot = tdcr::sim::simulation::MovingRobot;

/// Where each row starts.
enum Starts {
    /// Straight, at rest.
    Straight,
    /// At rest in the equilibrium of the row's first command.
    Settled,
    /// In given states, of all rows one after another.
    At {
        joints: Vec<UnitQuaternion<f64>>,
        velocity: Vec<f64>,
    },
}

/// Start of rows as it comes from Python: configurations (rows, discs, 4) and velocities (rows, discs, 3); without them the
/// straight pose, or the equilibrium of the first command.
#[derive(FromPyObject)]
pub struct Start<'py>(
    Option<PyReadonlyArray3<'py, f64>>,
    Option<PyReadonlyArray3<'py, f64>>,
    bool,
);

/// What rows move among, as it comes from Python: a scene, and wrenches on each disc at each command, shape (rows, commands, discs, 6),
/// besides the loads.
#[derive(FromPyObject)]
pub struct Around<'py>(
    Option<PyRef<'py, Scene>>,
    Option<PyReadonlyArray4<'py, f64>>,
);

/// What each row is asked for.
pub struct Motions {
    /// One for all rows, or one a row; all of as many discs and tendons.
    robots: Vec<SimRobot>,
    pub loads: Vec<SimLoads>,
    starts: Starts,
    commands: Vec<f64>,
    pub rows: usize,
    /// Commands of each row.
    pub length: usize,
    pub discs: usize,
    pub tendons: usize,
    pub steps: Steps,
    /// Obstacles around all of them, where a scene is given.
    pub scene: Option<SimScene>,
    /// Force and moment on each disc at each command of all rows; empty where they do not vary.
    wrenches: Vec<[f64; 6]>,
}

/// What became of the motion of a row.
pub enum End {
    /// It is whole, or nobody waits for it.
    Whole,
    /// It cannot go on, and why.
    Failed(Failure),
    /// It does not begin: the time step is too long for the robot.
    Refused(Failure),
}

/// A row that has no motion: class of the exception, and why.
type RowFailure = (usize, &'static str, String);

/// The failures of rows; or that of the first, where what was asked for is wrong for all of them.
pub fn failures(ends: Vec<Outcome<End>>, motions: &Motions) -> Outcome<Vec<RowFailure>> {
    let mut failures = Vec::new();
    let mut refused = 0;
    for (row, end) in ends.into_iter().enumerate() {
        match end.map_err(|failure| motions.of(row, failure))? {
            End::Whole => continue,
            End::Failed(Failure::Of(class, why)) => failures.push((row, class, why)),
            End::Refused(Failure::Of(class, why)) => {
                refused += 1;
                failures.push((row, class, why));
            }
            End::Failed(raised) | End::Refused(raised) => return Err(raised),
        }
    }
    match failures.first() {
        Some((row, class, why)) if refused == motions.rows => {
            Err(motions.of(*row, Failure::Of(class, why.clone())))
        }
        _ => Ok(failures),
    }
}

impl Motions {
    /// Checks rows of motions but for their commands, which are checked as they come up.
    pub fn new(
        robots: &[PyRef<'_, Robot>],
        commands: &PyReadonlyArray3<'_, f64>,
        loads: &[PyRef<'_, Loads>],
        payload: Option<&PyReadonlyArray1<'_, f64>>,
        wrench: Option<&PyReadonlyArray3<'_, f64>>,
        start: &Start<'_>,
        steps: Steps,
    ) -> Outcome<Self> {
        let shape = numpy::PyUntypedArrayMethods::shape(&**commands);
        let (rows, length) = (shape[0], shape[1]);
        let robots = of_rows(robots, rows)?;
        let (discs, tendons) = (robots[0].discs().len(), robots[0].tendons().len());
        let commands = contiguous(commands, "commands", &[rows, length, tendons])?.to_vec();
        let of_rows = LoadRows::new(loads, payload, wrench, rows, discs)?;
        let starts = match start {
            Start(Some(joints), Some(velocity), _) => {
                let joints = contiguous(joints, "configuration", &[rows, discs, 4])?;
                let velocity = contiguous(velocity, "velocity", &[rows, discs, 3])?;
                Starts::At {
                    joints: quaternions(joints),
                    velocity: velocity.to_vec(),
                }
            }
            Start(_, _, true) => Starts::Settled,
            Start(..) => Starts::Straight,
        };
        let mut motions = Self {
            robots,
            loads: Vec::with_capacity(rows),
            starts,
            commands,
            rows,
            length,
            discs,
            tendons,
            steps,
            scene: None,
            wrenches: Vec::new(),
        };
        for row in 0..rows {
            let loads = of_rows
                .row(row)
                .map_err(|failure| motions.of(row, failure))?;
            let checked = loads.check(motions.robot(row));
            checked.map_err(|error| motions.of(row, error.into()))?;
            motions.loads.push(loads);
        }
        Ok(motions)
    }

    /// The same among what surrounds them.
    pub fn among(mut self, around: &Around<'_>) -> Outcome<Self> {
        let Around(scene, wrenches) = around;
        self.scene = scene.as_ref().map(|scene| scene.0.clone());
        if let Some(wrenches) = wrenches {
            let shape = [self.rows, self.length, self.discs, 6];
            let wrenches = contiguous(wrenches, "wrench", &shape)?;
            self.wrenches = wrenches.as_chunks::<6>().0.to_vec();
        }
        Ok(self)
    }

    /// Whether wrenches vary from command to command.
    pub fn vary(&self) -> bool {
        !self.wrenches.is_empty()
    }

    /// Force and moment on each disc at a command, besides the loads; empty where they do not vary.
    pub fn wrenches(&self, row: usize, step: usize) -> &[[f64; 6]] {
        let at = (row * self.length + step) * self.discs;
        self.wrenches.get(at..at + self.discs).unwrap_or_default()
    }

    /// The loads of a row at a command.
    pub fn loads(&self, row: usize, step: usize) -> Outcome<Cow<'_, SimLoads>> {
        let loads = &self.loads[row];
        if !self.vary() {
            return Ok(Cow::Borrowed(loads));
        }
        let varying = Loads(loads.clone()).with(None, self.wrenches(row, step))?;
        Ok(Cow::Owned(varying))
    }

    pub fn robot(&self, row: usize) -> &SimRobot {
        &self.robots[if self.robots.len() == 1 { 0 } else { row }]
    }

    /// A failure, with its row where there are many.
    pub fn of(&self, row: usize, failure: Failure) -> Failure {
        if self.rows == 1 {
            failure
        } else {
            failure.of_row(row)
        }
    }

    /// The command of a row at `step`.
    pub fn command(&self, row: usize, step: usize) -> Outcome<Command> {
        let at = (row * self.length + step) * self.tendons;
        let command = self
            .robot(row)
            .command(&self.commands[at..at + self.tendons]);
        command.map_err(|error| match error.into() {
            Failure::Of(class, message) => Failure::Of(class, format!("step {step}: {message}")),
            python => python,
        })
    }

    /// The one at hand, where it is of the same robot, at the start of a row.
    pub fn start<'a>(
        &self,
        at_hand: &'a mut Option<SimMovingRobot>,
        row: usize,
    ) -> Outcome<Result<&'a mut SimMovingRobot, SimulationError>> {
        if self.robots.len() > 1 {
            *at_hand = None;
        }
        let robot = self.robot(row);
        if at_hand.is_none() {
            let nothing = SimScene::default();
            let scene = self.scene.as_ref().unwrap_or(&nothing);
            *at_hand = Some(self.steps.moving(robot, scene)?);
        }
        let moving = at_hand.as_mut().expect("just made");
        let first = match self.length {
            0 => robot.mean_command(),
            _ => self.command(row, 0)?,
        };
        let first_loads = match self.length {
            0 => Cow::Borrowed(&self.loads[row]),
            _ => self.loads(row, 0)?,
        };
        let started = match &self.starts {
            Starts::Straight => moving.start_at(&State::straight(robot), &first),
            Starts::Settled => moving.reset(&first, &first_loads),
            Starts::At { joints, velocity } => {
                let [n, at] = [self.discs, row * self.discs];
                let state = State {
                    configuration: Configuration(joints[at..at + n].to_vec()),
                    velocity: velocity[3 * at..3 * (at + n)].to_vec(),
                };
                moving.start_at(&state, &first)
            }
        };
        Ok(started.map(|()| moving))
    }

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

/// How a motion ended that could not go on.
pub fn ended(step: usize, moving: &SimMovingRobot, error: DynamicsError) -> End {
    if let DynamicsError::Unstable { .. } = error {
        return End::Refused(error.into());
    }
    let message = format!("step {step}, at {:.6} s: {error}", moving.time());
    End::Failed(Failure::Of("DynamicsError", message))
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
        if let Some(scene) = of.scene.as_ref().filter(|scene| !scene.is_empty()) {
            (self.touched).push(Touched::in_motion(moving.contacts(), scene));
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
    let count = motions.scene.as_ref().map_or(0, objects::count);
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
