//! Tangents of motions, by rows.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use numpy::{PyArray4, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyReadonlyArray4};
use pyo3::prelude::*;
use rayon::prelude::*;
use tdcr::sim::dynamics::{DynamicsError, RolloutDirection, rollout_tangent};
use tdcr::sim::pose::PoseTangent;
use tdcr::sim::robot::Parameter;
use tdcr::sim::simulation::MovingRobot;

use crate::arrays::{array, contiguous};
use crate::dynamics::parts;
use crate::dynamics_gradient::{Replayed, vectors};
use crate::errors::Outcome;
use crate::loads::Loads;
use crate::motions::{Around, End, Motions, Start, failures};
use crate::robot::{Robot, parameters_of};
use crate::run::{self, Watch};
use crate::scene_gradient::read_obstacles;
use crate::sensitivity::quaternion_change;
use crate::steps::Steps;

/// How all that the rows depend on changes, as it comes from Python: commands (rows, commands, tendons), configuration (rows,
/// discs, 4), velocity (rows, discs, 3), payload (rows,), wrench (rows, discs, 6), parameters (rows, parameters), where they vary
/// wrenches (rows, commands, discs, 6), the motion of each obstacle and its compliance (rows, obstacles, 7), and the motion of the base
/// (rows, 6).
#[derive(FromPyObject)]
pub struct Rates<'py>(
    PyReadonlyArray3<'py, f64>,
    PyReadonlyArray3<'py, f64>,
    PyReadonlyArray3<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray3<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    Option<PyReadonlyArray4<'py, f64>>,
    PyReadonlyArray3<'py, f64>,
    PyReadonlyArray2<'py, f64>,
);

/// The same, as numbers one after another.
struct Numbers {
    commands: Vec<f64>,
    configuration: Vec<f64>,
    velocity: Vec<f64>,
    payload: Vec<f64>,
    wrench: Vec<f64>,
    parameters: Vec<f64>,
    /// Empty where they do not vary.
    wrenches: Vec<f64>,
    obstacles: Vec<f64>,
    base: Vec<f64>,
}

impl Numbers {
    fn new(rates: &Rates<'_>, motions: &Motions, width: usize) -> Outcome<Self> {
        let (rows, n) = (motions.rows, motions.discs);
        let commands = [rows, motions.length, motions.tendons];
        Ok(Self {
            commands: contiguous(&rates.0, "command_rates", &commands)?.to_vec(),
            configuration: contiguous(&rates.1, "configuration_rates", &[rows, n, 4])?.to_vec(),
            velocity: contiguous(&rates.2, "velocity_rates", &[rows, n, 3])?.to_vec(),
            payload: contiguous(&rates.3, "payload_rates", &[rows])?.to_vec(),
            wrench: contiguous(&rates.4, "wrench_rates", &[rows, n, 6])?.to_vec(),
            parameters: contiguous(&rates.5, "parameter_rates", &[rows, width])?.to_vec(),
            wrenches: match &rates.6 {
                Some(wrenches) => {
                    let shape = [rows, motions.length, n, 6];
                    contiguous(wrenches, "wrench_rates", &shape)?.to_vec()
                }
                None => Vec::new(),
            },
            obstacles: contiguous(&rates.7, "obstacle_rates", &[rows, motions.obstacles(), 7])?
                .to_vec(),
            base: contiguous(&rates.8, "base_rates", &[rows, 6])?.to_vec(),
        })
    }

    /// The direction of one row, whose motion starts with the joints turned by `start`.
    fn direction(
        &self,
        motions: &Motions,
        row: usize,
        start: &[UnitQuaternion<f64>],
        names: &[Parameter],
    ) -> RolloutDirection {
        fn of_row(all: &[f64], row: usize, rows: usize) -> &[f64] {
            let width = all.len() / rows;
            &all[row * width..(row + 1) * width]
        }
        let part = |all| of_row(all, row, motions.rows);
        let joints = motions.robot(row).discs().iter().zip(start);
        let steps = joints.zip(part(&self.configuration).as_chunks().0);
        let steps = steps.flat_map(|((disc, q), change)| {
            <[f64; 3]>::from(disc.step_along(q, &turn_of(q, *change)))
        });
        let rates = part(&self.velocity).iter().copied();
        let (forces, moments) = part(&self.wrench)
            .as_chunks::<6>()
            .0
            .iter()
            .map(|wrench| <(_, _)>::from(vectors(*wrench)))
            .unzip();
        // A command holds for some steps. The payload is one of the parameters, or named besides them.
        let commands = part(&self.commands).chunks_exact(motions.tendons.max(1));
        let held = commands.flat_map(|c| std::iter::repeat_n(c.to_vec(), motions.steps.skip));
        let mut parameters: Vec<(Parameter, f64)> = (names.iter().copied())
            .zip(part(&self.parameters).iter().copied())
            .collect();
        match parameters.iter_mut().find(|p| p.0 == Parameter::Payload) {
            Some(payload) => payload.1 += self.payload[row],
            None => parameters.push((Parameter::Payload, self.payload[row])),
        }
        let obstacles = part(&self.obstacles);
        RolloutDirection {
            commands: held.collect(),
            start: steps.chain(rates).collect(),
            forces,
            moments,
            parameters,
            wrenches: part(&self.wrenches)
                .as_chunks::<6>()
                .0
                .chunks_exact(motions.discs)
                .map(|step| {
                    step.iter()
                        .map(|wrench| vectors(*wrench))
                        .collect::<Vec<_>>()
                })
                .flat_map(|step| std::iter::repeat_n(step, motions.steps.skip))
                .collect(),
            base: {
                let base = part(&self.base);
                PoseTangent {
                    position: Vector3::from_column_slice(&base[..3]),
                    rotation: Vector3::from_column_slice(&base[3..]),
                }
            },
            obstacles: match obstacles.iter().any(|rate| *rate != 0.0) {
                true => read_obstacles(obstacles),
                false => Vec::new(),
            },
        }
    }
}

/// The turn `q exp(turn)` of a change of the quaternion `q`, `2 q* dq`; what would change its length does nothing.
fn turn_of(q: &UnitQuaternion<f64>, [w, x, y, z]: [f64; 4]) -> Vector3<f64> {
    (q.quaternion().conjugate() * Quaternion::new(w, x, y, z)).imag() * 2.0
}

/// Changes of states by rows: axes of each array are rows, then commands. A row without them is not a number.
#[pyclass(frozen, get_all, module = "tdcr._tdcr")]
pub struct RolloutTangentRows {
    positions: Py<PyArray4<f64>>,
    quaternions: Py<PyArray4<f64>>,
    velocity: Py<PyArray4<f64>>,
    /// Rows that could not go on or have no derivatives: class of the exception, and why.
    failures: Vec<(usize, &'static str, String)>,
}

/// Where the changes of one row go.
struct Row<'a> {
    positions: &'a mut [f64],
    quaternions: &'a mut [f64],
    velocity: &'a mut [f64],
}

/// The changes of a row; or why there are none.
fn differentiate(
    (motions, rates, names): (&Motions, &Numbers, &[Parameter]),
    at_hand: &mut Option<MovingRobot>,
    row: usize,
    watch: &Watch,
    out: &mut Row<'_>,
) -> Outcome<End> {
    let Replayed {
        rollout,
        states,
        orientations,
    } = match motions.replay(at_hand, row, watch)? {
        Ok(replayed) => replayed,
        Err(end) => return Ok(end),
    };
    let direction = rates.direction(motions, row, &rollout.start.configuration.0, names);
    let Steps { timestep, skip, .. } = motions.steps;
    let tangents = match at_hand.as_ref().filter(|_| motions.scenes.is_some()) {
        Some(moving) => (moving.contact_stepper()).rollout_tangent(&rollout, &states, &direction),
        None => rollout_tangent(motions.robot(row), timestep, &rollout, &states, &direction),
    };
    let tangents = match tangents {
        Ok(tangents) => tangents,
        Err(error @ DynamicsError::NotDifferentiable) => return Ok(End::Failed(error.into())),
        Err(error) => return Err(error.into()),
    };
    let (n, seen) = (motions.discs, tangents.iter().skip(skip - 1).step_by(skip));
    for (step, (tangent, turned)) in seen.zip(&orientations).enumerate() {
        let discs = step * n..(step + 1) * n;
        let places = out.positions.as_chunks_mut::<3>().0[discs.clone()].iter_mut();
        let turns = out.quaternions.as_chunks_mut::<4>().0[discs.clone()].iter_mut();
        for (((place, quaternion), pose), q) in places.zip(turns).zip(&tangent.poses).zip(turned) {
            *place = pose.position.into();
            *quaternion = quaternion_change(q, &pose.rotation);
        }
        let rates = &tangent.coordinates[3 * n..];
        out.velocity[3 * discs.start..3 * discs.end].copy_from_slice(rates);
    }
    Ok(End::Whole)
}

/// Changes of the states after each command of all rows when what they depend on changes at `rates`, on all threads.
/// `progress` is told how many more rows are done.
#[pyfunction]
#[pyo3(signature = (robots, commands, loads, payload, wrench, start, steps, around, rates, names, progress=None))]
#[allow(clippy::too_many_arguments, reason = "Python's caller names them")]
pub fn rollout_jvp_rows(
    py: Python<'_>,
    robots: Vec<PyRef<'_, Robot>>,
    commands: PyReadonlyArray3<'_, f64>,
    loads: Vec<PyRef<'_, Loads>>,
    payload: Option<PyReadonlyArray1<'_, f64>>,
    wrench: Option<PyReadonlyArray3<'_, f64>>,
    start: Start<'_>,
    steps: PyRef<'_, Steps>,
    around: Around<'_>,
    rates: Rates<'_>,
    names: Vec<String>,
    progress: Option<Bound<'_, PyAny>>,
) -> Outcome<RolloutTangentRows> {
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
    let names = parameters_of(motions.robot(0), &names)?;
    let rates = Numbers::new(&rates, &motions, names.len())?;
    let (rows, length, n) = (motions.rows, motions.length, motions.discs);
    let none = |width: usize| vec![f64::NAN; rows * length * n * width];
    let [mut positions, mut quaternions, mut velocity] = [none(3), none(4), none(3)];
    let ends: Vec<Outcome<End>> = run::long(py, progress.as_ref(), |watch| {
        let poses = parts(&mut positions, rows).zip(parts(&mut quaternions, rows));
        let out = poses.zip(parts(&mut velocity, rows));
        let out = out.map(|((positions, quaternions), velocity)| Row {
            positions,
            quaternions,
            velocity,
        });
        let mut out: Vec<Row<'_>> = out.collect();
        out.par_iter_mut()
            .enumerate()
            .map_init(
                || None,
                |at_hand, (row, out)| {
                    let end = differentiate((&motions, &rates, &names), at_hand, row, watch, out);
                    watch.advance(1);
                    end
                },
            )
            .collect()
    })?;
    let failures = failures(ends, &motions)?;
    Ok(RolloutTangentRows {
        positions: array(py, positions, [rows, length, n, 3])?.unbind(),
        quaternions: array(py, quaternions, [rows, length, n, 4])?.unbind(),
        velocity: array(py, velocity, [rows, length, n, 3])?.unbind(),
        failures,
    })
}
