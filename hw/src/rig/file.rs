//! What a rig consists of, as its file says it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use tdcr_base::files::{Table, read_text, with_place};
use tdcr_sim::formats::Note;
use tdcr_sim::render::{BaseVisibility, Sensor};
use tdcr_sim::robot::{CameraSpec, Cameras, Robot, RobotSpec};
use tdcr_sim::scene::Scene;

use super::RigError;
use super::masks::MasksSpec;
use super::place::line_of;
use super::settings::{MotionSettings, SafetySettings, SimulationSettings};
use super::spool::Direction;
use crate::plan::CommandSettings;
use crate::servo::OperatingMode;

/// Largest rig file (bytes).
const LARGEST: u64 = 1 << 20;

/// A rig as its file (`rig.toml`) says it: servos, cameras, and what joins them. Lengths in metres, currents in amperes,
/// tensions in newtons.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigSpec {
    /// Name, for data sets and logs.
    pub name: String,
    /// The robot: `2m`, `3m`, `5m`, or the path of its file, from the rig file's folder.
    pub robot: String,
    /// Whether the base is a part of what cameras see and clouds show.
    #[serde(default = "base_hidden")]
    pub base: BaseVisibility,
    /// The servos behind its tendons.
    pub servos: ServosSpec,
    /// The cameras that watch it.
    #[serde(default)]
    pub cameras: Vec<RigCameraSpec>,
    /// How the robot is told from what else the cameras see.
    #[serde(default)]
    pub masks: MasksSpec,
    /// What the robot keeps clear of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<RigScene>,
    /// Which commands are drawn.
    #[serde(default)]
    pub commands: CommandSettings,
    /// How the robot moves, and when it counts as still.
    #[serde(default)]
    pub motion: MotionSettings,
    /// What ends a motion.
    #[serde(default)]
    pub safety: SafetySettings,
    /// What there is besides the robot where parts are simulated.
    #[serde(default)]
    pub simulation: SimulationSettings,
}

/// Obstacles around a rig, such as the table below it. Ways are planned clear of them. A simulated robot is among them and its
/// cameras see them, unless [`SimulationSettings::scene`] says what there is instead.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigScene {
    /// The scene's file, from the rig file's folder.
    pub file: PathBuf,
    /// Distance that discs keep from obstacles (m).
    #[serde(default = "five_millimetres")]
    pub clearance: f64,
}

fn five_millimetres() -> f64 {
    0.005
}

fn base_hidden() -> BaseVisibility {
    BaseVisibility::Hidden
}

/// What servos are connected to.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ServoLink {
    /// Servos in memory, with the rig's robot behind their spools.
    Simulated,
    /// A serial port or pseudo-terminal, such as `/dev/ttyUSB0`.
    Serial(PathBuf),
    /// A log that is played back.
    Recorded(PathBuf),
}

/// What a camera is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraLink {
    /// In memory: it sees the robot behind the simulated servos.
    Simulated,
    /// An Intel RealSense of this serial number.
    Realsense,
    /// A log that is played back.
    Recorded(PathBuf),
}

/// The operating modes that drive tendons, both over several turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TendonMode {
    /// By position, with as much current as that takes, up to the servo's own limit.
    ExtendedPosition,
    /// By position with no more than the current limit: a bounded tension, the safe way to drive a tendon.
    #[default]
    CurrentBasedPosition,
}

impl From<TendonMode> for OperatingMode {
    fn from(mode: TendonMode) -> Self {
        match mode {
            TendonMode::ExtendedPosition => Self::ExtendedPosition,
            TendonMode::CurrentBasedPosition => Self::CurrentBasedPosition,
        }
    }
}

/// The servos, one for each tendon in the order of a command.
///
/// Lists have an entry for each servo, or a single one that holds for all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServosSpec {
    /// What they are connected to.
    pub link: ServoLink,
    /// Bits per second of the line.
    #[serde(default = "megabaud")]
    pub baud: u32,
    /// Addresses, in the order of the tendons.
    pub ids: Vec<u8>,
    /// How they are driven.
    #[serde(default)]
    pub mode: TendonMode,
    /// Which way they count when they wind.
    pub directions: Vec<Direction>,
    /// Radii of the spools, to the middle of the tendon (m).
    pub spool_radius: Vec<f64>,
    /// Tensions of the tendons at home (N), where the robot stands straight.
    pub home_tension: Vec<f64>,
    /// Smallest and largest position that a goal may have, from home (ticks).
    pub limits: Vec<[i32; 2]>,
    /// Largest current (A): of the goals in current-based position mode.
    pub current_limit: Vec<f64>,
}

fn megabaud() -> u32 {
    1_000_000
}

/// A camera of a rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigCameraSpec {
    /// Serial number; of a simulated one any name.
    pub serial: String,
    /// What it is.
    pub link: CameraLink,
    /// Place, aim and lens of its colour camera.
    pub camera: CameraSpec,
    /// Faults of a simulated one; none where the file does not name a model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<SensorModel>,
}

/// Models of simulated depth cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorModel {
    /// Intel RealSense D435.
    D435,
}

impl SensorModel {
    /// Its faults.
    pub fn sensor(self) -> Sensor {
        match self {
            Self::D435 => Sensor::d435(),
        }
    }
}

/// A rig file that was read: what it says, and the robot that it names.
#[derive(Clone, Debug)]
pub struct RigFile {
    /// Where it lies.
    pub path: PathBuf,
    /// What it says.
    pub spec: RigSpec,
    /// The robot, watched by the rig's cameras where it has any.
    pub robot: RobotSpec,
    /// The obstacles that it keeps clear of, where the file names a scene.
    pub scene: Option<Scene>,
    /// The obstacles that there are where it is simulated; none is the default.
    pub simulated_scene: Scene,
    /// What of the robot's file, if it is one of another tool, was passed over or is otherwise here.
    pub notes: Vec<Note>,
    /// Its text, for the lines of what is wrong.
    text: Arc<str>,
}

impl RigFile {
    /// Reads and checks the rig file `path`.
    ///
    /// # Errors
    /// [`RigError::Read`], [`RigError::Parse`] with line and field, [`RigError::Field`] for a value that makes no sense,
    /// [`RigError::Robot`].
    pub fn load(path: &Path) -> Result<Self, RigError> {
        let text = read_text(path, LARGEST).map_err(|source| RigError::Read {
            path: path.to_owned(),
            source,
        })?;
        Self::parse(&text, path)
    }

    /// The rig that `text` describes, read from `path`: robots and logs are named from its folder.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn parse(text: &str, path: &Path) -> Result<Self, RigError> {
        let spec: RigSpec = toml::from_str(text).map_err(|error| RigError::Parse {
            path: path.to_owned(),
            reason: with_place(&error.to_string(), &tables()),
        })?;
        let (robot, notes) = RobotSpec::load_with_notes(&robot_name(&spec.robot, path))?;
        let scene = spec.scene.as_ref().map(|around| &around.file);
        let scene = scene.map(|file| Scene::load(&beside(path, file)));
        let scene = scene.transpose()?;
        let simulated_scene = match &spec.simulation.scene {
            Some(file) => Scene::load(&beside(path, file))?,
            None => scene.clone().unwrap_or_default(),
        };
        let mut file = Self {
            path: path.to_owned(),
            robot,
            scene,
            simulated_scene,
            notes,
            spec,
            text: text.into(),
        };
        if !file.spec.cameras.is_empty() {
            let cameras = file.spec.cameras.iter();
            file.robot.cameras = Cameras::Free(cameras.map(|c| c.camera.clone()).collect());
        }
        file.check()
            .and_then(|()| Ok(file.robot.validate()?))
            .map_err(|error| file.located(error))?;
        Ok(file)
    }

    /// An error of a value in this file, with the file and the line.
    pub(super) fn located(&self, error: RigError) -> RigError {
        error.in_file(&self.path, |field| line_of(&self.text, field))
    }

    /// The robot, compiled.
    ///
    /// # Errors
    /// [`RigError::Spec`].
    pub fn compile(&self) -> Result<Robot, RigError> {
        Ok(Robot::new(self.robot.clone())?)
    }

    /// A path that the file names.
    pub fn resolve(&self, path: &Path) -> PathBuf {
        beside(&self.path, path)
    }
}

/// The tables of a rig file.
fn tables() -> [Table; 9] {
    [
        Table::of::<RigSpec>("the file itself, above all tables"),
        Table::of::<ServosSpec>("[servos]"),
        Table::of::<RigCameraSpec>("[[cameras]]"),
        Table::of::<MasksSpec>("[masks]"),
        Table::of::<RigScene>("[scene]"),
        Table::of::<CommandSettings>("[commands]"),
        Table::of::<MotionSettings>("[motion]"),
        Table::of::<SafetySettings>("[safety]"),
        Table::of::<SimulationSettings>("[simulation]"),
    ]
}

/// `path` as seen from the folder of the file `from`.
fn beside(from: &Path, path: &Path) -> PathBuf {
    from.parent().unwrap_or(Path::new("")).join(path)
}

fn robot_name(name: &str, rig: &Path) -> String {
    if RobotSpec::STANDARD.contains(&name) {
        return name.to_owned();
    }
    beside(rig, Path::new(name)).to_string_lossy().into_owned()
}
