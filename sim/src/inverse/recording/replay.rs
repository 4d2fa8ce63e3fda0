//! A recording under a model: where the markers should have been.

use nalgebra::Vector3;
use rayon::prelude::*;
use tdcr_base::stats::median;

use super::cloud::Surface;
use super::path::{self, has_friction};
use super::problem::place;
use super::{Order, Recording, RecordingError, Transmission};
use crate::robot::{Robot, RobotSpec};
use crate::statics::{Equilibrium, Settler};

/// What a model says of each row of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Replay {
    /// For each row where each marker should have been (m, world frame); none where the robot did not settle.
    pub points: Vec<Option<Vec<Vector3<f64>>>>,
    /// For each row the origin of each disc (m), in the same way.
    pub discs: Vec<Option<Vec<Vector3<f64>>>>,
    /// For each row and point of its cloud the nearest place on the robot's surface (m), in the same way.
    pub surface: Vec<Option<Vec<Vector3<f64>>>>,
}

/// How far a replay is from what was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Residuals {
    /// For each row and marker its residual (m), the marker's mean residual taken off; none where it was not measured, or the
    /// robot did not settle.
    pub markers: Vec<Vec<Option<Vector3<f64>>>>,
    /// For each row the distance of each point of its cloud from the robot's surface (m); empty where it was not measured, or the
    /// robot did not settle.
    pub distances: Vec<Vec<f64>>,
    /// Mean residual of each marker (m).
    pub means: Vec<Vector3<f64>>,
    /// Root mean square of the residuals' lengths, without the means, and of the distances, which have none (m).
    pub rmse: f64,
    /// Median of the distances (m); none where there are none. Points that are not of the robot hardly move it.
    pub median: Option<f64>,
    /// Rows in which the robot did not settle.
    pub unsettled: Vec<usize>,
}

impl Replay {
    /// Replays `recording` on a robot. With friction in its holes the rows are paths, cut where the servos have moved far in a gap;
    /// without, each row is settled by itself, and only the servos' backlash depends on the path.
    ///
    /// # Errors
    /// [`RecordingError`] for a recording or a transmission of another robot.
    pub fn new(
        spec: &RobotSpec,
        transmission: &Transmission,
        recording: &Recording,
    ) -> Result<Self, RecordingError> {
        super::check(spec, transmission, recording)?;
        let robot = Robot::new(super::without_ranges(spec)?)?;
        let commands = transmission.commands(&robot, recording);
        let see = |row: usize, settled: &Equilibrium| {
            let markers = transmission.markers.iter();
            let points: Vec<_> = markers
                .map(|marker| place(settled, &marker.point()))
                .collect();
            let surface = Surface::new(&robot, &recording.shown, settled);
            let touches = surface.touches(&robot, settled, recording.cloud(row));
            let nearest: Vec<_> = touches.iter().map(|touch| touch.place).collect();
            (points, (settled.positions.clone(), nearest))
        };
        let rows: Vec<Option<_>> = if has_friction(&robot) && recording.order == Order::Motion {
            path::replay(&robot, recording, &commands, see)
        } else {
            (commands.par_iter().enumerate())
                .map_init(
                    || Settler::new(&robot),
                    |settler, (row, command)| {
                        let command = robot.command(command).ok()?;
                        let settled = settler.settle(&command, &recording.loads(row));
                        settled.converged.then(|| see(row, settled))
                    },
                )
                .collect()
        };
        let mut replay = Self {
            points: Vec::new(),
            discs: Vec::new(),
            surface: Vec::new(),
        };
        for row in rows {
            let (points, bodies) = row.unzip();
            let (discs, surface) = bodies.unzip();
            replay.points.push(points);
            replay.discs.push(discs);
            replay.surface.push(surface);
        }
        Ok(replay)
    }

    /// Its residuals on `recording`.
    pub fn residuals(&self, recording: &Recording) -> Residuals {
        let markers = recording.points.first().map_or(0, Vec::len);
        let mut residuals: Vec<Vec<Option<Vector3<f64>>>> =
            (self.points.iter().zip(&recording.points))
                .map(|(simulated, measured)| {
                    let residual = |m: usize| Some(simulated.as_ref()?[m] - measured[m]?);
                    (0..markers).map(residual).collect()
                })
                .collect();
        let mean = |m: usize| {
            let all: Vec<Vector3<f64>> = residuals.iter().filter_map(|row| row[m]).collect();
            all.iter().sum::<Vector3<f64>>() / all.len().max(1) as f64
        };
        let means: Vec<Vector3<f64>> = (0..markers).map(mean).collect();
        let (mut sum, mut count) = (0.0, 0);
        for row in &mut residuals {
            for (residual, mean) in row.iter_mut().zip(&means) {
                if let Some(residual) = residual {
                    *residual -= mean;
                    sum += residual.norm_squared();
                    count += 1;
                }
            }
        }
        let rows = self.surface.iter().enumerate();
        let distances: Vec<Vec<f64>> = rows
            .map(|(row, nearest)| {
                let pairs = recording.cloud(row).iter().zip(nearest.iter().flatten());
                pairs.map(|(point, place)| (point - place).norm()).collect()
            })
            .collect();
        let mut all: Vec<f64> = distances.iter().flatten().copied().collect();
        for distance in &all {
            sum += distance * distance;
            count += 1;
        }
        let unsettled = (0..self.points.len()).filter(|&row| self.points[row].is_none());
        Residuals {
            means,
            rmse: (sum / f64::from(count.max(1))).sqrt(),
            median: (!all.is_empty()).then(|| median(&mut all)),
            unsettled: unsettled.collect(),
            distances,
            markers: residuals,
        }
    }
}

/// Standard deviation of a normal distribution by the median of its absolute values (Rousseeuw and Croux, 1993).
const DEVIATION_BY_MEDIAN: f64 = 1.4826;

impl Residuals {
    /// Sum of the squared residuals of markers (m²), and for the points of clouds what it would be without those that are far from
    /// the robot, as points of other things are.
    pub(super) fn squares(&self) -> f64 {
        let markers: f64 = (self.markers.iter().flatten().flatten())
            .map(Vector3::norm_squared)
            .sum();
        let points: usize = self.distances.iter().map(Vec::len).sum();
        let deviation = DEVIATION_BY_MEDIAN * self.median.unwrap_or(0.0);
        markers + points as f64 * deviation * deviation
    }
}
