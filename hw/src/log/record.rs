//! What a log holds, as plain data.

use nalgebra::Isometry3;
use tdcr_sim::camera::Intrinsics;
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::pose::Pose;

use crate::servo::{
    HardwareErrors, Identity, OperatingMode, Present, Registers, ServoId, Ticks, Torque,
    WatchdogState,
};

/// Name of the world's frame.
pub const WORLD: &str = "world";

/// One message of a log.
#[derive(Clone, Debug)]
pub enum LogRecord {
    /// What servos did. A servo that did not answer is not among them.
    Present(Vec<(ServoId, Reading)>),
    /// What servos were told.
    Goals(Vec<(ServoId, Goal)>),
    /// What is known of servos besides.
    Status(Vec<ServoStatus>),
    /// Where the homes of servos are.
    Homes(Vec<ServoHome>),
    /// Bytes of a servo's control table.
    Registers(Registers),
    /// What was asked of the robot's tendons: one value each, in the unit of the robot's commands (m, or N for a tension). Right
    /// before a sample's cloud, what its servos stood at.
    Command(Vec<f64>),
    /// What happened, in words.
    Event(Event),
    /// The robot as URDF text.
    Robot(String),
    /// Poses of frames within others.
    Transforms(Vec<Transform>),
    /// A cloud in the world (m).
    Cloud(PointCloud),
    /// A camera's intrinsics. Its pose is a [`Transform`].
    Calibration {
        /// The camera's serial number.
        serial: String,
        /// Its intrinsics.
        intrinsics: Intrinsics,
    },
    /// A camera's colours, 8-bit RGB.
    Color {
        /// The camera's serial number.
        serial: String,
        /// Its image.
        image: Image<[u8; 3]>,
    },
    /// A camera's depths along its optical axis (m); 0 where there is none.
    Depth {
        /// The camera's serial number.
        serial: String,
        /// Its image.
        image: Image<f32>,
    },
}

/// What a servo did at a moment. The faults that it reported then are part of its [`ServoStatus`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Angle.
    pub position: Ticks,
    /// Angular velocity (rad/s).
    pub velocity: f64,
    /// Current of the motor (A), of the sign of its torque.
    pub current: f64,
}

impl From<Present> for Reading {
    fn from(present: Present) -> Self {
        Self {
            position: present.position,
            velocity: present.velocity,
            current: present.current,
        }
    }
}

/// What a servo was told.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Goal {
    /// Where to turn.
    pub position: Option<Ticks>,
    /// Current to drive with, or the most to use (A).
    pub current: Option<f64>,
}

/// What is known of a servo: fields that nobody asked for are `None`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoStatus {
    /// Which one.
    pub id: ServoId,
    /// What it says that it is.
    pub identity: Option<Identity>,
    /// Whether its motor is on.
    pub torque: Option<Torque>,
    /// What its goals mean.
    pub mode: Option<OperatingMode>,
    /// The current that it never exceeds (A).
    pub current_limit: Option<f64>,
    /// What its watchdog does.
    pub watchdog: Option<WatchdogState>,
    /// Temperature inside (degrees Celsius).
    pub temperature: Option<f64>,
    /// Supply voltage (V).
    pub voltage: Option<f64>,
    /// Faults that it reports.
    pub hardware_errors: Option<HardwareErrors>,
}

impl ServoStatus {
    /// Nothing known but the servo's address.
    pub fn of(id: ServoId) -> Self {
        Self {
            id,
            identity: None,
            torque: None,
            mode: None,
            current_limit: None,
            watchdog: None,
            temperature: None,
            voltage: None,
            hardware_errors: None,
        }
    }

    /// What is known with what `newer` says.
    pub fn updated(self, newer: &Self) -> Self {
        Self {
            id: self.id,
            identity: newer.identity.or(self.identity),
            torque: newer.torque.or(self.torque),
            mode: newer.mode.or(self.mode),
            current_limit: newer.current_limit.or(self.current_limit),
            watchdog: newer.watchdog.or(self.watchdog),
            temperature: newer.temperature.or(self.temperature),
            voltage: newer.voltage.or(self.voltage),
            hardware_errors: newer.hardware_errors.or(self.hardware_errors),
        }
    }
}

/// Where home is, which a servo does not know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServoHome {
    /// Of which one.
    pub id: ServoId,
    /// Home in its own count.
    pub home: Ticks,
    /// Where it was last known to stand, in its own count.
    pub last: Ticks,
}

/// How much an event matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Of interest to who looks for a fault.
    Debug,
    /// To be expected.
    Info,
    /// Not as it should be.
    Warning,
    /// Something failed.
    Error,
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// How much it matters.
    pub level: Level,
    /// What it happened to, such as `servo 3`.
    pub source: String,
    /// What happened.
    pub text: String,
}

const SAMPLE: &str = "sample ";

impl Event {
    /// The words with which a capture says that the pictures logged last are those of sample `index`; the sample's cloud follows.
    pub fn sample_text(index: u64) -> String {
        format!("{SAMPLE}{index}")
    }

    /// The sample of which this event is the word; none of any other event.
    pub fn sample(&self) -> Option<u64> {
        self.text.strip_prefix(SAMPLE)?.parse().ok()
    }
}

/// Pose of a frame within another.
#[derive(Clone, Debug, PartialEq)]
pub struct Transform {
    /// The frame that the pose is in.
    pub parent: String,
    /// The frame that has the pose.
    pub child: String,
    /// The pose (m).
    pub pose: Isometry3<f64>,
}

impl Transform {
    /// Where a camera is in the world.
    pub fn of_camera(serial: &str, pose: Isometry3<f64>) -> Self {
        Self {
            parent: WORLD.to_owned(),
            child: camera_frame(serial),
            pose,
        }
    }

    /// Where a camera's depth sensor is: `depth_to_color` takes points of its frame to the colour camera's.
    pub fn of_depth_sensor(serial: &str, depth_to_color: Isometry3<f64>) -> Self {
        Self {
            parent: camera_frame(serial),
            child: format!("{}_depth", camera_frame(serial)),
            pose: depth_to_color,
        }
    }

    /// How a robot's discs are turned, for the links of the URDF that [`tdcr_sim::formats::urdf::export`] writes: it has
    /// three joints for each ball joint, and here the last of them turns for all three.
    pub fn of_discs(pose: &Pose<'_>) -> Vec<Self> {
        let turned = pose.configuration.0.iter().enumerate();
        turned
            .map(|(index, rotation)| Self {
                parent: format!("disc{index}_y"),
                child: format!("disc{index}"),
                pose: Isometry3::from_parts(Default::default(), *rotation),
            })
            .collect()
    }
}

/// Name of a camera's frame: x to the right of the image, y down, z along the optical axis.
pub fn camera_frame(serial: &str) -> String {
    format!("camera_{serial}")
}

/// A row-major image.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<P> {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` pixels.
    pub pixels: Vec<P>,
}
