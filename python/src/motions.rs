//! Rows of motions as they come from Python, and how they ended.

use std::borrow::Cow;

use nalgebra::UnitQuaternion;
use numpy::{PyReadonlyArray1, PyReadonlyArray3, PyReadonlyArray4};
use pyo3::prelude::*;
use tdcr::sim::chain::Configuration;
use tdcr::sim::dynamics::{DynamicsError, State};
use tdcr::sim::robot::Command;
use tdcr::sim::simulation::{Simulation, SimulationError};

use crate::arrays::{contiguous, quaternions};
use crate::contact::{Scenes, ScenesArgument};
use crate::errors::{Failure, Outcome};
use crate::loads::{LoadRows, Loads};
use crate::robot::{Robot, of_rows};
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

/// What rows move among, as it comes from Python: a scene for all rows or one a row, and wrenches on each disc at each command, shape
/// (rows, commands, discs, 6), besides the loads.
#[derive(FromPyObject)]
pub struct Around<'py>(
    Option<ScenesArgument<'py>>,
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
    /// Obstacles around them, where a scene is given.
    pub scenes: Option<Scenes>,
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
            scenes: None,
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
        let Around(scenes, wrenches) = around;
        if let Some(scenes) = scenes {
            self.scenes = Some(Scenes::new(scenes, self.rows)?);
            self.check_objects()?;
        }
        if let Some(wrenches) = wrenches {
            let shape = [self.rows, self.length, self.discs, 6];
            let wrenches = contiguous(wrenches, "wrench", &shape)?;
            self.wrenches = wrenches.as_chunks::<6>().0.to_vec();
        }
        Ok(self)
    }

    /// Refuses scenes in which not the same obstacles have a mass.
    fn check_objects(&self) -> Outcome<()> {
        let Some(scenes) = self.scenes.as_ref().filter(|scenes| scenes.differ()) else {
            return Ok(());
        };
        let objects = |row| -> Vec<usize> {
            let objects = scenes.of_row(row).objects();
            objects.map(|(number, _)| number).collect()
        };
        match (1..self.rows).find(|row| objects(*row) != objects(0)) {
            None => Ok(()),
            Some(row) => Err(Failure::input(format!(
                "obstacles {:?} of scene {row} have a mass, of scene 0 {:?}: expected the same ones",
                objects(row),
                objects(0)
            ))),
        }
    }

    /// The scene of a row, where one is given.
    pub fn scene(&self, row: usize) -> Option<&SimScene> {
        self.scenes.as_ref().map(|scenes| scenes.of_row(row))
    }

    /// Number of obstacles around each robot.
    pub fn obstacles(&self) -> usize {
        self.scenes.as_ref().map_or(0, Scenes::obstacles)
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

    /// The one at hand, where it is of the same robot and scene, at the start of a row.
    pub fn start<'a>(
        &self,
        at_hand: &'a mut Option<SimMovingRobot>,
        row: usize,
    ) -> Outcome<Result<&'a mut SimMovingRobot, SimulationError>> {
        if self.robots.len() > 1 || self.scenes.as_ref().is_some_and(Scenes::differ) {
            *at_hand = None;
        }
        let robot = self.robot(row);
        if at_hand.is_none() {
            let nothing = SimScene::default();
            let scene = self.scene(row).unwrap_or(&nothing);
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
}

/// How a motion ended that could not go on.
pub fn ended(step: usize, moving: &SimMovingRobot, error: DynamicsError) -> End {
    if let DynamicsError::Unstable { .. } = error {
        return End::Refused(error.into());
    }
    let message = format!("step {step}, at {:.6} s: {error}", moving.time());
    End::Failed(Failure::Of("DynamicsError", message))
}
