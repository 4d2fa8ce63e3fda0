//! A robot in the browser.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use tdcr::hw::rig::RigFile;
use tdcr::sim::chain::Configuration;
use tdcr::sim::robot::{Loads as AllLoads, RobotSpec};
use tdcr::view::{Exhibit, Given, Marks, OverlayFiles, Overlays, Subject, View, ViewError};

use crate::arrays::{contiguous, quaternions};
use crate::env::{BatchSimulation, Row};
use crate::errors::{Failure, Outcome};
use crate::loads::Loads;
use crate::robot::Robot;
use crate::scene::Scene;

/// A page that is served until it is closed.
#[pyclass(frozen, module = "tdcr._tdcr")]
pub struct Viewer {
    address: String,
    log: Option<PathBuf>,
    robot: tdcr::sim::robot::Robot,
    view: Mutex<Option<View>>,
    /// The robot of a batch that was shown last.
    subject: Mutex<Option<Arc<Subject>>>,
}

/// What is shown besides the robot: folders and files.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Shown {
    data: Option<PathBuf>,
    model: Option<PathBuf>,
    log: Option<PathBuf>,
    study: Option<PathBuf>,
    rig: Option<PathBuf>,
    out: Option<PathBuf>,
}

#[pymethods]
impl Viewer {
    /// Serves a robot (that of the rig, the model, the data set or the study where none is given, else `fallback`) with the command
    /// it begins with (the middle of the tendons' ranges for none), and commands to play, at a port, 0 for any.
    #[staticmethod]
    #[allow(clippy::too_many_arguments, reason = "keywords of one Python function")]
    fn open(
        py: Python<'_>,
        robot: Option<PyRef<'_, Robot>>,
        fallback: PyRef<'_, Robot>,
        scene: Option<PyRef<'_, Scene>>,
        command: Option<PyReadonlyArray1<'_, f64>>,
        commands: Option<PyReadonlyArray2<'_, f64>>,
        loads: PyRef<'_, Loads>,
        shown: Shown,
        port: u16,
    ) -> Outcome<Self> {
        let overlays = py.detach(|| open_overlays(&shown))?;
        let rig = shown.rig.as_deref().map(RigFile::load).transpose()?;
        let spec: RobotSpec = match (&rig, &robot, overlays.robot()) {
            (Some(rig), ..) => rig.robot.clone(),
            (None, Some(robot), _) => robot.0.spec().clone(),
            (None, None, Some(robot)) => robot.clone(),
            (None, None, None) => fallback.0.spec().clone(),
        };
        let robot = tdcr::sim::robot::Robot::new(spec)?;
        let tendons = robot.tendons().len();
        let command = command.map(|command| {
            let values = contiguous(&command, "command", &[tendons])?;
            robot.command(values)?;
            Outcome::Ok(values.to_vec())
        });
        let recorded = commands.map(|commands| {
            let rows = commands.as_array().nrows();
            let values = contiguous(&commands, "commands", &[rows, tendons])?;
            let rows = values.chunks_exact(tendons.max(1));
            rows.map(|row| Ok(robot.command(row)?.as_slice().to_vec()))
                .collect::<Outcome<Vec<_>>>()
        });
        loads.0.check(&robot)?;
        let around = scene.map(|scene| scene.0.clone());
        let around = around.or_else(|| rig.as_ref()?.scene.clone());
        let exhibit = Exhibit {
            scene: around.unwrap_or_default(),
            loads: loads.0.clone(),
            start: command.transpose()?,
            recorded: recorded.transpose()?.unwrap_or_default(),
            overlays,
            rig,
            out: shown.out,
            ..Exhibit::of(robot.spec().clone())
        };
        let view = py.detach(|| View::open(exhibit, port));
        let view = view.map_err(|error| {
            let class = match error {
                ViewError::Rig(_) => "RigError",
                _ => "TdcrError",
            };
            Failure::Of(class, error.to_string())
        })?;
        Ok(Self {
            log: view.log().map(Path::to_owned),
            address: view.address().to_owned(),
            robot,
            view: Mutex::new(Some(view)),
            subject: Mutex::default(),
        })
    }

    /// The address, with the token in it.
    #[getter]
    fn address(&self) -> &str {
        &self.address
    }

    /// The robot.
    #[getter]
    fn robot(&self) -> Robot {
        Robot(self.robot.clone())
    }

    /// Shows the robot under a command, followed from where it is, or in a pose (rotations of the joints, shape (discs, 4)).
    fn show(
        &self,
        command: PyReadonlyArray1<'_, f64>,
        configuration: Option<PyReadonlyArray2<'_, f64>>,
    ) -> Outcome<()> {
        let tendons = self.robot.tendons().len();
        let values = contiguous(&command, "command", &[tendons])?;
        let command = self.robot.command(values)?;
        let given = match configuration {
            None => Given::Command(command),
            Some(rotations) => {
                let discs = self.robot.discs().len();
                let flat = contiguous(&rotations, "configuration", &[discs, 4])?;
                if let Some(found) = flat.iter().find(|x| !x.is_finite()) {
                    let message = format!("configuration has {found}; expected finite numbers");
                    return Err(Failure::input(message));
                }
                Given::Pose {
                    configuration: Configuration(quaternions(flat)),
                    command,
                    subject: None,
                    marks: Marks::default(),
                }
            }
        };
        self.give(given)
    }

    /// Shows a row of a batch as it is: its robot, its scene, and balls of `radius` (m) at `targets`, shape (targets, 3) (m).
    fn show_row(
        &self,
        batch: PyRef<'_, BatchSimulation>,
        row: usize,
        targets: PyReadonlyArray2<'_, f64>,
        radius: f64,
    ) -> Outcome<()> {
        let count = numpy::PyUntypedArrayMethods::shape(&*targets)[0];
        let targets = contiguous(&targets, "targets", &[count, 3])?.as_chunks::<3>();
        let row = batch.shown_row(row)?;
        self.give(Given::Pose {
            configuration: row.shown.configuration.clone(),
            command: row.command.clone(),
            subject: Some(self.subject_of(row)?),
            marks: Marks {
                places: targets
                    .0
                    .iter()
                    .map(|place| place.map(|x| x as f32))
                    .collect(),
                radius,
            },
        })
    }

    /// The log of the rig, where one is written.
    #[getter]
    fn log(&self) -> Option<PathBuf> {
        self.log.clone()
    }

    /// Ends it; waits until the tension of a rig is released.
    fn close(&self, py: Python<'_>) {
        py.detach(|| drop(self.view.lock().ok().and_then(|mut view| view.take())));
    }
}

impl Viewer {
    /// Shows something on all pages.
    fn give(&self, given: Given) -> Outcome<()> {
        let view = self.view.lock();
        let view = view.as_ref().ok().and_then(|view| view.as_ref());
        match view {
            Some(view) => {
                view.show(given);
                Ok(())
            }
            None => Err(Failure::input("the page is closed; expected an open one")),
        }
    }

    /// The robot of a row and what is around it: the same allocation as before where both are the same.
    fn subject_of(&self, row: &Row) -> Outcome<Arc<Subject>> {
        let mut last = self.subject.lock().unwrap_or_else(PoisonError::into_inner);
        let payload = row.loads.tip_payload();
        let is_same = |known: &Arc<Subject>| {
            known.robot == *row.robot.spec()
                && std::ptr::eq(known.scene.obstacles(), row.scene.obstacles())
                && known.loads.tip_payload() == payload
        };
        if let Some(known) = last.as_ref().filter(|known| is_same(known)) {
            return Ok(known.clone());
        }
        let subject = Arc::new(Subject {
            robot: row.robot.spec().clone(),
            scene: row.scene.clone(),
            loads: AllLoads::default().with_payload(payload)?,
        });
        *last = Some(subject.clone());
        Ok(subject)
    }
}

fn open_overlays(shown: &Shown) -> Outcome<Overlays> {
    let files = OverlayFiles {
        data: shown.data.as_deref(),
        model: shown.model.as_deref(),
        log: shown.log.as_deref(),
        study: shown.study.as_deref(),
    };
    Overlays::open(files).map_err(|error| Failure::Of("DataError", error.to_string()))
}
