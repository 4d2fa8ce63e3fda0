//! The column map beside a recording: which column holds what, in which unit, and what lies between servos and tendons.

use std::path::Path;

use nalgebra::{Isometry3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use tdcr_sim::inverse::recording::{Servo, ServoMap, Transmission};
use tdcr_sim::robot::{Drive, RobotSpec, TendonSpec};

use super::RecordingFileError;
use super::markers::MarkerColumns;

/// A column map, as its TOML file has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Columns {
    /// Column with the name of the motion that a row belongs to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pattern: Option<String>,
    /// How far positions are behind the servos (s; rows without a time).
    #[serde(default)]
    pub lag: f64,
    /// Column with the time; without one, rows are one unit of time apart.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<TimeColumn>,
    /// Pose of the recording's frame in the world; the world's where the file does not give it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<FramePose>,
    /// One for each tendon of the robot, in the order of a command.
    pub servos: Vec<ServoColumn>,
    /// What a table's rows measured: one or more points. Data sets and logs have clouds instead.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub markers: Vec<MarkerColumns>,
}

/// The column with the time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeColumn {
    /// Its name.
    pub column: String,
    /// Its unit: `s`, `ms`, `us` or `min`.
    #[serde(default = "second")]
    pub unit: TimeUnit,
}

/// Units of time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TimeUnit {
    /// Seconds.
    S,
    /// Milliseconds.
    Ms,
    /// Microseconds.
    Us,
    /// Minutes.
    Min,
}

/// Where a recording's frame is in the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FramePose {
    /// Its origin (m).
    #[serde(default)]
    pub position: [f64; 3],
    /// Its orientation: a quaternion (w, x, y, z), normalised on use.
    #[serde(default = "upright")]
    pub orientation: [f64; 4],
}

/// The column of a servo, and what lies between the servo and its tendon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServoColumn {
    /// Its name.
    pub column: String,
    /// Its unit.
    pub unit: PullUnit,
    /// Whether positive values pull the tendon (1) or let it go (-1).
    #[serde(default = "one")]
    pub sign: f64,
    /// Value at which the tendon is not pulled, in the column's unit.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub zero: f64,
    /// Radius of the spool (m), for angles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spool_radius: Option<f64>,
    /// Pull of the tendon by what the column says.
    #[serde(default = "one")]
    pub gain: f64,
    /// Pull where the column says `zero` (m, or N).
    #[serde(default)]
    pub offset: f64,
    /// Half the play (m, or N).
    #[serde(default)]
    pub backlash: f64,
}

/// Units of what servos report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PullUnit {
    /// Metres of tendon.
    M,
    /// Centimetres.
    Cm,
    /// Millimetres.
    Mm,
    /// Micrometres.
    Um,
    /// Radians of a spool, which has a `spool_radius`.
    Rad,
    /// Degrees of a spool.
    Deg,
    /// Newtons, of a tendon driven by tension.
    #[serde(rename = "N")]
    N,
}

impl PullUnit {
    /// The unit in metres, for lengths.
    pub(super) fn metres(self) -> Option<f64> {
        match self {
            Self::M => Some(1.0),
            Self::Cm => Some(1e-2),
            Self::Mm => Some(1e-3),
            Self::Um => Some(1e-6),
            Self::Rad | Self::Deg | Self::N => None,
        }
    }
}

impl TimeUnit {
    /// The unit in seconds.
    pub(super) fn seconds(self) -> f64 {
        match self {
            Self::S => 1.0,
            Self::Ms => 1e-3,
            Self::Us => 1e-6,
            Self::Min => 60.0,
        }
    }
}

impl ServoColumn {
    /// The pull that a value of the column is (m, or N).
    pub(super) fn pull(&self, value: f64) -> f64 {
        let unit = match (self.unit, self.spool_radius) {
            (PullUnit::Rad, Some(radius)) => radius,
            (PullUnit::Deg, Some(radius)) => radius.to_radians(),
            (unit, _) => unit.metres().unwrap_or(1.0),
        };
        self.sign * unit * (value - self.zero)
    }

    fn check(&self, place: usize) -> Result<(), String> {
        let at = |what: &str| format!("servos[{place}] ({}): {what}", self.column);
        let angle = matches!(self.unit, PullUnit::Rad | PullUnit::Deg);
        if self.sign.abs() != 1.0 {
            return Err(at(
                "`sign` is 1 where positive values pull, -1 where they let go",
            ));
        }
        match (angle, self.spool_radius) {
            (true, None) => return Err(at("an angle needs the `spool_radius` (m)")),
            (false, Some(_)) => return Err(at("`spool_radius` is for the units rad and deg")),
            (true, Some(radius)) if !(radius > 0.0 && radius.is_finite()) => {
                return Err(at("`spool_radius` is a length above 0"));
            }
            _ => {}
        }
        let numbers = [self.zero, self.gain, self.offset, self.backlash];
        if numbers.iter().any(|x| !x.is_finite()) || self.gain <= 0.0 || self.backlash < 0.0 {
            return Err(at(
                "expected finite numbers, `gain` above 0, `backlash` 0 or above",
            ));
        }
        Ok(())
    }
}

impl Columns {
    /// Reads a column map for `robot`.
    ///
    /// # Errors
    /// [`RecordingFileError`] for a file that cannot be read, or does not fit the robot.
    pub fn load(path: &Path, robot: &RobotSpec) -> Result<Self, RecordingFileError> {
        let text = std::fs::read_to_string(path).map_err(|source| RecordingFileError::Read {
            path: path.to_owned(),
            source,
        })?;
        let refuse = |reason: String| RecordingFileError::Columns {
            path: path.to_owned(),
            reason,
        };
        let columns: Self = toml::from_str(&text).map_err(|error| refuse(error.to_string()))?;
        columns.check(robot).map_err(refuse)?;
        Ok(columns)
    }

    /// A column map for `robot` from JSON text of the same keys.
    ///
    /// # Errors
    /// [`RecordingFileError::Columns`].
    pub fn from_json(text: &str, robot: &RobotSpec) -> Result<Self, RecordingFileError> {
        let refuse = |reason: String| RecordingFileError::Columns {
            path: "columns".into(),
            reason,
        };
        let columns: Self =
            serde_json::from_str(text).map_err(|error| refuse(error.to_string()))?;
        columns.check(robot).map_err(refuse)?;
        Ok(columns)
    }

    /// The map of a data set or a log, whose conditions are `robot`'s commands.
    pub fn of_commands(robot: &RobotSpec) -> Self {
        let servo = |(t, tendon): (usize, &TendonSpec)| ServoColumn {
            column: format!("command {t}"),
            unit: match tendon.drive {
                Drive::Tension => PullUnit::N,
                Drive::Gain(_) | Drive::Length => PullUnit::M,
            },
            sign: 1.0,
            zero: 0.0,
            spool_radius: None,
            gain: 1.0,
            offset: 0.0,
            backlash: 0.0,
        };
        Self {
            pattern: None,
            lag: 0.0,
            time: None,
            frame: None,
            servos: robot.tendons().into_iter().enumerate().map(servo).collect(),
            markers: Vec::new(),
        }
    }

    fn check(&self, robot: &RobotSpec) -> Result<(), String> {
        let (found, tendons) = (self.servos.len(), robot.tendon_count());
        if found != tendons {
            return Err(format!(
                "{found} servos; expected one [[servos]] for each of the robot's {tendons} tendons, in the order of a command"
            ));
        }
        if !(self.lag >= 0.0 && self.lag.is_finite()) {
            return Err(format!("lag = {}; expected 0 or above", self.lag));
        }
        for (place, servo) in self.servos.iter().enumerate() {
            servo.check(place)?;
            let tension = robot.tendons()[place].drive == Drive::Tension;
            if tension != (servo.unit == PullUnit::N) {
                return Err(format!(
                    "servos[{place}] ({}): its unit is N where and only where the tendon's drive is a tension",
                    servo.column
                ));
            }
        }
        for (place, marker) in self.markers.iter().enumerate() {
            marker
                .check(robot.disc_count())
                .map_err(|wrong| format!("markers[{place}]: {wrong}"))?;
        }
        if let Some(frame) = &self.frame {
            let numbers = frame.position.iter().chain(&frame.orientation);
            if numbers.clone().any(|x| !x.is_finite()) || frame.orientation == [0.0; 4] {
                return Err(
                    "frame: expected finite numbers, and a quaternion that is not 0".to_owned(),
                );
            }
        }
        Ok(())
    }

    /// What lies between the recording and the robot.
    pub fn transmission(&self, robot: &RobotSpec) -> Transmission {
        let tip = robot.disc_count().saturating_sub(1);
        Transmission {
            servos: self
                .servos
                .iter()
                .map(|servo| Servo {
                    gain: servo.gain,
                    offset: servo.offset,
                    backlash: servo.backlash,
                })
                .collect(),
            lag: self.lag,
            markers: (self.markers.iter())
                .flat_map(|marker| marker.points(tip))
                .collect(),
        }
    }

    /// The same map with another transmission's numbers.
    pub fn with(&self, transmission: &Transmission) -> Self {
        let mut columns = self.clone();
        columns.lag = transmission.lag;
        for (column, servo) in columns.servos.iter_mut().zip(&transmission.servos) {
            (column.gain, column.offset, column.backlash) =
                (servo.gain, servo.offset, servo.backlash);
        }
        let mut places = transmission.markers.iter().map(|marker| marker.place);
        for column in &mut columns.markers {
            column.set_points(&mut places);
        }
        columns
    }

    /// The same map with the servos in the order, and of the signs, that `map` found for `robot`, and the recording's frame turned
    /// as they ask.
    pub fn mapped(&self, map: &ServoMap, robot: &RobotSpec) -> Self {
        let mut columns = self.clone();
        columns.servos = (map.servos.iter())
            .map(|mapped| {
                let mut servo = self.servos[mapped.servo].clone();
                servo.sign *= mapped.sign;
                servo
            })
            .collect();
        let base = quaternion(robot.base.orientation);
        let about = Unit::new_normalize(base * Vector3::z());
        let turn = UnitQuaternion::from_axis_angle(&about, map.turn);
        let place = Vector3::from(robot.base.position);
        columns.moved(&Isometry3::from_parts(
            Translation3::from(place - turn * place),
            turn,
        ))
    }

    /// The same map with the recording's frame moved by `motion`, which is given in the world.
    pub fn moved(&self, motion: &Isometry3<f64>) -> Self {
        let frame = motion * self.pose();
        let q = frame.rotation;
        Self {
            frame: Some(FramePose {
                position: frame.translation.vector.into(),
                orientation: [q.w, q.i, q.j, q.k],
            }),
            ..self.clone()
        }
    }

    /// The pose of the recording's frame in the world (m).
    pub(super) fn pose(&self) -> Isometry3<f64> {
        self.frame.map_or_else(Isometry3::identity, |frame| {
            let [x, y, z] = frame.position;
            Isometry3::from_parts(Translation3::new(x, y, z), quaternion(frame.orientation))
        })
    }
}

/// The rotation of numbers w, x, y, z.
pub(super) fn quaternion([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

fn second() -> TimeUnit {
    TimeUnit::S
}

pub(super) fn upright() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}

fn one() -> f64 {
    1.0
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A data set's map of a robot whose tendons are driven by tension is one that is read again, its unit as the guide writes it.
    #[test]
    fn tensions_are_in_newtons() {
        let mut spec = RobotSpec::standard("2m").expect("a standard robot");
        for tendons in spec.modules.iter_mut().filter_map(|m| m.tendons.as_mut()) {
            tendons.drive = Drive::Tension;
        }
        let columns = Columns::of_commands(&spec);
        let text = toml::to_string(&columns).expect("plain values");
        assert!(text.contains("unit = \"N\""), "{text}");
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), text).expect("written");
        assert_eq!(Columns::load(file.path(), &spec).expect("a map"), columns);
    }
}
