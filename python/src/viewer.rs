//! A robot in the browser.

use std::sync::Mutex;

use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use tdcr::view::{Exhibit, View};

use crate::arrays::contiguous;
use crate::errors::{Failure, Outcome};
use crate::loads::Loads;
use crate::robot::Robot;
use crate::scene::Scene;

/// A page that is served until it is closed.
#[pyclass(frozen, module = "tdcr._tdcr")]
pub struct Viewer {
    address: String,
    view: Mutex<Option<View>>,
}

#[pymethods]
impl Viewer {
    /// Serves a robot with the command it begins with (the middle of the tendons' ranges for none) at a port, 0 for any.
    #[staticmethod]
    fn open(
        robot: PyRef<'_, Robot>,
        scene: Option<PyRef<'_, Scene>>,
        command: Option<PyReadonlyArray1<'_, f64>>,
        loads: PyRef<'_, Loads>,
        port: u16,
    ) -> Outcome<Self> {
        let tendons = robot.0.tendons().len();
        let command = command.map(|command| {
            let values = contiguous(&command, "command", &[tendons])?;
            robot.0.command(values)?;
            Outcome::Ok(values.to_vec())
        });
        loads.0.check(&robot.0)?;
        let exhibit = Exhibit {
            scene: scene.map(|scene| scene.0.clone()).unwrap_or_default(),
            loads: loads.0.clone(),
            start: command.transpose()?,
            ..Exhibit::of(robot.0.spec().clone())
        };
        let view = View::open(exhibit, port);
        let view = view.map_err(|error| Failure::Of("TdcrError", error.to_string()))?;
        Ok(Self {
            address: view.address().to_owned(),
            view: Mutex::new(Some(view)),
        })
    }

    /// The address, with the token in it.
    #[getter]
    fn address(&self) -> &str {
        &self.address
    }

    /// Ends it.
    fn close(&self, py: Python<'_>) {
        py.detach(|| drop(self.view.lock().ok().and_then(|mut view| view.take())));
    }
}
