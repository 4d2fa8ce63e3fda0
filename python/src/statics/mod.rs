//! Equilibria, one or by rows.

use std::f64::consts::TAU;

use nalgebra::UnitQuaternion;
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use rayon::prelude::*;
use tdcr::sim::chain::Configuration;
use tdcr::sim::robot::Command;
use tdcr::sim::statics::{Equilibrium, Examined, Growth, Memory, Stability};

use crate::arrays::{
    Tape, array, contiguous, flat_points, flat_quaternions, quaternions, write_points,
    write_quaternions,
};
use crate::errors::{Failure, Outcome};
use crate::loads::{LoadRows, Loads};
use crate::robot::{Robot, of_rows};
use crate::run;

/// Rows as they come from Python: robots, commands (rows, tendons), loads, payloads (rows,) and wrenches (rows, discs, 6).
pub type RowsArgument<'py> = (
    Vec<PyRef<'py, Robot>>,
    PyReadonlyArray2<'py, f64>,
    Vec<PyRef<'py, Loads>>,
    Option<PyReadonlyArray1<'py, f64>>,
    Option<PyReadonlyArray3<'py, f64>>,
);

/// What each row is asked for: a robot, a command and loads.
pub struct Batch {
    /// One for all rows, or one a row; all of as many discs and tendons.
    robots: Vec<tdcr::sim::robot::Robot>,
    pub commands: Vec<Command>,
    pub loads: Vec<tdcr::sim::robot::Loads>,
    pub discs: usize,
    pub tendons: usize,
}

impl Batch {
    /// Checks the rows of a batch.
    pub fn new((robots, commands, loads, payload, wrench): &RowsArgument<'_>) -> Outcome<Self> {
        let rows = numpy::PyUntypedArrayMethods::shape(&**commands)[0];
        let robots = of_rows(robots, rows)?;
        let (discs, tendons) = (robots[0].discs().len(), robots[0].tendons().len());
        let values = contiguous(commands, "commands", &[rows, tendons])?;
        let rows_of_loads = LoadRows::new(loads, payload.as_ref(), wrench.as_ref(), rows, discs)?;
        let mut questions = Self {
            commands: Vec::with_capacity(rows),
            loads: Vec::with_capacity(rows),
            robots,
            discs,
            tendons,
        };
        for row in 0..rows {
            let values = &values[row * tendons..(row + 1) * tendons];
            let of_row = |failure: Failure| {
                if rows == 1 {
                    failure
                } else {
                    failure.of_row(row)
                }
            };
            let command = questions.robot(row).command(values);
            questions
                .commands
                .push(command.map_err(|error| of_row(error.into()))?);
            let loads = rows_of_loads.row(row).map_err(of_row)?;
            loads
                .check(questions.robot(row))
                .map_err(|error| of_row(error.into()))?;
            questions.loads.push(loads);
        }
        Ok(questions)
    }

    pub fn rows(&self) -> usize {
        self.commands.len()
    }

    pub fn robot(&self, row: usize) -> &tdcr::sim::robot::Robot {
        &self.robots[if self.robots.len() == 1 { 0 } else { row }]
    }

    /// The robot of all rows.
    pub fn one_robot(&self) -> Outcome<&tdcr::sim::robot::Robot> {
        match self.robots.as_slice() {
            [robot] => Ok(robot),
            several => {
                let message = format!("{} robots; expected one for all rows", several.len());
                Err(Failure::input(message))
            }
        }
    }

    /// A settler for a row, the one at hand where it is of the same robot.
    pub fn settler<'a>(
        &self,
        at_hand: &'a mut Option<tdcr::sim::statics::Settler>,
        row: usize,
    ) -> &'a mut tdcr::sim::statics::Settler {
        if self.robots.len() > 1 {
            *at_hand = None;
        }
        at_hand.get_or_insert_with(|| tdcr::sim::statics::Settler::new(self.robot(row)))
    }
}

/// Equilibria by rows: the first axis of each array.
#[pyclass(frozen, get_all, module = "tdcr._tdcr")]
pub struct EquilibriumRows {
    positions: Py<PyArray3<f64>>,
    quaternions: Py<PyArray3<f64>>,
    configuration: Py<PyArray3<f64>>,
    lengths: Py<PyArray2<f64>>,
    tensions: Py<PyArray2<f64>>,
    residual: Py<PyArray1<f64>>,
    iterations: Py<PyArray1<u32>>,
    converged: Py<PyArray1<bool>>,
    stability: Py<PyArray1<u8>>,
    examined: Py<PyArray1<u8>>,
    growth: Py<PyArray2<f64>>,
}

/// The numbers of [`EquilibriumRows`], before they are arrays.
pub struct Numbers {
    discs: usize,
    tendons: usize,
    positions: Vec<f64>,
    quaternions: Vec<f64>,
    configuration: Vec<f64>,
    lengths: Vec<f64>,
    tensions: Vec<f64>,
    residual: Vec<f64>,
    iterations: Vec<u32>,
    converged: Vec<bool>,
    stability: Vec<u8>,
    examined: Vec<u8>,
    growth: Vec<f64>,
}

/// Where the numbers of one row go.
pub struct Row<'a> {
    positions: &'a mut [f64],
    quaternions: &'a mut [f64],
    configuration: &'a mut [f64],
    lengths: &'a mut [f64],
    tensions: &'a mut [f64],
    residual: &'a mut f64,
    iterations: &'a mut u32,
    converged: &'a mut bool,
    stability: &'a mut u8,
    examined: &'a mut u8,
    growth: &'a mut [f64; 2],
}

impl Numbers {
    pub fn new(rows: usize, discs: usize, tendons: usize) -> Self {
        Self {
            discs,
            tendons,
            positions: vec![0.0; 3 * discs * rows],
            quaternions: vec![0.0; 4 * discs * rows],
            configuration: vec![0.0; 4 * discs * rows],
            lengths: vec![0.0; tendons * rows],
            tensions: vec![0.0; tendons * rows],
            residual: vec![0.0; rows],
            iterations: vec![0; rows],
            converged: vec![false; rows],
            stability: vec![0; rows],
            examined: vec![0; rows],
            growth: vec![0.0; 2 * rows],
        }
    }

    /// Where each row goes.
    pub fn rows(&mut self) -> Vec<Row<'_>> {
        let (n, t) = (self.discs, self.tendons);
        let mut lengths = self.lengths.as_mut_slice();
        let mut tensions = self.tensions.as_mut_slice();
        let places = self.positions.chunks_exact_mut(3 * n);
        let turns = self.quaternions.chunks_exact_mut(4 * n);
        let joints = self.configuration.chunks_exact_mut(4 * n);
        let solved = self.residual.iter_mut().zip(&mut self.iterations);
        let state = self.converged.iter_mut().zip(&mut self.stability);
        let growth = self.growth.as_chunks_mut::<2>().0.iter_mut();
        let state = state.zip(self.examined.iter_mut().zip(growth));
        (places.zip(turns).zip(joints))
            .zip(solved.zip(state))
            .map(
                |(
                    ((positions, quaternions), configuration),
                    ((residual, iterations), ((converged, stability), (examined, growth))),
                )| {
                    let (length, rest) = std::mem::take(&mut lengths).split_at_mut(t);
                    lengths = rest;
                    let (tension, rest) = std::mem::take(&mut tensions).split_at_mut(t);
                    tensions = rest;
                    Row {
                        positions,
                        quaternions,
                        configuration,
                        lengths: length,
                        tensions: tension,
                        residual,
                        iterations,
                        converged,
                        stability,
                        examined,
                        growth,
                    }
                },
            )
            .collect()
    }

    pub fn into_arrays(self, py: Python<'_>) -> PyResult<EquilibriumRows> {
        let (rows, n, t) = (self.residual.len(), self.discs, self.tendons);
        Ok(EquilibriumRows {
            positions: array(py, self.positions, [rows, n, 3])?.unbind(),
            quaternions: array(py, self.quaternions, [rows, n, 4])?.unbind(),
            configuration: array(py, self.configuration, [rows, n, 4])?.unbind(),
            lengths: array(py, self.lengths, [rows, t])?.unbind(),
            tensions: array(py, self.tensions, [rows, t])?.unbind(),
            residual: array(py, self.residual, [rows])?.unbind(),
            iterations: array(py, self.iterations, [rows])?.unbind(),
            converged: array(py, self.converged, [rows])?.unbind(),
            stability: array(py, self.stability, [rows])?.unbind(),
            examined: array(py, self.examined, [rows])?.unbind(),
            growth: array(py, self.growth, [rows, 2])?.unbind(),
        })
    }
}

/// An equilibrium: positions, quaternions, configuration, lengths, tensions, residual, iterations, whether it converged,
/// the codes of its stability and of what was examined, and the fastest growth.
type One<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    f64,
    usize,
    bool,
    u8,
    u8,
    Bound<'py, PyArray1<f64>>,
);

/// One equilibrium as arrays, without the first axis of [`EquilibriumRows`].
fn one<'py>(py: Python<'py>, equilibrium: &Equilibrium) -> PyResult<One<'py>> {
    let n = equilibrium.positions.len();
    let turns = |quaternions: &[UnitQuaternion<f64>]| {
        let mut numbers = vec![0.0; 4 * n];
        write_quaternions(quaternions, &mut numbers);
        array(py, numbers, [n, 4])
    };
    let mut points = vec![0.0; 3 * n];
    write_points(&equilibrium.positions, &mut points);
    Ok((
        array(py, points, [n, 3])?,
        turns(&equilibrium.orientations)?,
        turns(&equilibrium.configuration.0)?,
        PyArray1::from_slice(py, &equilibrium.tendon_lengths),
        PyArray1::from_slice(py, &equilibrium.tendon_tensions),
        equilibrium.residual,
        equilibrium.iterations,
        equilibrium.converged,
        code(&STABILITY, equilibrium.stability),
        code(&EXAMINED, equilibrium.examined),
        PyArray1::from_slice(py, &growth_numbers(equilibrium.growth)),
    ))
}

/// Its rate (1/s) and frequency (Hz); zeros for none.
fn growth_numbers(growth: Option<Growth>) -> [f64; 2] {
    growth.map_or([0.0; 2], |growth| {
        [growth.rate, growth.angular_frequency / TAU]
    })
}

impl Row<'_> {
    pub fn write(&mut self, equilibrium: &Equilibrium) {
        write_points(&equilibrium.positions, self.positions);
        write_quaternions(&equilibrium.orientations, self.quaternions);
        write_quaternions(&equilibrium.configuration.0, self.configuration);
        self.lengths.copy_from_slice(&equilibrium.tendon_lengths);
        self.tensions.copy_from_slice(&equilibrium.tendon_tensions);
        *self.residual = equilibrium.residual;
        *self.iterations = u32::try_from(equilibrium.iterations).unwrap_or(u32::MAX);
        *self.converged = equilibrium.converged;
        *self.stability = code(&STABILITY, equilibrium.stability);
        *self.examined = code(&EXAMINED, equilibrium.examined);
        *self.growth = growth_numbers(equilibrium.growth);
    }
}

/// Kinds of stability, by their codes in arrays: the names are `STABILITY` of `tdcr.statics`.
const STABILITY: [Option<Stability>; 5] = [
    None,
    Some(Stability::Stable),
    Some(Stability::Neutral),
    Some(Stability::Unstable),
    Some(Stability::Flutter),
];

/// What is examined, by its codes: the names are `EXAMINED`.
const EXAMINED: [Option<Examined>; 4] = [
    None,
    Some(Examined::Energy),
    Some(Examined::Motion),
    Some(Examined::Statics),
];

fn code<T: PartialEq>(kinds: &[T], kind: T) -> u8 {
    let place = kinds.iter().position(|known| *known == kind);
    place
        .and_then(|place| u8::try_from(place).ok())
        .unwrap_or(0)
}

/// Numbers of a settler's memory, for [`read_memory`].
pub fn write_memory(memory: &Memory, out: &mut Vec<f64>) {
    let at = &memory.equilibrium;
    out.extend([
        f64::from(at.converged),
        f64::from(code(&STABILITY, at.stability)),
    ]);
    out.push(f64::from(code(&EXAMINED, at.examined)));
    let growth = at.growth.map_or([0.0; 3], |growth| {
        let without = f64::from(growth.without_damping);
        [growth.rate, growth.angular_frequency, without]
    });
    out.extend(growth);
    out.extend([at.residual, at.iterations as f64]);
    out.extend(flat_quaternions(&at.configuration.0));
    out.extend(flat_points(&at.positions));
    out.extend(flat_quaternions(&at.orientations));
    out.extend(at.tendon_lengths.iter().chain(&at.tendon_tensions));
    out.extend(flat_quaternions(&memory.predicted.0));
    out.extend(memory.command.iter().chain(&memory.change));
}

/// The memory of a settler of `robot` that [`write_memory`] wrote.
pub fn read_memory(robot: &tdcr::sim::robot::Robot, tape: &mut Tape<'_>) -> Memory {
    let (n, t) = (robot.discs().len(), robot.tendons().len());
    let (converged, stability) = (tape.number() == 1.0, tape.number());
    let examined = tape.number();
    let growth = Growth {
        rate: tape.number(),
        angular_frequency: tape.number(),
        without_damping: tape.number() == 1.0,
    };
    Memory {
        equilibrium: Equilibrium {
            converged,
            stability: STABILITY.get(stability as usize).copied().flatten(),
            examined: EXAMINED.get(examined as usize).copied().flatten(),
            growth: (growth.rate > 0.0).then_some(growth),
            residual: tape.number(),
            iterations: tape.number() as usize,
            configuration: Configuration(tape.quaternions(n)),
            positions: tape.points(n),
            orientations: tape.quaternions(n),
            tendon_lengths: tape.take(t).to_vec(),
            tendon_tensions: tape.take(t).to_vec(),
        },
        predicted: Configuration(tape.quaternions(n)),
        command: tape.take(t).to_vec(),
        change: tape.take(t).to_vec(),
    }
}

/// Most discs of a robot that settles faster than a thread is woken.
pub const SMALL: usize = 64;

/// Settles one robot from the straight pose: one row of [`settle_rows`], without what only many need.
#[pyfunction]
#[pyo3(signature = (robot, command, loads, payload=None, wrench=None))]
pub fn settle_one<'py>(
    py: Python<'py>,
    robot: PyRef<'_, Robot>,
    command: PyReadonlyArray1<'_, f64>,
    loads: PyRef<'_, Loads>,
    payload: Option<f64>,
    wrench: Option<PyReadonlyArray2<'_, f64>>,
) -> Outcome<One<'py>> {
    let robot = &robot.0;
    let (discs, tendons) = (robot.discs().len(), robot.tendons().len());
    let command = robot.command(contiguous(&command, "command", &[tendons])?)?;
    let wrench = match &wrench {
        Some(wrench) => contiguous(wrench, "wrench", &[discs, 6])?,
        None => &[],
    };
    let loads = loads.with(payload, wrench.as_chunks::<6>().0)?;
    loads.check(robot)?;
    let settle = || robot.settle(&command, &loads);
    let settled = match discs <= SMALL {
        true => py.detach(settle),
        false => run::long(py, None, |_| settle())?,
    };
    Ok(one(py, &settled)?)
}

/// Settles each row from the straight pose, on all threads. `progress` is told how many more rows are done.
#[pyfunction]
#[pyo3(signature = (rows, progress=None))]
pub fn settle_rows(
    py: Python<'_>,
    rows: RowsArgument<'_>,
    progress: Option<Bound<'_, PyAny>>,
) -> Outcome<EquilibriumRows> {
    let rows = Batch::new(&rows)?;
    let mut numbers = Numbers::new(rows.rows(), rows.discs, rows.tendons);
    if rows.rows() == 1 && rows.discs <= SMALL && progress.is_none() {
        py.detach(|| {
            let settled = rows.robot(0).settle(&rows.commands[0], &rows.loads[0]);
            numbers.rows()[0].write(&settled);
        });
        return Ok(numbers.into_arrays(py)?);
    }
    run::long(py, progress.as_ref(), |watch| {
        numbers.rows().par_iter_mut().enumerate().for_each_init(
            || None,
            |settler, (row, out)| {
                if !watch.stopped() {
                    let settler = rows.settler(settler, row);
                    out.write(settler.settle(&rows.commands[row], &rows.loads[row]));
                    watch.advance(1);
                }
            },
        );
    })?;
    Ok(numbers.into_arrays(py)?)
}

/// Follows the branch of equilibria along rows of commands, each from the last one.
#[pyfunction]
#[pyo3(signature = (rows, progress=None))]
pub fn follow_rows(
    py: Python<'_>,
    rows: RowsArgument<'_>,
    progress: Option<Bound<'_, PyAny>>,
) -> Outcome<EquilibriumRows> {
    let rows = Batch::new(&rows)?;
    let mut settler = tdcr::sim::statics::Settler::new(rows.one_robot()?);
    let mut numbers = Numbers::new(rows.rows(), rows.discs, rows.tendons);
    run::long(py, progress.as_ref(), |watch| {
        for (row, out) in numbers.rows().iter_mut().enumerate() {
            if watch.stopped() {
                break;
            }
            out.write(settler.follow(&rows.commands[row], &rows.loads[row]));
            watch.advance(1);
        }
    })?;
    Ok(numbers.into_arrays(py)?)
}

/// Finds equilibria of one robot, and remembers the last one.
#[pyclass(module = "tdcr._tdcr")]
pub struct Settler(tdcr::sim::statics::Settler);

impl Settler {
    fn question(&self, command: &PyReadonlyArray1<'_, f64>, loads: &Loads) -> Outcome<Command> {
        let tendons = self.0.robot().tendons().len();
        let command = self
            .0
            .robot()
            .command(contiguous(command, "command", &[tendons])?)?;
        loads.0.check(self.0.robot())?;
        Ok(command)
    }

    fn found<'py>(&self, py: Python<'py>) -> Outcome<One<'py>> {
        Ok(one(py, self.0.equilibrium())?)
    }
}

#[pymethods]
impl Settler {
    #[new]
    fn new(robot: PyRef<'_, Robot>) -> Self {
        Self(tdcr::sim::statics::Settler::new(&robot.0))
    }

    /// Settles from the straight pose.
    fn settle<'py>(
        &mut self,
        py: Python<'py>,
        command: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
    ) -> Outcome<One<'py>> {
        let command = self.question(&command, &loads)?;
        let (settler, loads) = (&mut self.0, &loads.0);
        py.detach(|| {
            settler.settle(&command, loads);
        });
        self.found(py)
    }

    /// Follows the branch of equilibria from the last one.
    fn follow<'py>(
        &mut self,
        py: Python<'py>,
        command: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
    ) -> Outcome<One<'py>> {
        let command = self.question(&command, &loads)?;
        let (settler, loads) = (&mut self.0, &loads.0);
        py.detach(|| {
            settler.follow(&command, loads);
        });
        self.found(py)
    }

    /// Settles from a configuration, shape (discs, 4).
    fn settle_from<'py>(
        &mut self,
        py: Python<'py>,
        command: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
        configuration: PyReadonlyArray2<'_, f64>,
    ) -> Outcome<One<'py>> {
        let command = self.question(&command, &loads)?;
        let discs = self.0.robot().discs().len();
        let start = contiguous(&configuration, "configuration", &[discs, 4])?;
        let start = Configuration(quaternions(start));
        let (settler, loads) = (&mut self.0, &loads.0);
        py.detach(|| {
            settler.settle_from(&start, &command, loads);
        });
        self.found(py)
    }

    /// What this settler remembers of its last solve, as numbers.
    fn memory<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let mut numbers = Vec::new();
        write_memory(&self.0.memory(), &mut numbers);
        PyArray1::from_vec(py, numbers)
    }

    /// Goes on from the memory of another settler of the same robot, which last settled under `loads`.
    fn resume(
        &mut self,
        memory: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
    ) -> Outcome<()> {
        let mut expected = Vec::new();
        write_memory(&self.0.memory(), &mut expected);
        let numbers = contiguous(&memory, "memory", &[expected.len()])?;
        loads.0.check(self.0.robot())?;
        let memory = read_memory(self.0.robot(), &mut Tape(numbers));
        self.0.resume(memory, &loads.0);
        Ok(())
    }
}
