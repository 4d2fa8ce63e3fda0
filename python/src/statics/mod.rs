//! Equilibria, one or by rows.

mod batch;
mod memory;
mod numbers;

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use tdcr::sim::chain::Configuration;
use tdcr::sim::robot::Command;

use crate::arrays::{Tape, contiguous, quaternions};
use crate::errors::Outcome;
use crate::loads::Loads;
use crate::robot::Robot;
use crate::run;

pub use batch::{Batch, RowsArgument};
pub use memory::{read_memory, write_memory};
pub use numbers::{EquilibriumRows, Numbers, One, Row, code, one};

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
