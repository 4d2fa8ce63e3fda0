//! Many simulated robots, advanced by one call: what the Gymnasium environments run on.

mod observation;
mod row;
mod shown;
mod sight;

use nalgebra::Vector3;
use numpy::{PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray2};
use pyo3::prelude::*;
use rayon::prelude::*;
use tdcr::control::plan::Insertion;

use crate::arrays::{array, contiguous, write_points, write_quaternions};
use crate::errors::{Failure, Outcome};
use crate::objects::WIDTH;
use crate::robot::Robot;
use crate::run;
use crate::scene::Scene;
use observation::{Observed, Scale};
pub(crate) use row::Row;
use row::{Asked, Motion};

/// Robots of one size, each with a state of its own, advanced by one call.
///
/// A robot that does not settle, or whose motion diverges, is flagged as failed. It stays where it last was until it is reset.
#[pyclass(module = "tdcr._tdcr")]
pub struct BatchSimulation {
    rows: Vec<Row>,
    discs: usize,
    tendons: usize,
    motion: Option<Motion>,
    scale: Scale,
    carriage: Option<Insertion>,
}

/// Colours and depth of a picture.
type Picture<'py> = (Bound<'py, PyArray3<u8>>, Bound<'py, PyArray2<f32>>);

/// Number of contacts, largest force, sum of forces, and forces on discs.
type Touched<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray3<f64>>,
);

/// Does `work` for each of `rows`: on all threads where there are many.
fn each<T: Send>(
    py: Python<'_>,
    mut rows: Vec<T>,
    work: impl Fn(&mut T) + Sync + Send,
) -> Outcome<()> {
    if let [row] = rows.as_mut_slice() {
        py.detach(|| work(row));
        return Ok(());
    }
    run::short(py, || rows.par_iter_mut().for_each(work))
}

impl BatchSimulation {
    fn row(&mut self, row: usize) -> Outcome<&mut Row> {
        let count = self.rows.len();
        let refuse = || Failure::input(format!("row {row}; expected one below {count}"));
        self.rows.get_mut(row).ok_or_else(refuse)
    }

    /// A row, to be looked at.
    pub(crate) fn shown_row(&self, row: usize) -> Outcome<&Row> {
        let count = self.rows.len();
        let refuse = || Failure::input(format!("row {row}; expected one below {count}"));
        self.rows.get(row).ok_or_else(refuse)
    }

    fn fits(&self, robot: &Robot) -> Outcome<()> {
        let (discs, tendons) = (robot.0.discs().len(), robot.0.tendons().len());
        if (discs, tendons) == (self.discs, self.tendons) {
            return Ok(());
        }
        Err(Failure::input(format!(
            "a robot of {discs} discs and {tendons} tendons; expected {} and {}, as the others have",
            self.discs, self.tendons
        )))
    }

    /// Entries of a command: of the tendons, and of a base that moves.
    fn commanded(&self) -> usize {
        self.tendons + usize::from(self.carriage.is_some())
    }

    /// Numbers of all rows in one array, `width` of each.
    fn gathered(&self, width: usize, write: impl Fn(&Row, &mut [f64])) -> Vec<f64> {
        let mut values = vec![0.0; width * self.rows.len()];
        if width > 0 {
            for (row, out) in self.rows.iter().zip(values.chunks_exact_mut(width)) {
                write(row, out);
            }
        }
        values
    }
}

#[pymethods]
impl BatchSimulation {
    /// One robot a row. With a time step (s) they move by `frame_skip` of them at each advance; without, they settle.
    /// Observed places are relative to `origin` (m) and in units of `length` (m). All are in one scene, or each in its own; those that
    /// settle slide along obstacles without friction. With the least and largest `insertion` (m) their bases move along their axes by
    /// the last entry of a command; not in time.
    #[new]
    #[pyo3(signature = (robots, timestep, frame_skip, origin, length, scenes=None, insertion=None))]
    fn new(
        robots: Vec<PyRef<'_, Robot>>,
        timestep: Option<f64>,
        frame_skip: usize,
        origin: [f64; 3],
        length: f64,
        scenes: Option<Vec<PyRef<'_, Scene>>>,
        insertion: Option<[f64; 2]>,
    ) -> Outcome<Self> {
        let Some(first) = robots.first() else {
            return Err(Failure::input("no robots; expected at least one"));
        };
        if !(length.is_finite() && length > 0.0 && frame_skip > 0) {
            return Err(Failure::input(format!(
                "length {length}, frame_skip {frame_skip}; expected them above 0"
            )));
        }
        let scenes = scenes.unwrap_or_default();
        if ![0, 1, robots.len()].contains(&scenes.len()) {
            let (found, robots) = (scenes.len(), robots.len());
            let message =
                format!("{found} scenes of {robots} robots; expected none, one, or one of each");
            return Err(Failure::input(message));
        }
        if let Some(range @ [low, high]) = insertion
            && (timestep.is_some() || !(low <= 0.0 && 0.0 <= high))
        {
            let message = format!(
                "an insertion of {range:?} m with a time step of {timestep:?} s; expected 0 m in its range, and no time step"
            );
            return Err(Failure::input(message));
        }
        let steps = frame_skip;
        let mut batch = Self {
            rows: Vec::with_capacity(robots.len()),
            discs: first.0.discs().len(),
            tendons: first.0.tendons().len(),
            motion: timestep.map(|timestep| Motion { timestep, steps }),
            scale: Scale {
                origin: Vector3::from(origin),
                length,
            },
            carriage: insertion.map(|range| Insertion { range }),
        };
        let nothing = tdcr::sim::scene::Scene::default();
        for (k, robot) in robots.iter().enumerate() {
            batch.fits(robot)?;
            let scene = scenes.get(k).or(scenes.first());
            let scene = scene.map_or(&nothing, |scene| &scene.0);
            let row = Row::new(&robot.0, scene, batch.motion, batch.carriage)?;
            batch.rows.push(row);
        }
        Ok(batch)
    }

    /// Puts another robot into a row, which must then be reset.
    fn set_robot(&mut self, row: usize, robot: PyRef<'_, Robot>) -> Outcome<()> {
        self.fits(&robot)?;
        let motion = self.motion;
        let row = self.row(row)?;
        *row = row.anew(Some(&robot.0), None, motion)?;
        Ok(())
    }

    /// Puts other obstacles around a row, which must then be reset.
    fn set_scene(&mut self, row: usize, scene: PyRef<'_, Scene>) -> Outcome<()> {
        let motion = self.motion;
        let row = self.row(row)?;
        *row = row.anew(None, Some(&scene.0), motion)?;
        Ok(())
    }

    /// Starts some rows anew where they settle under a command and a payload (kg), from the straight pose and with nothing
    /// left of what was before. Returns which of them failed.
    ///
    /// Commands have shape (rows, tendons), or with bases that move (rows, tendons + 1).
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        rows: Vec<usize>,
        commands: PyReadonlyArray2<'_, f64>,
        payloads: PyReadonlyArray1<'_, f64>,
    ) -> Outcome<Bound<'py, PyArray1<bool>>> {
        let (count, width) = (rows.len(), self.commanded());
        let commands = contiguous(&commands, "commands", &[count, width])?;
        let payloads = contiguous(&payloads, "payloads", &[count])?;
        let mut chosen = vec![false; self.rows.len()];
        for (k, &row) in rows.iter().enumerate() {
            self.row(row)?.ask(&Asked {
                command: &commands[k * width..(k + 1) * width],
                payload: Some(payloads[k]),
                force: [0.0; 3],
            })?;
            chosen[row] = true;
        }
        let mut ended: Vec<Outcome<()>> = chosen.iter().map(|_| Ok(())).collect();
        let some = self.rows.iter_mut().zip(&mut ended).zip(&chosen);
        let some = some.filter_map(|(row, &chosen)| chosen.then_some(row));
        each(py, some.collect(), |(row, end): &mut (&mut Row, &mut _)| {
            **end = row.reset();
        })?;
        for (row, end) in ended.into_iter().enumerate() {
            end.map_err(|failure| match count {
                1 => failure,
                _ => failure.of_row(row),
            })?;
        }
        let failed = rows.iter().map(|&row| self.rows[row].failed).collect();
        Ok(PyArray1::from_vec(py, failed))
    }

    /// Advances all rows under commands and, where given, payloads (kg) and forces on the tips, world axes, shape (rows, 3) (N).
    /// Returns which of them have failed.
    #[pyo3(signature = (commands, payloads=None, forces=None))]
    fn advance<'py>(
        &mut self,
        py: Python<'py>,
        commands: PyReadonlyArray2<'_, f64>,
        payloads: Option<PyReadonlyArray1<'_, f64>>,
        forces: Option<PyReadonlyArray2<'_, f64>>,
    ) -> Outcome<Bound<'py, PyArray1<bool>>> {
        let (count, width) = (self.rows.len(), self.commanded());
        let commands = contiguous(&commands, "commands", &[count, width])?;
        let payloads = (payloads.as_ref())
            .map(|payloads| contiguous(payloads, "payloads", &[count]))
            .transpose()?;
        let forces = (forces.as_ref())
            .map(|forces| contiguous(forces, "forces", &[count, 3]))
            .transpose()?;
        for (k, row) in self.rows.iter_mut().enumerate() {
            row.ask(&Asked {
                command: &commands[k * width..(k + 1) * width],
                payload: payloads.map(|payloads| payloads[k]),
                force: forces.map_or([0.0; 3], |all| [0, 1, 2].map(|axis| all[3 * k + axis])),
            })?;
        }
        let all = self.rows.iter_mut().collect();
        each(py, all, |row: &mut &mut Row| row.advance())?;
        let failed = self.rows.iter().map(|row| row.failed).collect();
        Ok(PyArray1::from_vec(py, failed))
    }

    /// All that the rows' future depends on, and what is seen of them, shape (rows, numbers): for [`Self::restore`] of others
    /// with the same robots.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let states: Vec<Vec<f64>> = self.rows.iter().map(Row::state).collect();
        let shape = [states.len(), states[0].len()];
        array(py, states.concat(), shape)
    }

    /// Goes on from the state of others with the same robots, to the last bit.
    fn restore(&mut self, state: PyReadonlyArray2<'_, f64>) -> Outcome<()> {
        let width = self.rows[0].state().len();
        let numbers = contiguous(&state, "state", &[self.rows.len(), width])?;
        let mut rows = self.rows.iter_mut().zip(numbers.chunks_exact(width));
        rows.try_for_each(|(row, numbers)| row.restore(numbers))
    }

    /// Writes what is observed of each row to the first columns of `out`: the command of each tendon (-1 to 1), and of a base that
    /// moves, then of the `whole` robot places (n, 3), quaternions (n, 4) and, in motion, joint rates (n, 3) (rad/s); or of the tip its
    /// place, axis and, in motion, velocity; then the `tensions` (N), where asked for.
    #[pyo3(signature = (out, whole, tensions=false))]
    fn observe(
        &self,
        mut out: PyReadwriteArray2<'_, f32>,
        whole: bool,
        tensions: bool,
    ) -> Outcome<()> {
        let observed = Observed { whole, tensions };
        let &[rows, columns] = numpy::PyUntypedArrayMethods::shape(&**out) else {
            return Err(Failure::input("out has not two axes"));
        };
        let width = self.rows[0].width(observed);
        if rows != self.rows.len() || columns < width {
            return Err(Failure::input(format!(
                "out has shape {:?}, expected {} rows of at least {width}",
                [rows, columns],
                self.rows.len()
            )));
        }
        let out =
            (out.as_slice_mut()).map_err(|_| Failure::input("out is not contiguous in C order"))?;
        for (row, out) in self.rows.iter().zip(out.chunks_exact_mut(columns)) {
            row.observe(self.scale, observed, &mut out[..width]);
        }
        Ok(())
    }

    /// Origins of the discs, shape (rows, n, 3) (m).
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let values = self.gathered(3 * self.discs, |row, out| {
            write_points(&row.shown.positions, out);
        });
        array(py, values, [self.rows.len(), self.discs, 3])
    }

    /// Orientations (w, x, y, z) of the discs, shape (rows, n, 4).
    fn quaternions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let values = self.gathered(4 * self.discs, |row, out| {
            write_quaternions(&row.shown.orientations, out);
        });
        array(py, values, [self.rows.len(), self.discs, 4])
    }

    /// Rates of the joints in their discs' frames, shape (rows, n, 3) (rad/s).
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let values = self.gathered(3 * self.discs, |row, out| {
            out.copy_from_slice(&row.shown.rates);
        });
        array(py, values, [self.rows.len(), self.discs, 3])
    }

    /// Lengths of the tendons, shape (rows, tendons) (m).
    fn lengths<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let values = self.gathered(self.tendons, |row, out| {
            out.copy_from_slice(&row.shown.lengths);
        });
        array(py, values, [self.rows.len(), self.tendons])
    }

    /// What each row touches: number of contacts, the largest of their forces, the sum of these, shape (rows,) (N), and the force on
    /// each disc, shape (rows, n, 3) (N).
    fn touch<'py>(&self, py: Python<'py>) -> PyResult<Touched<'py>> {
        let touched = || self.rows.iter().map(|row| &row.shown.touch);
        let forces = self.gathered(3 * self.discs, |row, out| {
            write_points(&row.shown.touch.on_discs, out);
        });
        Ok((
            PyArray1::from_iter(py, touched().map(|touch| touch.count as i64)),
            PyArray1::from_iter(py, touched().map(|touch| touch.largest)),
            PyArray1::from_iter(py, touched().map(|touch| touch.sum)),
            array(py, forces, [self.rows.len(), self.discs, 3])?,
        ))
    }

    /// Objects of the rows' scenes, of which each has as many, shape (rows, objects, 16): position, quaternion (w, x, y, z), velocity,
    /// angular velocity, and the robot's force on it. Robots that do not move in time have none.
    fn objects<'py>(&self, py: Python<'py>) -> Outcome<Bound<'py, PyArray3<f64>>> {
        let width = self.rows[0].shown.objects.len();
        for (k, row) in self.rows.iter().enumerate() {
            let (first, found) = (width / WIDTH, row.shown.objects.len() / WIDTH);
            if found != first {
                let message = format!("row {k} has {found} objects; expected {first}, as row 0");
                return Err(Failure::input(message));
            }
        }
        let values = self.gathered(width, |row, out| out.copy_from_slice(&row.shown.objects));
        Ok(array(py, values, [self.rows.len(), width / WIDTH, WIDTH])?)
    }

    /// Tensions of the tendons, shape (rows, tendons) (N).
    fn tensions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let values = self.gathered(self.tendons, |row, out| {
            out.copy_from_slice(&row.shown.tensions);
        });
        array(py, values, [self.rows.len(), self.tendons])
    }

    /// What the robots' cameras see of some rows, as clouds of `points` points each, shape (rows, points, 3) (m).
    fn clouds<'py>(
        &self,
        py: Python<'py>,
        rows: Vec<usize>,
        points: usize,
    ) -> Outcome<Bound<'py, PyArray3<f32>>> {
        let count = rows.len();
        let Some(rows) = rows.iter().map(|&row| self.rows.get(row)).collect() else {
            let message = format!("rows {rows:?}; expected them below {}", self.rows.len());
            return Err(Failure::input(message));
        };
        if !(1..=1 << 20).contains(&points) {
            let message = format!("clouds of {points} points; expected 1 to {}", 1 << 20);
            return Err(Failure::input(message));
        }
        let rows: Vec<&Row> = rows;
        let mut clouds = vec![[0.0; 3]; count * points];
        let work = rows.into_iter().zip(clouds.chunks_exact_mut(points));
        each(
            py,
            work.collect(),
            |(row, out): &mut (&Row, &mut [[f32; 3]])| {
                sight::cloud(row, out);
            },
        )?;
        let shape = [count, points, 3];
        Ok(array(py, clouds.into_iter().flatten().collect(), shape)?)
    }

    /// The picture of one of a row's cameras: colours, shape (height, width, 3), and depth, shape (height, width) (m), 0
    /// where there is none. Red balls of `radius` (m) stand at `targets`, shape (targets, 3) (m).
    #[expect(clippy::too_many_arguments, reason = "named arguments in Python")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        row: usize,
        width: u32,
        height: u32,
        camera: usize,
        targets: PyReadonlyArray2<'_, f64>,
        radius: f64,
    ) -> Outcome<Picture<'py>> {
        let count = numpy::PyUntypedArrayMethods::shape(&*targets)[0];
        let targets = contiguous(&targets, "targets", &[count, 3])?.as_chunks::<3>();
        let row = self.shown_row(row)?;
        let seen = py.detach(|| sight::picture(row, [width, height], camera, targets.0, radius))?;
        let [width, height] = [width as usize, height as usize];
        let colors = seen.color.into_iter().flatten().collect();
        Ok((
            array(py, colors, [height, width, 3])?,
            array(py, seen.depth, [height, width])?,
        ))
    }
}
