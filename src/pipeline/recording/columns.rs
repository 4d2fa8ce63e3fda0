//! The column map beside a recording: which column holds what, in which unit, and what lies between servos and tendons.

use std::path::Path;

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use tdcr_base::files::{LARGEST_TEXT, Table, read_text, with_place, without_mark};
use tdcr_sim::inverse::recording::{Servo, ServoMap, Transmission};
use tdcr_sim::robot::{Drive, RobotSpec, TendonSpec};

use super::RecordingFileError;
use super::markers::MarkerColumns;
use super::rotation::{quaternion, upright};
use super::servo_column::{PullUnit, ServoColumn};

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

impl Columns {
    /// Reads a column map for `robot`.
    ///
    /// # Errors
    /// [`RecordingFileError`] for a file that cannot be read, or does not fit the robot.
    pub fn load(path: &Path, robot: &RobotSpec) -> Result<Self, RecordingFileError> {
        let text = read_text(path, LARGEST_TEXT).map_err(|source| RecordingFileError::Read {
            path: path.to_owned(),
            source,
        })?;
        let refuse = |reason: String| RecordingFileError::Columns {
            path: path.to_owned(),
            reason,
        };
        let columns: Self = toml::from_str(&text)
            .map_err(|error| refuse(with_place(&error.to_string(), &Self::tables())))?;
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
        let columns: Self = serde_json::from_str(without_mark(text))
            .map_err(|error| refuse(with_place(&error.to_string(), &Self::tables())))?;
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

    /// The tables of a column map.
    fn tables() -> [Table; 5] {
        [
            Table::of::<Self>("the file itself, above all tables"),
            Table::of::<TimeColumn>("`time`"),
            Table::of::<FramePose>("[frame]"),
            Table::of::<ServoColumn>("[[servos]]"),
            Table::of::<MarkerColumns>("[[markers]]"),
        ]
    }

    /// Refuses a column that stands for two things. One servo may drive two tendons only where it lets go of one as it pulls the
    /// other.
    fn check_names(&self) -> Result<(), String> {
        let servos = self.servos.iter().enumerate();
        let servos = servos.map(|(place, servo)| (format!("servos[{place}]"), &servo.column));
        let markers = self.markers.iter().enumerate().flat_map(|(place, marker)| {
            let columns = marker
                .columns
                .iter()
                .chain(marker.orientation.iter().flatten());
            columns.map(move |column| (format!("markers[{place}]"), column))
        });
        let time = self
            .time
            .iter()
            .map(|time| ("time".to_owned(), &time.column));
        let pattern = self
            .pattern
            .iter()
            .map(|column| ("pattern".to_owned(), column));
        let all: Vec<(String, &String)> =
            servos.chain(markers).chain(time).chain(pattern).collect();
        let sign = |place: usize| self.servos.get(place).map(|servo| servo.sign);
        for (place, (what, column)) in all.iter().enumerate() {
            let mut before = all[..place].iter().enumerate();
            let found = before.find(|(_, (_, other))| other == column);
            let Some((other, (first, _))) = found else {
                continue;
            };
            let antagonists = sign(place).zip(sign(other)).is_some_and(|(a, b)| a == -b);
            if !antagonists {
                return Err(format!(
                    "column `{column}` is that of {first} and of {what}; expected a column for each (two tendons of one servo have \
                     `sign` 1 and -1)"
                ));
            }
        }
        Ok(())
    }

    /// Names of the columns of each measured point, those of a pose for each of its points.
    pub(super) fn marker_names(&self) -> Vec<String> {
        let markers = self.markers.iter();
        markers
            .flat_map(|marker| vec![marker.columns.join(", "); marker.arms().len()])
            .collect()
    }

    fn check(&self, robot: &RobotSpec) -> Result<(), String> {
        let (found, tendons) = (self.servos.len(), robot.tendon_count());
        if found != tendons {
            return Err(format!(
                "{found} servos; expected one [[servos]] for each of the robot's {tendons} tendons, in the order of a command"
            ));
        }
        self.check_names()?;
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
        let turn = UnitQuaternion::from_axis_angle(&about, map.rotation);
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

fn second() -> TimeUnit {
    TimeUnit::S
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
