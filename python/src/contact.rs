//! Equilibria among obstacles, one or by rows.

use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use tdcr::sim::chain::Configuration;
use tdcr::sim::contact::{Activity, Contact, ContactEquilibrium, Sliding};
use tdcr::sim::robot::Command;
use tdcr::sim::scene::{ContactLaw, SelfContact};

use crate::arrays::{array, contiguous, flat_points, flat_quaternions, quaternions};
use crate::errors::{Failure, Outcome};
use crate::loads::Loads;
use crate::robot::Robot;
use crate::run;
use crate::scene::Scene;
use crate::statics::{Batch, EquilibriumRows, Numbers, One, Row, RowsArgument, code, one};

/// Scenes as they come from Python: one for all rows, or one a row.
pub type ScenesArgument<'py> = Vec<PyRef<'py, Scene>>;

/// The scenes of the rows of a batch: one for all rows, or one a row.
pub struct Scenes(Vec<tdcr::sim::scene::Scene>);

impl Scenes {
    /// Those of `rows` rows, all with as many obstacles.
    pub fn new(scenes: &[PyRef<'_, Scene>], rows: usize) -> Outcome<Self> {
        let scenes: Vec<_> = scenes.iter().map(|scene| scene.0.clone()).collect();
        if scenes.is_empty() || (scenes.len() != 1 && scenes.len() != rows) {
            let message = format!("{} scenes; expected 1 or {rows}, one a row", scenes.len());
            return Err(Failure::input(message));
        }
        let count = scenes[0].obstacles().len();
        let other = (scenes.iter()).position(|scene| scene.obstacles().len() != count);
        match other {
            None => Ok(Self(scenes)),
            Some(other) => Err(Failure::input(format!(
                "scene {other} has {} obstacles, scene 0 has {count}: expected as many",
                scenes[other].obstacles().len()
            ))),
        }
    }

    /// Number of obstacles.
    pub fn obstacles(&self) -> usize {
        self.0[0].obstacles().len()
    }

    /// Whether each row has one of its own.
    pub fn differ(&self) -> bool {
        self.0.len() > 1
    }

    /// The scene of a row.
    pub fn of_row(&self, row: usize) -> &tdcr::sim::scene::Scene {
        &self.0[if self.differ() { row } else { 0 }]
    }

    /// A settler for a row, the one at hand where it is of the same robot and scene.
    pub fn settler<'a>(
        &self,
        batch: &Batch,
        at_hand: &'a mut Option<tdcr::sim::contact::ContactSettler>,
        row: usize,
    ) -> &'a mut tdcr::sim::contact::ContactSettler {
        if self.differ() || batch.one_robot().is_err() {
            *at_hand = None;
        }
        at_hand.get_or_insert_with(|| {
            tdcr::sim::contact::ContactSettler::new(batch.robot(row), self.of_row(row))
        })
    }
}

/// What robots touch, by rows: contacts one after another, and of each row how exact they are.
#[pyclass(frozen, get_all, module = "tdcr._tdcr")]
pub struct ContactRows {
    row: Py<PyArray1<i64>>,
    disc: Py<PyArray1<i64>>,
    obstacle: Py<PyArray1<i64>>,
    other_disc: Py<PyArray1<i64>>,
    point: Py<PyArray2<f64>>,
    normal: Py<PyArray2<f64>>,
    gap: Py<PyArray1<f64>>,
    force: Py<PyArray2<f64>>,
    weak: Py<PyArray1<bool>>,
    sliding: Py<PyArray1<u8>>,
    complementarity: Py<PyArray1<f64>>,
    penetration: Py<PyArray1<f64>>,
    shape_error: Py<PyArray1<f64>>,
}

/// What one robot touches.
#[derive(Default)]
pub struct Touched {
    contacts: Vec<Contact>,
    complementarity: f64,
    penetration: f64,
    /// How far a plane that touches a disc may be from one that touches its beads (m).
    shape_error: f64,
}

impl Touched {
    /// What a robot touches in an equilibrium, with its beads' shape error (m).
    pub fn at_rest(found: &ContactEquilibrium, shape_error: f64) -> Self {
        Self {
            contacts: found.contacts.clone(),
            complementarity: found.complementarity,
            penetration: found.penetration,
            shape_error,
        }
    }

    /// The same of a settler's last equilibrium.
    fn of(settler: &tdcr::sim::contact::ContactSettler) -> Self {
        Self::at_rest(settler.found(), settler.beads().shape_error())
    }

    /// What a robot in motion touches, with its beads' shape error (m).
    pub fn in_motion(
        contacts: &[Contact],
        scene: &tdcr::sim::scene::Scene,
        shape_error: f64,
    ) -> Self {
        // Under MuJoCo's law surfaces do not give way by their compliance.
        let is_compliant = matches!(scene.contact_law(), ContactLaw::Compliant { .. });
        let product = |contact: &Contact| {
            let compliance = match (contact.partner.obstacle(), scene.self_contact()) {
                _ if !is_compliant => 0.0,
                (Some(obstacle), _) => scene.obstacles()[obstacle].compliance,
                (None, SelfContact::Touching { compliance, .. }) => compliance,
                (None, SelfContact::Ignored) => 0.0,
            };
            let force = contact.force.dot(&contact.normal);
            (force * (contact.gap + compliance * force)).abs()
        };
        Self {
            complementarity: contacts.iter().map(product).fold(0.0, f64::max),
            penetration: (contacts.iter().map(|contact| -contact.gap)).fold(0.0, f64::max),
            contacts: contacts.to_vec(),
            shape_error,
        }
    }
}

/// Contacts of rows as arrays.
pub fn arrays(py: Python<'_>, rows: &[Touched]) -> PyResult<ContactRows> {
    let each = || rows.iter().flat_map(|row| &row.contacts);
    let count = each().count();
    let number = |index: usize| index as i64;
    let or_none = |index: Option<usize>| index.map_or(-1, number);
    let numbers = |values: Vec<i64>| array(py, values, [count]).map(Bound::unbind);
    let vectors = |of: fn(&Contact) -> Vector3<f64>| {
        let vectors: Vec<_> = each().map(of).collect();
        array(py, flat_points(&vectors).collect(), [count, 3]).map(Bound::unbind)
    };
    let by_row = |of: fn(&Touched) -> f64| {
        array(py, rows.iter().map(of).collect(), [rows.len()]).map(Bound::unbind)
    };
    let owner = (rows.iter().enumerate())
        .flat_map(|(index, row)| std::iter::repeat_n(number(index), row.contacts.len()));
    let sliding = each().map(|contact| code(&SLIDING, contact.sliding));
    let weak = each().map(|contact| contact.activity == Activity::Weak);
    Ok(ContactRows {
        row: numbers(owner.collect())?,
        disc: numbers(each().map(|contact| number(contact.disc)).collect())?,
        obstacle: numbers(
            each()
                .map(|contact| or_none(contact.partner.obstacle()))
                .collect(),
        )?,
        other_disc: numbers(
            each()
                .map(|contact| or_none(contact.partner.disc()))
                .collect(),
        )?,
        point: vectors(|contact| contact.point)?,
        normal: vectors(|contact| contact.normal)?,
        gap: array(py, each().map(|contact| contact.gap).collect(), [count])?.unbind(),
        force: vectors(|contact| contact.force)?,
        weak: array(py, weak.collect(), [count])?.unbind(),
        sliding: array(py, sliding.collect(), [count])?.unbind(),
        complementarity: by_row(|row| row.complementarity)?,
        penetration: by_row(|row| row.penetration)?,
        shape_error: by_row(|row| row.shape_error)?,
    })
}

/// Whether contacts slide, by their codes in arrays: the names are `SLIDING` of `tdcr.contact`.
const SLIDING: [Sliding; 3] = [Sliding::Free, Sliding::Sticks, Sliding::Slips];

/// An equilibrium, and what the robot touches in it, as rows of one.
type OneAmong<'py> = (One<'py>, ContactRows);

fn one_among<'py>(
    py: Python<'py>,
    settler: &tdcr::sim::contact::ContactSettler,
) -> Outcome<OneAmong<'py>> {
    let touched = arrays(py, &[Touched::of(settler)])?;
    Ok((one(py, &settler.found().equilibrium)?, touched))
}

/// Settles one robot in a scene from the straight pose.
#[pyfunction]
#[pyo3(signature = (robot, scene, command, loads, payload=None, wrench=None))]
pub fn settle_one_among<'py>(
    py: Python<'py>,
    robot: PyRef<'_, Robot>,
    scene: PyRef<'_, Scene>,
    command: PyReadonlyArray1<'_, f64>,
    loads: PyRef<'_, Loads>,
    payload: Option<f64>,
    wrench: Option<PyReadonlyArray2<'_, f64>>,
) -> Outcome<OneAmong<'py>> {
    let robot = &robot.0;
    let (discs, tendons) = (robot.discs().len(), robot.tendons().len());
    let command = robot.command(contiguous(&command, "command", &[tendons])?)?;
    let wrench = match &wrench {
        Some(wrench) => contiguous(wrench, "wrench", &[discs, 6])?,
        None => &[],
    };
    let loads = loads.with(payload, wrench.as_chunks::<6>().0)?;
    loads.check(robot)?;
    let mut settler = tdcr::sim::contact::ContactSettler::new(robot, &scene.0);
    run::long(py, None, |_| settler.settle(&command, &loads).map(drop))??;
    one_among(py, &settler)
}

/// Settles each row in its scene from the straight pose, on all threads. `progress` is told how many more rows are done.
#[pyfunction]
#[pyo3(signature = (rows, scenes, progress=None))]
pub fn settle_rows_among(
    py: Python<'_>,
    rows: RowsArgument<'_>,
    scenes: ScenesArgument<'_>,
    progress: Option<Bound<'_, PyAny>>,
) -> Outcome<(EquilibriumRows, ContactRows)> {
    let rows = Batch::new(&rows)?;
    let scenes = Scenes::new(&scenes, rows.rows())?;
    let mut numbers = Numbers::new(rows.rows(), rows.discs, rows.tendons);
    let touched = run::long(py, progress.as_ref(), |watch| {
        let settle = |settler: &mut Option<_>, (row, out): (usize, &mut Row<'_>)| {
            if watch.stopped() {
                return Ok(Touched::default());
            }
            let settler = scenes.settler(&rows, settler, row);
            let found = settler.settle(&rows.commands[row], &rows.loads[row]);
            let found = found.map_err(|error| of_row(error.into(), row, rows.rows()))?;
            out.write(&found.equilibrium);
            watch.advance(1);
            Ok(Touched::of(settler))
        };
        // All rows, of which the first failure counts, whatever thread is first.
        let all: Vec<Outcome<Touched>> = (numbers.rows().par_iter_mut().enumerate())
            .map_init(|| None, settle)
            .collect();
        all.into_iter().collect::<Outcome<Vec<_>>>()
    })??;
    Ok((numbers.into_arrays(py)?, arrays(py, &touched)?))
}

/// Follows the branch of equilibria in a scene along rows of commands, each from the last one.
#[pyfunction]
#[pyo3(signature = (rows, scene, progress=None))]
pub fn follow_rows_among(
    py: Python<'_>,
    rows: RowsArgument<'_>,
    scene: PyRef<'_, Scene>,
    progress: Option<Bound<'_, PyAny>>,
) -> Outcome<(EquilibriumRows, ContactRows)> {
    let rows = Batch::new(&rows)?;
    let mut settler = tdcr::sim::contact::ContactSettler::new(rows.one_robot()?, &scene.0);
    let mut numbers = Numbers::new(rows.rows(), rows.discs, rows.tendons);
    let touched = run::long(py, progress.as_ref(), |watch| {
        let mut touched = Vec::with_capacity(rows.rows());
        for (row, out) in numbers.rows().iter_mut().enumerate() {
            if watch.stopped() {
                break;
            }
            let found = settler.follow(&rows.commands[row], &rows.loads[row]);
            let found = found.map_err(|error| of_row(error.into(), row, rows.rows()))?;
            out.write(&found.equilibrium);
            touched.push(Touched::of(&settler));
            watch.advance(1);
        }
        Ok::<_, Failure>(touched)
    })??;
    Ok((numbers.into_arrays(py)?, arrays(py, &touched)?))
}

/// A failure of a row, which is named where there are several.
fn of_row(failure: Failure, row: usize, rows: usize) -> Failure {
    match rows {
        1 => failure,
        _ => failure.of_row(row),
    }
}

/// Finds equilibria of one robot in one scene, and remembers the last one.
#[pyclass(module = "tdcr._tdcr")]
pub struct ContactSettler {
    settler: tdcr::sim::contact::ContactSettler,
    /// Where to go on from, before the first solve of a resumed settler.
    start: Option<Configuration>,
}

impl ContactSettler {
    fn question(&self, command: &PyReadonlyArray1<'_, f64>, loads: &Loads) -> Outcome<Command> {
        let robot = self.settler.robot();
        let tendons = robot.tendons().len();
        let command = robot.command(contiguous(command, "command", &[tendons])?)?;
        loads.0.check(robot)?;
        Ok(command)
    }

    /// Solves from a configuration, or goes on from the last equilibrium.
    fn solve<'py>(
        &mut self,
        py: Python<'py>,
        from: Start,
        command: &Command,
        loads: &Loads,
    ) -> Outcome<OneAmong<'py>> {
        let resumed = self.start.take();
        let (settler, loads) = (&mut self.settler, &loads.0);
        run::long(py, None, |_| {
            match (from, resumed) {
                (Start::Straight, _) => settler.settle(command, loads),
                (Start::Configuration(start), _) | (Start::Last, Some(start)) => {
                    settler.settle_from(&start, command, loads)
                }
                (Start::Last, None) => settler.follow(command, loads),
            }
            .map(drop)
        })??;
        one_among(py, &self.settler)
    }
}

/// Where a solve starts.
enum Start {
    Straight,
    Configuration(Configuration),
    Last,
}

#[pymethods]
impl ContactSettler {
    #[new]
    fn new(robot: PyRef<'_, Robot>, scene: PyRef<'_, Scene>) -> Self {
        Self {
            settler: tdcr::sim::contact::ContactSettler::new(&robot.0, &scene.0),
            start: None,
        }
    }

    /// Settles from the straight pose.
    fn settle<'py>(
        &mut self,
        py: Python<'py>,
        command: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
    ) -> Outcome<OneAmong<'py>> {
        let command = self.question(&command, &loads)?;
        self.solve(py, Start::Straight, &command, &loads)
    }

    /// Follows the branch of equilibria from the last one.
    fn follow<'py>(
        &mut self,
        py: Python<'py>,
        command: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
    ) -> Outcome<OneAmong<'py>> {
        let command = self.question(&command, &loads)?;
        self.solve(py, Start::Last, &command, &loads)
    }

    /// Settles from a configuration, shape (discs, 4).
    fn settle_from<'py>(
        &mut self,
        py: Python<'py>,
        command: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
        configuration: PyReadonlyArray2<'_, f64>,
    ) -> Outcome<OneAmong<'py>> {
        let command = self.question(&command, &loads)?;
        let discs = self.settler.robot().discs().len();
        let start = contiguous(&configuration, "configuration", &[discs, 4])?;
        let start = Start::Configuration(Configuration(quaternions(start)));
        self.solve(py, start, &command, &loads)
    }

    /// The configuration to go on from, as numbers; none before anything has settled.
    fn memory<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let last = &self.settler.found().equilibrium;
        let settled = last.converged.then_some(&last.configuration);
        let numbers = (self.start.as_ref().or(settled))
            .map_or(Vec::new(), |start| flat_quaternions(&start.0).collect());
        PyArray1::from_vec(py, numbers)
    }

    /// Goes on from the memory of another settler of the same robot and scene, whatever the loads were.
    #[pyo3(signature = (memory, loads))]
    fn resume(
        &mut self,
        memory: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
    ) -> Outcome<()> {
        loads.0.check(self.settler.robot())?;
        let discs = self.settler.robot().discs().len();
        let numbers = match numpy::PyUntypedArrayMethods::len(&*memory) {
            0 => return Ok(()),
            _ => contiguous(&memory, "memory", &[4 * discs])?,
        };
        self.start = Some(Configuration(quaternions(numbers)));
        Ok(())
    }
}
