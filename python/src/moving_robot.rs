//! One robot in motion, step by step.

use nalgebra::UnitQuaternion;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use tdcr::sim::simulation::Simulation;

use crate::arrays::{array, write_points, write_quaternions};
use crate::contact::{ContactRows, Touched, arrays};
use crate::dynamics::{command_of, state, state_as_it_was};
use crate::errors::Outcome;
use crate::loads::Loads;
use crate::objects;
use crate::robot::Robot;
use crate::scene::Scene;
use crate::steps::Steps;
use crate::tendon_friction::{Profile, profiles};

/// One robot in motion.
#[pyclass(module = "tdcr._tdcr")]
pub struct MovingRobot(tdcr::sim::simulation::MovingRobot);

#[pymethods]
impl MovingRobot {
    #[new]
    #[pyo3(signature = (robot, steps, scene=None))]
    fn new(
        robot: PyRef<'_, Robot>,
        steps: PyRef<'_, Steps>,
        scene: Option<PyRef<'_, Scene>>,
    ) -> Outcome<Self> {
        let scene = scene.map(|scene| scene.0.clone()).unwrap_or_default();
        Ok(Self(steps.moving(&robot.0, &scene)?))
    }

    /// What the robot touched in the last time step, as rows of one.
    fn contacts(&self, py: Python<'_>) -> PyResult<ContactRows> {
        let error = self.0.shape_error();
        let touched = Touched::in_motion(self.0.contacts(), self.0.scene(), error);
        arrays(py, &[touched])
    }

    /// The scene's objects, shape (objects, 16): the rows of `objects`.
    fn objects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let count = self.0.objects().len();
        let mut numbers = vec![0.0; objects::WIDTH * count];
        objects::write(&self.0, &mut numbers);
        array(py, numbers, [count, objects::WIDTH])
    }

    /// Places the objects in states, shape (objects, 13).
    fn place_objects(&mut self, states: PyReadonlyArray2<'_, f64>) -> Outcome<()> {
        let states = objects::states(&states, self.0.objects().len())?;
        Ok(self.0.place_objects(&states)?)
    }

    /// Refuses obstacles and objects that have a part of the robot inside.
    fn check_outside(&self) -> Outcome<()> {
        Ok(self.0.check_outside()?)
    }

    /// Starts anew at rest in the equilibrium of a command.
    fn reset(
        &mut self,
        py: Python<'_>,
        command: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
    ) -> Outcome<()> {
        let command = command_of(self.0.robot(), &command)?;
        let (moving, loads) = (&mut self.0, &loads.0);
        Ok(py.detach(|| moving.reset(&command, loads))?)
    }

    /// Starts anew in a state, the tendons under `command`.
    fn start_at(
        &mut self,
        configuration: PyReadonlyArray2<'_, f64>,
        velocity: PyReadonlyArray2<'_, f64>,
        command: PyReadonlyArray1<'_, f64>,
    ) -> Outcome<()> {
        let state = state(self.0.robot(), &configuration, &velocity)?;
        let command = command_of(self.0.robot(), &command)?;
        Ok(self.0.start_at(&state, &command)?)
    }

    /// Goes on under a command by `skip` time steps.
    fn step(
        &mut self,
        py: Python<'_>,
        command: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
        skip: usize,
    ) -> Outcome<()> {
        let command = command_of(self.0.robot(), &command)?;
        let (moving, loads) = (&mut self.0, &loads.0);
        Ok(py.detach(|| moving.advance_by(&command, loads, skip))?)
    }

    /// Goes on with a motion that was left in a state under `command`, where the clock was at `clock`.
    fn resume_at(
        &mut self,
        configuration: PyReadonlyArray2<'_, f64>,
        velocity: PyReadonlyArray2<'_, f64>,
        command: PyReadonlyArray1<'_, f64>,
        clock: Option<u64>,
    ) -> Outcome<()> {
        let state = state_as_it_was(self.0.robot(), &configuration, &velocity)?;
        let command = command_of(self.0.robot(), &command)?;
        Ok(self.0.resume_at(&state, &command, clock)?)
    }

    /// Each tendon along its route with the contacts in its holes; none without friction.
    fn tendon_profiles<'py>(&self, py: Python<'py>) -> Vec<Profile<'py>> {
        profiles(py, self.0.tendon_profiles())
    }

    /// Loads the contacts in the holes with deflections (m), a list for each tendon.
    fn set_deflections(&mut self, deflections: Vec<Vec<f64>>) -> Outcome<()> {
        Ok(self.0.set_deflections(&deflections)?)
    }

    /// Energy turned into heat in the holes since the start (J).
    #[getter]
    fn dissipated(&self) -> f64 {
        self.0.dissipated()
    }

    /// Time steps since the start; none before the first.
    #[getter]
    fn clock(&self) -> Option<u64> {
        self.0.taken()
    }

    /// Time since the start (s).
    #[getter]
    fn time(&self) -> f64 {
        self.0.time()
    }

    /// Origins of the discs, shape (discs, 3) (m).
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = self.0.pose().positions;
        let mut numbers = vec![0.0; 3 * points.len()];
        write_points(points, &mut numbers);
        array(py, numbers, [points.len(), 3])
    }

    /// Orientations of the discs, shape (discs, 4).
    #[getter]
    fn quaternions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        turns(py, self.0.pose().orientations)
    }

    /// Rotations of the joints, shape (discs, 4).
    #[getter]
    fn configuration<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        turns(py, &self.0.state().configuration.0)
    }

    /// Rates of the joints, shape (discs, 3) (rad/s).
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let velocity = self.0.state().velocity.clone();
        let discs = velocity.len() / 3;
        array(py, velocity, [discs, 3])
    }

    /// Lengths of the tendons, shape (tendons,) (m).
    #[getter]
    fn lengths<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.pose().tendon_lengths)
    }

    /// Tensions of the tendons, shape (tendons,) (N).
    #[getter]
    fn tensions<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.pose().tendon_tensions)
    }

    /// What acts on the tendons, shape (tendons,) (m or N).
    #[getter]
    fn acting<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.acting().as_slice())
    }
}

fn turns<'py>(
    py: Python<'py>,
    quaternions: &[UnitQuaternion<f64>],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let mut numbers = vec![0.0; 4 * quaternions.len()];
    write_quaternions(quaternions, &mut numbers);
    array(py, numbers, [quaternions.len(), 4])
}
