//! Paths of the tip in time.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, Vector3};
use thiserror::Error;

/// Where the tip is to be, at each time: a curve that is run through once, or a table of points.
#[derive(Clone, Debug, PartialEq)]
pub struct TipPath {
    curve: Curve,
    /// Time from its start to its end (s).
    duration: f64,
}

/// A closed curve in the xy plane of a frame, about its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A circle.
    Circle,
    /// A figure of eight (lemniscate of Gerono), as wide as the diameter in x and half as wide in y.
    Eight,
    /// A square with sides as long as the diameter, run through at constant speed.
    Square,
    /// `x = r sin(a s)`, `y = r sin(b s)`.
    Lissajous([u32; 2]),
}

#[derive(Clone, Debug, PartialEq)]
enum Curve {
    Closed {
        shape: Shape,
        frame: Isometry3<f64>,
        diameter: f64,
    },
    Table {
        times: Vec<f64>,
        points: Vec<Vector3<f64>>,
    },
}

/// Why something is no path.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum TipPathError {
    /// A size or a time that is not a finite number above 0.
    #[error("the {what} is {value}; expected a finite number above 0")]
    NotPositive {
        /// What, with its unit.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A coordinate that is not a finite number.
    #[error("row {row} of the path has {value}; expected finite numbers")]
    NotFinite {
        /// The row, from 0.
        row: usize,
        /// Its value.
        value: f64,
    },
    /// Times that do not ascend.
    #[error(
        "row {row} of the path is at {time} s, and the row before at {before} s; expected times that ascend"
    )]
    Times {
        /// The row, from 0.
        row: usize,
        /// Its time (s).
        time: f64,
        /// The time of the row before (s).
        before: f64,
    },
    /// Fewer than two rows.
    #[error("the path has {0} rows; expected two at least")]
    Rows(usize),
    /// No Lissajous figure.
    #[error("a Lissajous figure of {0:?}; expected two whole numbers above 0")]
    Lissajous([u32; 2]),
}

fn positive(what: &'static str, value: f64) -> Result<f64, TipPathError> {
    match value.is_finite() && value > 0.0 {
        true => Ok(value),
        false => Err(TipPathError::NotPositive { what, value }),
    }
}

impl TipPath {
    /// A closed curve in the xy plane of `frame` (m, in the world), about its origin, `diameter` (m) wide, run through once in
    /// `duration` (s).
    ///
    /// # Errors
    /// [`TipPathError`] for numbers that are no such sizes.
    pub fn closed(
        shape: Shape,
        frame: &Isometry3<f64>,
        diameter: f64,
        duration: f64,
    ) -> Result<Self, TipPathError> {
        positive("diameter (m)", diameter)?;
        positive("duration (s)", duration)?;
        let mut numbers = (frame.translation.vector.iter()).chain(frame.rotation.coords.iter());
        if let Some(&value) = numbers.find(|x| !x.is_finite()) {
            return Err(TipPathError::NotFinite { row: 0, value });
        }
        match shape {
            Shape::Lissajous(ratio) if ratio.contains(&0) => Err(TipPathError::Lissajous(ratio)),
            _ => Ok(Self {
                curve: Curve::Closed {
                    shape,
                    frame: *frame,
                    diameter,
                },
                duration,
            }),
        }
    }

    /// Straight lines from point to point: `times` (s) ascend, and count from the first; `points` are in the world frame (m).
    ///
    /// # Errors
    /// [`TipPathError`] for fewer than two rows, times that do not ascend, and numbers that are not finite.
    pub fn table(rows: &[(f64, Vector3<f64>)]) -> Result<Self, TipPathError> {
        if rows.len() < 2 {
            return Err(TipPathError::Rows(rows.len()));
        }
        for (row, (time, point)) in rows.iter().enumerate() {
            let mut numbers = std::iter::once(time).chain(point.iter());
            if let Some(&value) = numbers.find(|x| !x.is_finite()) {
                return Err(TipPathError::NotFinite { row, value });
            }
            match row.checked_sub(1).map(|last| rows[last].0) {
                Some(before) if before >= *time => {
                    let time = *time;
                    return Err(TipPathError::Times { row, time, before });
                }
                _ => {}
            }
        }
        let times: Vec<f64> = rows.iter().map(|(time, _)| time - rows[0].0).collect();
        Ok(Self {
            duration: times[times.len() - 1],
            curve: Curve::Table {
                times,
                points: rows.iter().map(|(_, point)| *point).collect(),
            },
        })
    }

    /// Time from its start to its end (s).
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Where the tip is to be at `time` (s, from the start), world frame (m); before the start the first point, after the end the
    /// last one.
    pub fn at(&self, time: f64) -> Vector3<f64> {
        let time = time.clamp(0.0, self.duration);
        match &self.curve {
            Curve::Closed {
                shape,
                frame,
                diameter,
            } => {
                let [x, y] = shape.at(time / self.duration);
                (frame * Point3::from(Vector3::new(x, y, 0.0) * (diameter / 2.0))).coords
            }
            Curve::Table { times, points } => {
                let next = times.partition_point(|&t| t <= time).min(times.len() - 1);
                let last = next.saturating_sub(1);
                let part = (time - times[last]) / (times[next] - times[last]);
                points[last].lerp(&points[next], part)
            }
        }
    }
}

impl Shape {
    /// Where the curve is at the part `s` of its way, in units of half its width.
    fn at(self, s: f64) -> [f64; 2] {
        match self {
            Self::Circle => [(TAU * s).cos(), (TAU * s).sin()],
            Self::Eight => [(TAU * s).sin(), 0.5 * (2.0 * TAU * s).sin()],
            Self::Square => {
                // From the middle of a side, by corners.
                const CORNERS: [[f64; 2]; 6] = [
                    [1.0, 0.0],
                    [1.0, 1.0],
                    [-1.0, 1.0],
                    [-1.0, -1.0],
                    [1.0, -1.0],
                    [1.0, 0.0],
                ];
                let ends = [0.0, 0.125, 0.375, 0.625, 0.875, 1.0];
                let side = ends[1..5].iter().filter(|&&end| end <= s).count();
                let part = (s - ends[side]) / (ends[side + 1] - ends[side]);
                let between = |axis: usize| {
                    CORNERS[side][axis] + part * (CORNERS[side + 1][axis] - CORNERS[side][axis])
                };
                [between(0), between(1)]
            }
            Self::Lissajous([a, b]) => [
                (TAU * f64::from(a) * s).sin(),
                (TAU * f64::from(b) * s).sin(),
            ],
        }
    }
}
