//! Gradients of motions, by rows; linearised steps.

use nalgebra::{DMatrix, Quaternion, UnitQuaternion, Vector3};
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArray4, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyReadonlyArray4,
};
use pyo3::prelude::*;
use rayon::prelude::*;
use tdcr::sim::contact::ContactStepper;
use tdcr::sim::dynamics::{
    DynamicsError, Integrator, Lineariser, Rollout, State, StateCotangent, Stepper,
    rollout_gradient,
};
use tdcr::sim::pose::rotation_cotangent;
use tdcr::sim::robot::Parameter;
use tdcr::sim::simulation::{MovingRobot, Simulation, SimulationError};

use crate::arrays::{array, contiguous};
use crate::dynamics::{command_of, parts, state};
use crate::errors::Outcome;
use crate::loads::Loads;
use crate::motions::{Around, End, Motions, Start, ended, failures};
use crate::robot::{Robot, parameters_of};
use crate::run::{self, Watch};
use crate::scene::Scene;
use crate::scene_gradient::write_obstacles;
use crate::steps::Steps;

/// Derivatives of a cost by the states after each command of all rows, as they come from Python: positions (rows, commands,
/// discs, 3), quaternions (rows, commands, discs, 4), velocities (rows, commands, discs, 3).
#[derive(FromPyObject)]
pub struct ByStates<'py>(
    Option<PyReadonlyArray4<'py, f64>>,
    Option<PyReadonlyArray4<'py, f64>>,
    Option<PyReadonlyArray4<'py, f64>>,
);

/// The same, as numbers one after another.
struct Cotangents {
    positions: Option<Vec<[f64; 3]>>,
    quaternions: Option<Vec<[f64; 4]>>,
    velocity: Option<Vec<[f64; 3]>>,
}

impl Cotangents {
    fn new(from: &ByStates<'_>, motions: &Motions) -> Outcome<Self> {
        fn numbers<const N: usize>(
            from: Option<&PyReadonlyArray4<'_, f64>>,
            name: &str,
            motions: &Motions,
        ) -> Outcome<Option<Vec<[f64; N]>>> {
            let shape = [motions.rows, motions.length, motions.discs, N];
            from.map(|from| Ok(contiguous(from, name, &shape)?.as_chunks::<N>().0.to_vec()))
                .transpose()
        }
        Ok(Self {
            positions: numbers(from.0.as_ref(), "by_positions", motions)?,
            quaternions: numbers(from.1.as_ref(), "by_quaternions", motions)?,
            velocity: numbers(from.2.as_ref(), "by_velocity", motions)?,
        })
    }

    /// Adds those of the state whose first disc is number `at` of all, where the discs are turned by `orientations`.
    fn add(&self, at: usize, orientations: &[UnitQuaternion<f64>], out: &mut StateCotangent) {
        let n = orientations.len();
        if let Some(positions) = &self.positions {
            for (pose, by) in out.poses.iter_mut().zip(&positions[at..at + n]) {
                pose.position += Vector3::from(*by);
            }
        }
        if let Some(quaternions) = &self.quaternions {
            let turned = orientations.iter().zip(&quaternions[at..at + n]);
            for (pose, (q, by)) in out.poses.iter_mut().zip(turned) {
                pose.rotation += rotation_cotangent(q, *by);
            }
        }
        if let Some(velocity) = &self.velocity {
            let by = velocity[at..at + n].as_flattened();
            for (out, by) in out.coordinates[3 * n..].iter_mut().zip(by) {
                *out += by;
            }
        }
    }
}

/// Gradients by rows: the first axis of each array.
#[pyclass(frozen, get_all, module = "tdcr._tdcr")]
pub struct RolloutGradientRows {
    commands: Py<PyArray3<f64>>,
    configuration: Py<PyArray3<f64>>,
    velocity: Py<PyArray3<f64>>,
    payload: Py<PyArray1<f64>>,
    wrench: Py<PyArray3<f64>>,
    /// By the wrenches at each command, where they vary.
    wrenches: Option<Py<PyArray4<f64>>>,
    parameters: Py<PyArray2<f64>>,
    /// By the motion of each obstacle and its compliance, shape (rows, obstacles, 7).
    obstacles: Py<PyArray3<f64>>,
    /// By the motion of the base, shape (rows, 6).
    base: Py<PyArray2<f64>>,
    /// Rows that could not go on or have no derivatives: class of the exception, and why.
    failures: Vec<(usize, &'static str, String)>,
}

/// Where the gradient of one row goes.
struct Row<'a> {
    commands: &'a mut [f64],
    configuration: &'a mut [f64],
    velocity: &'a mut [f64],
    payload: &'a mut f64,
    wrench: &'a mut [f64],
    /// At each command; empty where it is not asked for.
    wrenches: &'a mut [f64],
    parameters: &'a mut [f64],
    obstacles: &'a mut [f64],
    base: &'a mut [f64],
}

/// What a row of gradients is computed from.
struct Question<'a> {
    motions: &'a Motions,
    cotangents: Cotangents,
    /// What was asked for, and then the payload, if it is not among them.
    parameters: Vec<Parameter>,
    /// The payload's place.
    payload: usize,
    steps: Steps,
}

/// A motion that is computed again, to be differentiated.
pub struct Replayed {
    pub rollout: Rollout,
    /// After each step.
    pub states: Vec<State>,
    /// Orientations of the discs after each command.
    pub orientations: Vec<Vec<UnitQuaternion<f64>>>,
}

impl Motions {
    /// The motion of a row with all its states; or how it ended before.
    pub fn replay(
        &self,
        at_hand: &mut Option<MovingRobot>,
        row: usize,
        watch: &Watch,
    ) -> Outcome<Result<Replayed, End>> {
        let skip = self.steps.skip;
        let moving = self.start(at_hand, row)??;
        let mut replayed = Replayed {
            rollout: Rollout {
                start: moving.state().clone(),
                commands: Vec::with_capacity(self.length * skip),
                loads: self.loads[row].clone(),
                wrenches: Vec::new(),
            },
            states: Vec::with_capacity(self.length * skip),
            orientations: Vec::with_capacity(self.length),
        };
        for step in 0..self.length {
            if watch.stopped() {
                return Ok(Err(End::Whole));
            }
            let (command, loads) = (self.command(row, step)?, self.loads(row, step)?);
            for _ in 0..skip {
                match moving.advance_by(&command, &loads, 1) {
                    Ok(()) => replayed.states.push(moving.state().clone()),
                    Err(SimulationError::Dynamics(error)) => {
                        return Ok(Err(ended(step, moving, error)));
                    }
                    Err(error) => return Err(error.into()),
                }
            }
            let commands = &mut replayed.rollout.commands;
            commands.extend(std::iter::repeat_n(command, skip));
            if self.vary() {
                let wrenches = self
                    .wrenches(row, step)
                    .iter()
                    .map(|wrench| vectors(*wrench));
                let wrenches = std::iter::repeat_n(wrenches.collect(), skip);
                replayed.rollout.wrenches.extend(wrenches);
            }
            let orientations = moving.pose().orientations.to_vec();
            replayed.orientations.push(orientations);
        }
        Ok(Ok(replayed))
    }
}

/// Force and moment of a wrench.
pub fn vectors([fx, fy, fz, mx, my, mz]: [f64; 6]) -> [Vector3<f64>; 2] {
    [Vector3::new(fx, fy, fz), Vector3::new(mx, my, mz)]
}

impl Question<'_> {
    /// The gradient of a row; or why there is none.
    fn differentiate(
        &self,
        at_hand: &mut Option<MovingRobot>,
        row: usize,
        watch: &Watch,
        out: &mut Row<'_>,
    ) -> Outcome<End> {
        let motions = self.motions;
        let skip = self.steps.skip;
        let Replayed {
            rollout,
            states,
            orientations,
        } = match motions.replay(at_hand, row, watch)? {
            Ok(replayed) => replayed,
            Err(end) => return Ok(end),
        };
        let cost = |k: usize, _: &State, by: &mut StateCotangent| {
            if k > 0 && k.is_multiple_of(skip) {
                let step = k / skip - 1;
                let at = (row * motions.length + step) * motions.discs;
                self.cotangents.add(at, &orientations[step], by);
            }
        };
        let (robot, timestep) = (motions.robot(row), self.steps.timestep);
        let parameters = &self.parameters;
        let among = at_hand.as_ref().filter(|_| motions.scenes.is_some());
        let gradient = match among {
            Some(moving) => {
                (moving.contact_stepper()).rollout_gradient(&rollout, &states, parameters, cost)
            }
            None => rollout_gradient(robot, timestep, &rollout, &states, parameters, cost),
        };
        let gradient = match gradient {
            Ok(gradient) => gradient,
            Err(error @ DynamicsError::NotDifferentiable) => {
                return Ok(End::Failed(error.into()));
            }
            Err(error) => return Err(error.into()),
        };
        // A command holds for `skip` steps.
        let held = gradient.commands.chunks_exact(skip);
        for (out, held) in parts(out.commands, motions.length).zip(held) {
            for (entry, out) in out.iter_mut().enumerate() {
                *out = held.iter().map(|command| command[entry]).sum();
            }
        }
        let (turns, rates) = gradient.start.split_at(3 * motions.discs);
        out.velocity.copy_from_slice(rates);
        let joints = robot.discs().iter().zip(&rollout.start.configuration.0);
        let by_steps = joints.zip(turns.as_chunks::<3>().0);
        for (out, ((disc, q), by_step)) in out
            .configuration
            .as_chunks_mut::<4>()
            .0
            .iter_mut()
            .zip(by_steps)
        {
            *out = quaternion_cotangent(q, &disc.turn_cotangent(q, &Vector3::from(*by_step)));
        }
        let wrenches = gradient.forces.iter().zip(&gradient.moments);
        for (out, (f, m)) in out.wrench.as_chunks_mut::<6>().0.iter_mut().zip(wrenches) {
            *out = [f.x, f.y, f.z, m.x, m.y, m.z];
        }
        // A wrench holds for as long as a command.
        if !out.wrenches.is_empty() {
            let held = gradient.wrenches.chunks_exact(skip);
            for (out, held) in parts(out.wrenches, motions.length).zip(held) {
                for (disc, out) in out.as_chunks_mut::<6>().0.iter_mut().enumerate() {
                    let [f, m] = [0, 1].map(|kind| {
                        held.iter()
                            .map(|step| step[disc][kind])
                            .sum::<Vector3<f64>>()
                    });
                    *out = [f.x, f.y, f.z, m.x, m.y, m.z];
                }
            }
        }
        *out.payload = gradient.parameters[self.payload];
        let asked = out.parameters.len();
        out.parameters
            .copy_from_slice(&gradient.parameters[..asked]);
        write_obstacles(&gradient.obstacles, out.obstacles);
        let by_base = (gradient.base.position.iter()).chain(&gradient.base.rotation);
        out.base
            .iter_mut()
            .zip(by_base)
            .for_each(|(out, by)| *out = *by);
        Ok(End::Whole)
    }
}

/// Derivative (w, x, y, z) along the unit sphere by a quaternion `q`, from that by a turn `q exp(turn)`: a change `dq` is the turn
/// `2 q* dq`.
fn quaternion_cotangent(q: &UnitQuaternion<f64>, by_turn: &Vector3<f64>) -> [f64; 4] {
    let by = q.quaternion() * Quaternion::from_imag(by_turn * 2.0);
    [by.w, by.i, by.j, by.k]
}

/// Derivatives of a cost of each row by what its motion depends on, from those by the states after each command, on all
/// threads. Rows without one are not numbers. `progress` is told how many more rows are done.
#[pyfunction]
#[pyo3(signature = (robots, commands, loads, payload, wrench, start, steps, around, by_states, names, progress=None))]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn rollout_vjp_rows(
    py: Python<'_>,
    robots: Vec<PyRef<'_, Robot>>,
    commands: PyReadonlyArray3<'_, f64>,
    loads: Vec<PyRef<'_, Loads>>,
    payload: Option<PyReadonlyArray1<'_, f64>>,
    wrench: Option<PyReadonlyArray3<'_, f64>>,
    start: Start<'_>,
    steps: PyRef<'_, Steps>,
    around: Around<'_>,
    by_states: ByStates<'_>,
    names: Vec<String>,
    progress: Option<Bound<'_, PyAny>>,
) -> Outcome<RolloutGradientRows> {
    steps.check_differentiable()?;
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
    let mut parameters = parameters_of(motions.robot(0), &names)?;
    let named = parameters.iter().position(|p| *p == Parameter::Payload);
    let payload_at = named.unwrap_or_else(|| {
        parameters.push(Parameter::Payload);
        names.len()
    });
    let question = Question {
        cotangents: Cotangents::new(&by_states, &motions)?,
        motions: &motions,
        parameters,
        payload: payload_at,
        steps: *steps,
    };
    let (rows, n, t) = (motions.rows, motions.discs, motions.tendons);
    let (length, width) = (motions.length, names.len());
    let none = |width: usize| vec![f64::NAN; rows * width];
    let [mut by_commands, mut by_parameters] = [none(length * t), none(width)];
    let [mut by_configuration, mut by_velocity] = [none(4 * n), none(3 * n)];
    let [mut by_payload, mut by_wrench] = [none(1), none(6 * n)];
    let mut by_wrenches = match motions.vary() {
        true => none(length * 6 * n),
        false => Vec::new(),
    };
    let obstacles = motions.obstacles();
    let [mut by_obstacles, mut by_base] = [none(7 * obstacles), none(6)];
    let ends: Vec<Outcome<End>> = run::long(py, progress.as_ref(), |watch| {
        let starts = parts(&mut by_configuration, rows).zip(parts(&mut by_velocity, rows));
        let loads = by_payload.iter_mut().zip(parts(&mut by_wrench, rows));
        let others = parts(&mut by_commands, rows).zip(parts(&mut by_parameters, rows));
        let around = parts(&mut by_obstacles, rows).zip(parts(&mut by_base, rows));
        let around = parts(&mut by_wrenches, rows).zip(around);
        let others = others.zip(around);
        let out = starts.zip(loads).zip(others).map(
            |(
                ((configuration, velocity), (payload, wrench)),
                ((commands, parameters), (wrenches, (obstacles, base))),
            )| Row {
                commands,
                configuration,
                velocity,
                payload,
                wrench,
                wrenches,
                parameters,
                obstacles,
                base,
            },
        );
        let mut out: Vec<Row<'_>> = out.collect();
        out.par_iter_mut()
            .enumerate()
            .map_init(
                || None,
                |at_hand, (row, out)| {
                    let end = question.differentiate(at_hand, row, watch, out);
                    watch.advance(1);
                    end
                },
            )
            .collect()
    })?;
    let failures = failures(ends, &motions)?;
    Ok(RolloutGradientRows {
        commands: array(py, by_commands, [rows, length, t])?.unbind(),
        configuration: array(py, by_configuration, [rows, n, 4])?.unbind(),
        velocity: array(py, by_velocity, [rows, n, 3])?.unbind(),
        payload: array(py, by_payload, [rows])?.unbind(),
        wrench: array(py, by_wrench, [rows, n, 6])?.unbind(),
        wrenches: match motions.vary() {
            true => Some(array(py, by_wrenches, [rows, length, n, 6])?.unbind()),
            false => None,
        },
        parameters: array(py, by_parameters, [rows, width])?.unbind(),
        obstacles: array(py, by_obstacles, [rows, obstacles, 7])?.unbind(),
        base: array(py, by_base, [rows, 6])?.unbind(),
        failures,
    })
}

type Matrix<'py> = Bound<'py, PyArray2<f64>>;

/// Derivatives of a semi-implicit Euler step from a state: by the state, shape (6 n, 6 n), and by the command, (6 n, tendons).
#[pyfunction]
#[pyo3(signature = (robot, configuration, velocity, command, loads, timestep, scene=None))]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn linearise<'py>(
    py: Python<'py>,
    robot: PyRef<'_, Robot>,
    configuration: PyReadonlyArray2<'_, f64>,
    velocity: PyReadonlyArray2<'_, f64>,
    command: PyReadonlyArray1<'_, f64>,
    loads: PyRef<'_, Loads>,
    timestep: f64,
    scene: Option<PyRef<'_, Scene>>,
) -> Outcome<(Matrix<'py>, Matrix<'py>)> {
    let state = state(&robot.0, &configuration, &velocity)?;
    let command = command_of(&robot.0, &command)?;
    let (robot, loads) = (&robot.0, &loads.0);
    let scene = scene.as_ref().map(|scene| &scene.0);
    let linear = py.detach(|| {
        let mut lineariser = match scene {
            Some(scene) => {
                let stepper = Stepper::new(robot, timestep, Integrator::SemiImplicitEuler)?;
                ContactStepper::new(stepper, scene)?.lineariser()?
            }
            None => Lineariser::new(robot, timestep)?,
        };
        lineariser.linearise(&state, &command, loads)
    })?;
    let rows = |matrix: &DMatrix<f64>| {
        let shape = [matrix.nrows(), matrix.ncols()];
        array(py, matrix.transpose().as_slice().to_vec(), shape)
    };
    Ok((rows(&linear.a)?, rows(&linear.b)?))
}
