//! From metres to the units that a network sees, and back.

use std::iter::zip;
use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use tdcr_base::files::{LARGEST_TEXT, read_text, write_atomically};

use super::DataError;

const MOTORS_FILE: &str = "global_motors_scope-all.json";
const POINTS_FILE: &str = "global_norm_scope-all_anchor-origin.json";

/// A data set's normalisation: motors min-max scaled to `[0, 1]`, points divided by one length.
///
/// Ranges and scale are over all three splits, as the authors' files have them (`scope-all`): two numbers of a motor may be those
/// of a test command.
///
/// Motors: `(m - min) / (max - min)` per dimension (paper, Eq. motor_normalization). A motor that never moves has
/// `max = min`; it is divided by 1 instead, so it maps to 0. Points: `X / s`, not translated, so that the base stays
/// where it is (paper, Eq. point_normalization).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Normalisation {
    /// Smallest value of each motor (m, N for tension drives, or the units of a recording), length `D`; the payload (kg) counts as the last motor.
    pub motor_min: Vec<f64>,
    /// Largest value of each motor, length `D`.
    pub motor_max: Vec<f64>,
    /// Scale `s` (m): the largest distance of a point from the world's origin.
    pub scale: f64,
}

/// A number of a condition outside the data's range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OutOfRange {
    /// Which motor.
    pub index: usize,
    /// Its value (in the motor's unit, kg for the payload).
    pub value: f64,
    /// The smallest value in the data.
    pub min: f64,
    /// The largest.
    pub max: f64,
}

/// What a condition may be outside `[0, 1]`: data sets are of single precision.
const ROUNDING: f64 = 1e-6;

impl Normalisation {
    /// The numbers of a command (m) that lie outside the data's range, by more than rounding or not finite.
    ///
    /// # Errors
    /// [`DataError::ConditionLength`] unless there is one component per motor.
    pub fn out_of_range(&self, command: &[f64]) -> Result<Vec<OutOfRange>, DataError> {
        self.require_length(command.len())?;
        let ranges = zip(&self.motor_min, &self.motor_max);
        let outside = zip(command, ranges)
            .enumerate()
            .filter_map(|(index, (value, range))| {
                let (&value, (&min, &max)) = (value, range);
                let margin = ROUNDING * divisor(min, max);
                let inside = (min - margin..=max + margin).contains(&value);
                (!inside).then_some(OutOfRange {
                    index,
                    value,
                    min,
                    max,
                })
            });
        Ok(outside.collect())
    }

    /// The condition, dimensionless and of length `D`, that stands for a command (m).
    ///
    /// # Errors
    /// [`DataError::ConditionLength`] unless there is one component per motor.
    pub fn condition(&self, command: &[f64]) -> Result<Vec<f32>, DataError> {
        self.require_length(command.len())?;
        Ok(self.normalise(command.iter().copied()).collect())
    }

    /// The command (m) that a dimensionless condition of length `D` stands for.
    pub(crate) fn command(&self, condition: &[f32]) -> Vec<f64> {
        zip(condition, zip(&self.motor_min, &self.motor_max))
            .map(|(&value, (min, max))| min + f64::from(value) * divisor(*min, *max))
            .collect()
    }

    /// Refuses conditions of another length.
    pub(super) fn require_length(&self, found: usize) -> Result<(), DataError> {
        match self.motor_min.len() {
            expected if expected == found => Ok(()),
            expected => Err(DataError::ConditionLength { expected, found }),
        }
    }

    /// Conditions, row-major `(B, D)`, that stand for commands (m), row-major `(B, D)`.
    pub(super) fn conditions(&self, commands: &[f32]) -> Vec<f32> {
        let rows = commands.chunks_exact(self.motor_min.len());
        rows.flat_map(|row| self.normalise(row.iter().map(|&motor| motor.into())))
            .collect()
    }

    fn normalise(&self, command: impl Iterator<Item = f64>) -> impl Iterator<Item = f32> {
        zip(command, zip(&self.motor_min, &self.motor_max))
            .map(|(motor, (min, max))| ((motor - min) / divisor(*min, *max)) as f32)
    }

    /// Turns coordinates in metres, in place, into dimensionless ones.
    pub fn normalise_points(&self, coordinates: &mut [f32]) {
        for x in coordinates {
            *x = (f64::from(*x) / self.scale) as f32;
        }
    }

    /// Turns dimensionless coordinates, in place, into metres.
    pub fn denormalise_points(&self, coordinates: &mut [f32]) {
        for x in coordinates {
            *x = (f64::from(*x) * self.scale) as f32;
        }
    }

    /// Whether one of the two normalisation files is in the folder `dir`.
    pub(super) fn is_in(dir: &Path) -> bool {
        [MOTORS_FILE, POINTS_FILE]
            .iter()
            .any(|file| dir.join(file).exists())
    }

    /// Reads the two normalisation files in the folder `dir`. Their motor `scale` follows from `min` and `max` and is
    /// not used.
    ///
    /// # Errors
    /// [`DataError::Io`], [`DataError::Json`]; [`DataError::InvalidJson`] for lists of unequal length, values that are
    /// not finite, a range or scale that is not positive, or a center that is not the origin.
    pub fn load(dir: &Path) -> Result<Self, DataError> {
        let (motors_path, points_path) = (dir.join(MOTORS_FILE), dir.join(POINTS_FILE));
        let Scoped { all: motors } = read_json::<Scoped<MotorRange>>(&motors_path)?;
        let Scoped { all: points } = read_json::<Scoped<PointScale>>(&points_path)?;
        let refuse = |path: &Path, problem: String| DataError::InvalidJson {
            path: path.to_owned(),
            problem,
        };
        let lengths = [motors.min.len(), motors.max.len(), motors.scale.len()];
        if lengths != [lengths[0].max(1); 3] {
            let problem =
                format!("min, max and scale have {lengths:?} values, expected one per motor each");
            return Err(refuse(&motors_path, problem));
        }
        if points.center != [0.0; 3] {
            let problem = format!("center is {:?}, expected the origin", points.center);
            return Err(refuse(&points_path, problem));
        }
        let normalisation = Self {
            motor_min: motors.min,
            motor_max: motors.max,
            scale: points.scale,
        };
        normalisation
            .check_motors()
            .map_err(|problem| refuse(&motors_path, problem))?;
        normalisation
            .check_scale()
            .map_err(|problem| refuse(&points_path, problem))?;
        Ok(normalisation)
    }

    /// Says what is wrong with the bounds of the motors, if anything.
    pub(crate) fn check_motors(&self) -> Result<(), String> {
        let ordered = |min: &f64, max: &f64| min.is_finite() && max.is_finite() && min <= max;
        let mut bounds = zip(&self.motor_min, &self.motor_max);
        match bounds.position(|(min, max)| !ordered(min, max)) {
            None => Ok(()),
            Some(j) => Err(format!(
                "motor {} runs from {} to {}, expected min <= max, finite",
                j + 1,
                self.motor_min[j],
                self.motor_max[j]
            )),
        }
    }

    /// Says what is wrong with the scale, if anything.
    pub(crate) fn check_scale(&self) -> Result<(), String> {
        // Points are of single precision.
        if self.scale > 0.0 && (self.scale as f32).is_normal() {
            Ok(())
        } else {
            Err(format!(
                "scale is {}, expected a positive length, 1.2e-38 to 3.4e38 m",
                self.scale
            ))
        }
    }

    /// Writes the two normalisation files into the folder `dir`, each atomically.
    ///
    /// # Errors
    /// [`DataError::Io`].
    pub fn save(&self, dir: &Path) -> Result<(), DataError> {
        let motors = MotorRange {
            min: self.motor_min.clone(),
            max: self.motor_max.clone(),
            scale: zip(&self.motor_min, &self.motor_max)
                .map(|(min, max)| divisor(*min, *max))
                .collect(),
        };
        let points = PointScale {
            center: [0.0; 3],
            scale: self.scale,
        };
        write_json(&dir.join(MOTORS_FILE), &Scoped { all: motors })?;
        write_json(&dir.join(POINTS_FILE), &Scoped { all: points })
    }
}

/// What a motor's distance from `min` is divided by (m): its range, or 1 where it never moves.
fn divisor(min: f64, max: f64) -> f64 {
    match max - min {
        0.0 => 1.0,
        range => range,
    }
}

/// Finds a [`Normalisation`] in one pass over the samples.
pub(super) struct NormalisationFit {
    motor_min: Vec<f64>,
    motor_max: Vec<f64>,
    squared_radius: f64,
}

impl NormalisationFit {
    pub(super) fn new(motors: usize) -> Self {
        Self {
            motor_min: vec![f64::INFINITY; motors],
            motor_max: vec![f64::NEG_INFINITY; motors],
            squared_radius: 0.0,
        }
    }

    /// Takes in commands, row-major `(B, D)` (m), and coordinates, row-major `(B, N, 3)` (m).
    pub(super) fn include(&mut self, commands: &[f32], coordinates: &[f32]) {
        for command in commands.chunks_exact(self.motor_min.len()) {
            for (j, &motor) in command.iter().enumerate() {
                self.motor_min[j] = self.motor_min[j].min(motor.into());
                self.motor_max[j] = self.motor_max[j].max(motor.into());
            }
        }
        for point in coordinates.as_chunks::<3>().0 {
            let squared_radius: f64 = point.iter().map(|&x| f64::from(x) * f64::from(x)).sum();
            self.squared_radius = self.squared_radius.max(squared_radius);
        }
    }

    /// The scale is rounded to `f32`, so that the shards, which store it as `f32`, and the JSON file agree.
    /// It is 1 where every point is the origin.
    pub(super) fn finish(self) -> Normalisation {
        let radius = f64::from(self.squared_radius.sqrt() as f32);
        Normalisation {
            motor_min: self.motor_min,
            motor_max: self.motor_max,
            scale: if radius > 0.0 { radius } else { 1.0 },
        }
    }
}

/// Statistics over all splits: the only scope that is written.
#[derive(Serialize, Deserialize)]
struct Scoped<T> {
    all: T,
}

#[derive(Serialize, Deserialize)]
struct MotorRange {
    min: Vec<f64>,
    max: Vec<f64>,
    scale: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
struct PointScale {
    center: [f64; 3],
    scale: f64,
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, DataError> {
    let text = read_text(path, LARGEST_TEXT).map_err(DataError::io("read", path))?;
    serde_json::from_str(&text).map_err(|source| DataError::Json {
        path: path.to_owned(),
        source,
    })
}

fn write_json(path: &Path, value: &impl Serialize) -> Result<(), DataError> {
    let bytes = serde_json::to_vec_pretty(value).expect("a struct of plain values serialises");
    write_atomically(path, |file| std::io::Write::write_all(file, &bytes))
        .map_err(DataError::io("write", path))
}
