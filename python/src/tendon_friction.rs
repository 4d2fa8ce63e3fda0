//! Paths of equilibria with friction between tendons and holes.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use tdcr::sim::geometry::Beads;
use tdcr::sim::tendon_friction::{ContactPath, FrictionState, SlipState, TendonProfile};

use crate::arrays::contiguous;
use crate::contact::{ContactRows, Touched, arrays as contact_rows};
use crate::errors::{Failure, Outcome};
use crate::loads::Loads;
use crate::robot::Robot;
use crate::scene::Scene;
use crate::statics::{EquilibriumRows, Numbers};

/// A tendon from the servo to its fastened end: lengths (m), tensions (N), wrap angles (rad), deflections (m), slip states.
pub type Profile<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Vec<&'static str>,
);

/// Energies (J) dissipated, stored, snapped, and of the servos' work; numbers of snaps and substeps.
type Account = (f64, f64, f64, f64, usize, usize);

/// A state of a path, and what the robot touches there.
type Stand<'py> = (
    EquilibriumRows,
    Vec<Profile<'py>>,
    Account,
    Option<ContactRows>,
);

/// A robot led along commands, with friction in its tendons' holes.
#[pyclass(module = "tdcr._tdcr")]
pub struct FrictionPath {
    path: ContactPath,
    /// Of the beads that stand for the discs (m).
    shape_error: f64,
    /// Whether there is a scene, and so contacts with it to report.
    has_scene: bool,
}

#[pymethods]
impl FrictionPath {
    #[new]
    #[pyo3(signature = (robot, resolution, scene=None))]
    fn new(
        robot: PyRef<'_, Robot>,
        resolution: f64,
        scene: Option<PyRef<'_, Scene>>,
    ) -> Outcome<Self> {
        if !(resolution.is_finite() && resolution > 0.0) {
            let message =
                format!("the resolution is {resolution} rad; expected a finite number above 0");
            return Err(Failure::input(message));
        }
        let around = scene
            .as_ref()
            .map(|scene| scene.0.clone())
            .unwrap_or_default();
        Ok(Self {
            shape_error: Beads::new(&robot.0).shape_error(),
            path: ContactPath::new(&robot.0, &around).with_resolution(resolution),
            has_scene: scene.is_some(),
        })
    }

    /// Starts anew from the equilibrium without friction.
    fn start<'py>(
        &mut self,
        py: Python<'py>,
        command: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
    ) -> Outcome<Stand<'py>> {
        let command = self.command(&command, &loads)?;
        let (path, loads) = (&mut self.path, &loads.0);
        py.detach(|| path.start(&command, loads).map(|_| ()))?;
        self.stand(py)
    }

    /// Goes on along the straight line to a command.
    fn advance<'py>(
        &mut self,
        py: Python<'py>,
        command: PyReadonlyArray1<'_, f64>,
        loads: PyRef<'_, Loads>,
    ) -> Outcome<Stand<'py>> {
        let command = self.command(&command, &loads)?;
        let (path, loads) = (&mut self.path, &loads.0);
        py.detach(|| path.advance(&command, loads).map(|_| ()))?;
        self.stand(py)
    }
}

impl FrictionPath {
    fn command(
        &self,
        command: &PyReadonlyArray1<'_, f64>,
        loads: &Loads,
    ) -> Outcome<tdcr::sim::robot::Command> {
        let robot = self.path.robot();
        loads.0.check(robot)?;
        Ok(robot.command(contiguous(command, "command", &[robot.tendons().len()])?)?)
    }

    fn stand<'py>(&self, py: Python<'py>) -> Outcome<Stand<'py>> {
        let path = &self.path;
        let (equilibrium, profiles, account) = state(py, path.state())?;
        let touched = self
            .has_scene
            .then(|| Touched::in_motion(path.contacts(), path.scene(), self.shape_error));
        let contacts = touched.map(|own| contact_rows(py, &[own])).transpose()?;
        Ok((equilibrium, profiles, account, contacts))
    }
}

fn state<'py>(
    py: Python<'py>,
    state: &FrictionState,
) -> Outcome<(EquilibriumRows, Vec<Profile<'py>>, Account)> {
    let equilibrium = &state.equilibrium;
    let tendons = equilibrium.tendon_tensions.len();
    let mut numbers = Numbers::new(1, equilibrium.positions.len(), tendons);
    numbers.rows()[0].write(equilibrium);
    let account = (
        state.dissipated,
        state.stored,
        state.snapped,
        state.servo_work,
        state.snaps,
        state.substeps,
    );
    let tendons = profiles(py, &state.tendons);
    Ok((numbers.into_arrays(py)?, tendons, account))
}

/// Each tendon along its route.
pub fn profiles<'py>(py: Python<'py>, tendons: &[TendonProfile]) -> Vec<Profile<'py>> {
    let vector = |values: &[f64]| PyArray1::from_slice(py, values);
    let profiles = tendons.iter().map(|tendon| {
        let slip = tendon.slip_states.iter().map(|slip| match slip {
            SlipState::Sticks => "sticks",
            SlipState::SlipsToServo => "to servo",
            SlipState::SlipsToEnd => "to end",
        });
        (
            vector(&tendon.lengths),
            vector(&tendon.tensions),
            vector(&tendon.wrap_angles),
            vector(&tendon.deflections),
            slip.collect(),
        )
    });
    profiles.collect()
}
