//! A rig: servos and cameras, in memory or on a desk.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard};

use nalgebra::Vector3;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use tdcr::hw::capture::{CaptureError, Fuser, Program};
use tdcr::hw::rig::{
    Homing, Pace, Pictures, RigError, RigFile, WinchState, while_released as while_all_released,
};
use tdcr::pipeline::{self, CaptureSettings, seen_tip};
use tdcr::sim::cloud::{PointCloud, VoxelGrid};
use tdcr::sim::robot::Command;
use tdcr::track::TipSteer;

use crate::dynamics::command_of;
use crate::errors::{Failure, Outcome};
use crate::hint;
use crate::options::options_of;
use crate::robot::Robot;
use crate::run::{self, Watch};
use crate::stage::Stage;
use crate::vision::{Cloud, View, cloud_arrays, view};

/// Servos and cameras behind one file.
#[pyclass(frozen, module = "tdcr._tdcr")]
pub struct Rig(Shared);

/// A rig that Python may hand to several threads: they take turns.
struct Shared {
    rig: Mutex<tdcr::hw::rig::Rig>,
    /// Whether a capture waits for a payload: a call meanwhile, by the one who hangs it, would wait for itself.
    hanging: AtomicBool,
}

/// What a servo does: its address, position from home (ticks), the command that this stands for (m), velocity (rad/s), and
/// current (A), positive where it pulls; or why it did not say, in place of these.
type Reading = (u8, Option<(i32, f64, f64, f64)>, Option<String>);

/// Pictures with their times (s, by the rig's clock), and the largest difference between these (s).
type Seen = (Vec<(f64, View)>, f64);

#[pymethods]
impl Rig {
    /// Opens the rig of a file; with notes on what was passed over in its robot's, where that is of another tool.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf, real_time: bool) -> Outcome<(Self, Vec<String>)> {
        let pace = match real_time {
            true => Pace::RealTime,
            false => Pace::Computed,
        };
        run::short(py, || {
            let file = RigFile::load(&path)?;
            let notes = notes_of(&file);
            let rig = tdcr::hw::rig::Rig::open_file(file, pace)?;
            let shared = Shared {
                rig: Mutex::new(rig),
                hanging: AtomicBool::new(false),
            };
            Ok((Self(shared), notes))
        })?
    }

    /// Name in the rig's file.
    #[getter]
    fn name(&self, py: Python<'_>) -> Outcome<String> {
        self.short(py, |rig| rig.spec().name.clone())
    }

    /// The robot.
    #[getter]
    fn robot(&self, py: Python<'_>) -> Outcome<Robot> {
        self.short(py, |rig| Robot(rig.robot().clone()))
    }

    /// Addresses of the servos, in the order of a command: wider than they are, as bytes become `bytes` in Python.
    #[getter]
    fn ids(&self, py: Python<'_>) -> Outcome<Vec<u16>> {
        self.short(py, |rig| {
            let winches = rig.winches().iter();
            winches.map(|winch| winch.id.get().into()).collect()
        })
    }

    /// Serial numbers of the cameras.
    #[getter]
    fn cameras(&self, py: Python<'_>) -> Outcome<Vec<String>> {
        self.short(py, |rig| {
            let cameras = rig.cameras().iter();
            cameras.map(|camera| camera.serial().to_owned()).collect()
        })
    }

    /// Time of the rig's clock (s).
    #[getter]
    fn time(&self, py: Python<'_>) -> Outcome<f64> {
        self.short(py, |rig| rig.clock().now().as_secs_f64())
    }

    /// Whether the motors are driven.
    #[getter]
    fn engaged(&self, py: Python<'_>) -> Outcome<bool> {
        self.short(py, |rig| rig.is_engaged())
    }

    /// Asks the servos what is known of their homes: "homed", "lost" or "never", one each.
    fn meet(&self, py: Python<'_>) -> Outcome<Vec<&'static str>> {
        let name = |homing: &Homing| match homing {
            Homing::Homed(_) => "homed",
            Homing::Lost { .. } => "lost",
            Homing::Never => "never",
        };
        self.short(py, |rig| Ok(rig.meet()?.iter().map(name).collect()))?
    }

    /// Takes the present pose for home, or finds home again from where the servos were left.
    fn home(&self, py: Python<'_>, recall: bool) -> Outcome<()> {
        self.short(py, |rig| {
            match recall {
                true => rig.home_recalled()?,
                false => rig.home_here()?,
            };
            Ok(())
        })?
    }

    /// Switches the motors on where they stand.
    fn engage(&self, py: Python<'_>) -> Outcome<()> {
        self.short(py, |rig| Ok(rig.engage()?))?
    }

    /// Takes the tension from the tendons and switches the motors off.
    fn release(&self, py: Python<'_>) -> Outcome<()> {
        self.short(py, |rig| Ok(rig.release()?))?
    }

    /// Positions of the servos, from home (ticks), that stand for a command (m).
    fn goals<'py>(
        &self,
        py: Python<'py>,
        command: PyReadonlyArray1<'_, f64>,
    ) -> Outcome<Bound<'py, PyArray1<i32>>> {
        let command = self.command(py, &command)?;
        let goals = self.short(py, |rig| rig.goals(&command))??;
        let goals: Vec<i32> = goals.iter().map(|goal| goal.0).collect();
        Ok(PyArray1::from_vec(py, goals))
    }

    /// Where the servos are told to be (m); `None` where the motors are off.
    #[getter]
    fn commanded<'py>(&self, py: Python<'py>) -> Outcome<Option<Bound<'py, PyArray1<f64>>>> {
        let commanded = self.short(py, |rig| rig.commanded())?;
        Ok(commanded.map(|command| PyArray1::from_vec(py, command)))
    }

    /// What the servos do.
    fn state(&self, py: Python<'_>) -> Outcome<Vec<Reading>> {
        self.short(py, |rig| {
            let ids: Vec<u8> = rig.winches().iter().map(|winch| winch.id.get()).collect();
            let states = ids.iter().zip(rig.state());
            let reading = |(&id, state): (&u8, Result<Option<WinchState>, _>)| match state {
                Ok(Some(state)) => reading(id, &state),
                Ok(None) => (id, None, Some(format!("servo {id} is not homed"))),
                Err(error) => (id, None, Some(format!("{error}"))),
            };
            states.map(reading).collect()
        })
    }

    /// Sends the goals of a command at once, and looks at the servos when the next are due.
    fn step(&self, py: Python<'_>, command: PyReadonlyArray1<'_, f64>) -> Outcome<Vec<Reading>> {
        let command = self.command(py, &command)?;
        self.short(py, |rig| {
            let ids: Vec<u8> = rig.winches().iter().map(|winch| winch.id.get()).collect();
            let states = ids.iter().zip(rig.step(&command)?);
            Ok(states.map(|(&id, state)| reading(id, state)).collect())
        })?
    }

    /// Moves to a command at the rig's slew.
    fn move_to(&self, py: Python<'_>, command: PyReadonlyArray1<'_, f64>) -> Outcome<()> {
        let command = self.command(py, &command)?;
        let rig = &self.0;
        run::long(py, None, |watch| {
            locked(rig)?.move_to(&command, &mut || go_on(watch))?;
            Ok(())
        })?
    }

    /// Moves home.
    fn go_home(&self, py: Python<'_>) -> Outcome<()> {
        self.short(py, |rig| Ok(rig.go_home()?))?
    }

    /// Pictures of all cameras from one moment, as they are.
    fn grab(&self, py: Python<'_>) -> Outcome<Seen> {
        let pictures = self.short(py, |rig| rig.grab())??;
        seen(py, pictures)
    }

    /// What the cameras see of the robot, fused and thinned.
    fn cloud<'py>(&self, py: Python<'py>, voxel: f64) -> Outcome<Cloud<'py>> {
        let grid = grid(voxel)?;
        let (_, cloud) = self.short(py, |rig| look(rig, grid))??;
        cloud_arrays(py, cloud)
    }

    /// Where the cameras see the tip and its axis, and what they see.
    #[allow(clippy::type_complexity, reason = "Python's caller names them")]
    fn measure<'py>(
        &self,
        py: Python<'py>,
        voxel: f64,
    ) -> Outcome<([f64; 3], [f64; 3], Cloud<'py>, Seen)> {
        let grid = grid(voxel)?;
        let rig = &self.0;
        let (pictures, cloud, pose) = run::short(py, || -> Outcome<_> {
            let mut rig = locked(rig)?;
            let command = measured_command(&mut rig)?;
            let (pictures, cloud) = look(&mut rig, grid)?;
            let robot = rig.robot().clone();
            let pose = rig
                .hold_while(|| seen_tip(&robot, &command, &cloud))?
                .map_err(|error| Failure::Of("RigError", error.to_string()))?;
            let unseen = "the cameras do not see enough of the robot to tell where its tip is";
            let pose = pose.ok_or_else(|| Failure::Of("RigError", unseen.to_owned()))?;
            Ok((pictures, cloud, pose))
        })??;
        let axis = pose.rotation * Vector3::z();
        Ok((
            pose.translation.vector.into(),
            axis.into(),
            cloud_arrays(py, cloud)?,
            seen(py, pictures)?,
        ))
    }

    /// Smallest and largest tension (N) that the simulator may find in a tendon.
    #[getter]
    fn tension(&self, py: Python<'_>) -> Outcome<(f64, f64)> {
        let [low, high] = self.short(py, |rig| rig.spec().commands.tension)?;
        Ok((low, high))
    }

    /// Largest speed of a tendon (m/s), and how often goals are sent (s).
    #[getter]
    fn motion(&self, py: Python<'_>) -> Outcome<(f64, f64)> {
        self.short(py, |rig| {
            let motion = &rig.spec().motion;
            (motion.slew, motion.period)
        })
    }

    /// A command by chance that can be reached from home.
    fn draw<'py>(&self, py: Python<'py>, seed: u64) -> Outcome<Bound<'py, PyArray1<f64>>> {
        let drawn = self.short(py, |rig| {
            let file = rig.file().clone();
            let draw = || {
                let drawn = Program::new(&file, seed)?.draw(0);
                drawn.map_err(CaptureError::from)
            };
            rig.hold_while(draw)?
        })?;
        let drawn = drawn.map_err(|error| Failure::Of("RigError", error.to_string()))?;
        Ok(PyArray1::from_slice(py, drawn.command.as_slice()))
    }

    /// The command, near the present one, under which the model has its tip by so much (m, world frame) from where it is.
    fn steer<'py>(&self, py: Python<'py>, by: [f64; 3]) -> Outcome<Bound<'py, PyArray1<f64>>> {
        let found = self.short(py, |rig| -> Outcome<_> {
            let command = rig.commanded().ok_or(RigError::Released)?;
            let mut steer = TipSteer::new(rig).map_err(of_rig)?;
            let found = rig.hold_while(|| steer.moved(&command, by.into()))?;
            found.map_err(of_rig)
        })??;
        Ok(PyArray1::from_vec(py, found))
    }

    /// Makes a data set, or goes on with it.
    #[pyo3(signature = (out, options, hang = None, progress = None))]
    fn capture(
        &self,
        py: Python<'_>,
        out: PathBuf,
        options: &str,
        hang: Option<Py<PyAny>>,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> Outcome<String> {
        let settings: CaptureSettings = options_of(options)?;
        let rig = &self.0;
        let report = run::long(py, progress, |watch| -> Outcome<_> {
            let mut held = locked(rig)?;
            let hang = hang.as_ref().map(|call| (call, &rig.hanging));
            let monitor = Stage::new(&["capture"], watch).with_hang(hang);
            let captured = pipeline::capture(&mut held, &settings, &out, &monitor);
            match monitor.raised() {
                Some(raised) => Err(raised.into()),
                None => Ok(captured?),
            }
        })??;
        serde_json::to_string(&report).map_err(|error| Failure::Of("DataError", error.to_string()))
    }
}

/// Calls `work` where no rig of this process has a motor on, and lets none switch one on meanwhile; returns whether it did.
#[pyfunction]
pub fn while_released(work: &Bound<'_, PyAny>) -> PyResult<bool> {
    let mut called = Ok(());
    let released = while_all_released(|| called = work.call0().map(drop));
    called.map(|()| released)
}

/// Records the empty scene of the rig of a file; returns notes on what was passed over in its robot's.
#[pyfunction]
#[pyo3(signature = (path, out, pictures, progress = None))]
pub fn record_background(
    py: Python<'_>,
    path: PathBuf,
    out: PathBuf,
    pictures: usize,
    progress: Option<&Bound<'_, PyAny>>,
) -> Outcome<Vec<String>> {
    run::long(py, progress, |watch| -> Outcome<_> {
        let mut begun = 0;
        let mut next = || {
            watch.advance(usize::from(begun > 0));
            begun += 1;
            go_on(watch)
        };
        let file = RigFile::load(&path)?;
        file.record_background(&out, pictures, &mut next)?;
        watch.advance(1);
        Ok(notes_of(&file))
    })?
}

/// What a rig's model has to say of a tip, as an error of the rig.
fn of_rig(error: impl std::error::Error) -> Failure {
    Failure::Of("RigError", error.to_string())
}

fn notes_of(file: &RigFile) -> Vec<String> {
    file.notes.iter().map(ToString::to_string).collect()
}

impl Rig {
    /// Work with the rig, without the interpreter's lock.
    fn short<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut tdcr::hw::rig::Rig) -> T + Send,
    ) -> Outcome<T> {
        let rig = &self.0;
        run::short(py, || Ok(work(&mut *locked(rig)?)))?
    }

    fn command(&self, py: Python<'_>, command: &PyReadonlyArray1<'_, f64>) -> Outcome<Command> {
        let robot = self.short(py, |rig| rig.robot().clone())?;
        command_of(&robot, command)
    }
}

impl Rig {
    /// Long work with the rig, without the interpreter's lock; it is told where a signal ends it.
    pub(crate) fn long<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut tdcr::hw::rig::Rig, &Watch) -> T + Send,
    ) -> Outcome<T> {
        let rig = &self.0;
        run::long(py, None, |watch| Ok(work(&mut *locked(rig)?, watch)))?
    }
}

fn locked(shared: &Shared) -> Outcome<MutexGuard<'_, tdcr::hw::rig::Rig>> {
    let refused = |why: &str| Failure::Of("RigError", why.to_owned());
    if shared.hanging.load(Ordering::Acquire) {
        return Err(refused(
            "a capture of this rig waits for hang to return; expected no other call of it until then",
        ));
    }
    let broken = "a call of this rig panicked; expected one that did not: open the rig again";
    shared.rig.lock().map_err(|_| refused(broken))
}

fn grid(voxel: f64) -> Outcome<VoxelGrid> {
    if VoxelGrid::is_size(voxel) {
        return Ok(VoxelGrid::new(voxel));
    }
    let expected = VoxelGrid::EXPECTED_SIZE;
    let message = format!("the voxels' edge is {voxel} m; expected {expected}");
    Err(Failure::input(message))
}

/// Pictures of what is the robot, and their cloud.
fn look(rig: &mut tdcr::hw::rig::Rig, grid: VoxelGrid) -> Outcome<(Pictures, PointCloud)> {
    let pictures = rig.grab()?;
    let masker = rig.masker()?;
    let fuser = Fuser { grid, masker };
    // Masks by sample number are of captures.
    rig.hold_while(|| {
        let kept = fuser
            .keep_robot(&pictures, 0)
            .map_err(|error| Failure::Of("RigError", error.to_string()))?;
        let cloud = fuser.fuse(&kept);
        Ok((kept, cloud))
    })?
}

/// The command that the servos' positions stand for, within the tendons' ranges: servos are a tick off their goals.
fn measured_command(rig: &mut tdcr::hw::rig::Rig) -> Outcome<Command> {
    let states = rig.state().into_iter();
    let commands = states.map(|state| {
        let state = state.map_err(RigError::from)?;
        let unhomed = || Failure::Of("RigError", "the servos are not homed".to_owned());
        Ok(state.ok_or_else(unhomed)?.command)
    });
    let commands: Vec<f64> = commands.collect::<Outcome<_>>()?;
    let tendons = commands.iter().zip(rig.robot().tendons());
    let commands: Vec<f64> = tendons
        .map(|(command, tendon)| command.clamp(tendon.range[0], tendon.range[1]))
        .collect();
    Ok(rig.robot().command(&commands)?)
}

fn seen(py: Python<'_>, pictures: Pictures) -> Outcome<Seen> {
    let skew = pictures.skew.as_secs_f64();
    let frames = pictures.frames.into_iter().map(|frame| {
        let time = frame.time.as_secs_f64();
        Ok((time, view(py, frame.value)?))
    });
    Ok((frames.collect::<Outcome<_>>()?, skew))
}

fn go_on(watch: &Watch) -> ControlFlow<()> {
    match watch.stopped() {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    }
}

fn reading(id: u8, state: &WinchState) -> Reading {
    let WinchState {
        position,
        command,
        velocity,
        pull,
    } = *state;
    (id, Some((position.0, command, velocity, pull)), None)
}

impl From<RigError> for Failure {
    fn from(error: RigError) -> Self {
        let hint = hint::of_rig(&error);
        let class = match error {
            RigError::Command(_) | RigError::Limit { .. } | RigError::TooFar { .. } => {
                "CommandError"
            }
            _ => "RigError",
        };
        Self::with_hint(class, &error, hint)
    }
}
