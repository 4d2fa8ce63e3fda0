//! Residuals of a recording, and their derivatives by the unknowns.

use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;

use super::cloud::{Surface, Touch, corners};
use super::explicit::Explicit;
use super::numbers::Numbers;
use super::unknowns::Unknown;
use super::{Recording, RecordingError, Transmission};
use crate::chain::Configuration;
use crate::inverse::least_squares::{Evaluation, Limit};
use crate::robot::{Robot, RobotSpec};
use crate::sensitivity::{Changed, DiscPoint};
use crate::statics::{Equilibrium, Settler};

/// Step of a coordinate over which the model is taken as linear, in standard deviations of its prior.
const STEP: f64 = 1e-4;

/// What is to be explained, by which unknowns.
///
/// A row that is computed while `stop` says so is left as it was: what is computed then is thrown away.
#[derive(Clone)]
pub(super) struct Problem<'a> {
    pub explicit: &'a Explicit,
    pub transmission: &'a Transmission,
    pub recording: &'a Recording,
    pub speeds: Vec<Vec<f64>>,
    pub unknowns: &'a [Unknown],
    /// Distance (m) from which a residual counts less than by its square.
    pub loss: f64,
    /// Whether rows follow one another with friction in the holes; otherwise each is an equilibrium by itself.
    pub friction: bool,
    pub stop: &'a (dyn Fn() -> bool + Sync),
}

/// Which rows count, and how much they say beside the priors.
#[derive(Clone, Debug)]
pub(super) struct Weighing {
    pub rows: Vec<usize>,
    /// Residual (m) that weighs as much as a standard deviation of a prior.
    pub error: f64,
}

/// Where each row was last at rest, with its residuals there; none before it has settled.
pub(super) type Memory = Vec<Option<Settled>>;

#[derive(Clone, Debug)]
pub(super) struct Settled {
    pub(super) configuration: Configuration,
    pub(super) residuals: RowResiduals,
}

/// Residuals of a row, or their changes.
#[derive(Clone, Debug)]
pub(super) struct RowResiduals {
    /// Of each marker that was seen, its vector (m).
    pub markers: Vec<Vector3<f64>>,
    /// Of each point of the cloud, its distance (m).
    pub distances: Vec<f64>,
}

/// Where a settled robot is in a row.
pub(super) struct Sight {
    /// The markers that were seen.
    seen: Vec<usize>,
    /// These, then the discs' [`corners`].
    pub points: Vec<DiscPoint>,
    /// The places nearest to the points of the cloud.
    touches: Vec<Touch>,
    residuals: RowResiduals,
}

/// The model at some values of the unknowns.
pub(super) struct Model {
    pub robot: Robot,
    pub transmission: Transmission,
    pub commands: Vec<Vec<f64>>,
}

impl<'a> Problem<'a> {
    /// The specification and the transmission at `x`.
    pub fn values(&self, x: &DVector<f64>) -> (RobotSpec, Transmission) {
        let (mut spec, mut transmission) = (self.explicit.spec.clone(), self.transmission.clone());
        let mut numbers = Numbers {
            explicit: self.explicit,
            spec: &mut spec,
            transmission: &mut transmission,
        };
        for (unknown, &x) in self.unknowns.iter().zip(x) {
            unknown.set(x, &mut numbers);
        }
        (spec, transmission)
    }

    /// The model at `x`, its commands for all rows.
    pub fn model(&self, x: &DVector<f64>) -> Result<Model, RecordingError> {
        let (mut spec, transmission) = self.values(x);
        for route in &mut spec.routes {
            // Whatever the recording commands: ranges are for users.
            route.tendon.range = [0.0, 1e6];
        }
        let robot = Robot::new(spec)?;
        let commands = transmission.commands_at(&robot, self.recording, &self.speeds);
        Ok(Model {
            robot,
            transmission,
            commands,
        })
    }

    pub fn limits(&self) -> Vec<Limit> {
        let limits = self.unknowns.iter().map(|unknown| unknown.sought.limit());
        limits.collect()
    }

    /// Weighted residuals (m) of the measured coordinates, then one row for each prior, with their Jacobian by the
    /// coordinates; none where there is no such robot. A row that does not settle keeps its last residual, and does not change.
    pub fn evaluate(
        &self,
        x: &DVector<f64>,
        weighing: &Weighing,
        memory: &Memory,
    ) -> Option<Evaluation<Memory>> {
        let here = self.model(x).ok()?;
        let changed: Option<Vec<Model>> = (0..self.unknowns.len())
            .into_par_iter()
            .map(|i| {
                let mut beside = x.clone();
                beside[i] += STEP;
                let mut model = self.model(&beside).ok()?;
                if !self.unknowns[i].is_of_robot() {
                    model.robot = here.robot.clone();
                }
                Some(model)
            })
            .collect();
        let changed = changed?;
        let parts = match self.friction {
            true => {
                let mut all: Vec<Option<Part>> = self
                    .paths(&here, &changed, memory)
                    .into_iter()
                    .map(Some)
                    .collect();
                let counted = weighing.rows.iter();
                counted.filter_map(|&row| all[row].take()).collect()
            }
            false => self.rows(&here, &changed, weighing, memory),
        };
        let counted: usize = parts.iter().map(|part| part.residuals.len()).sum();
        let n = self.unknowns.len();
        let mut residuals = DVector::zeros(counted + n);
        let mut jacobian = DMatrix::zeros(counted + n, n);
        let mut memory = memory.clone();
        let mut at = 0;
        for (&row, part) in weighing.rows.iter().zip(parts) {
            let rows = part.residuals.len();
            residuals.rows_mut(at, rows).copy_from(&part.residuals);
            jacobian.rows_mut(at, rows).copy_from(&part.jacobian);
            memory[row] = part.settled;
            at += rows;
        }
        for i in 0..n {
            residuals[at + i] = weighing.error * x[i];
            jacobian[(at + i, i)] = weighing.error;
        }
        Some(Evaluation {
            residuals,
            jacobian,
            memory,
        })
    }

    /// What rows that are equilibria by themselves say.
    fn rows(
        &self,
        here: &Model,
        changed: &[Model],
        weighing: &Weighing,
        memory: &Memory,
    ) -> Vec<Part> {
        (weighing.rows.par_iter())
            .map_init(
                || (Settler::new(&here.robot), Changed::new(&here.robot)),
                |(settler, storage), &row| {
                    self.row(here, changed, row, memory[row].as_ref(), settler, storage)
                },
            )
            .collect()
    }

    /// The markers that were seen in a row.
    pub fn seen(&self, row: usize) -> Vec<usize> {
        let measured = &self.recording.points[row];
        let markers = 0..measured.len();
        markers.filter(|&m| measured[m].is_some()).collect()
    }

    /// Number of markers and points that were measured in some rows.
    pub fn measured(&self, rows: &[usize]) -> usize {
        let of_row = |&row: &usize| self.seen(row).len() + self.recording.cloud(row).len();
        rows.iter().map(of_row).sum()
    }

    /// A row that does not settle: its last residual, which does not change.
    pub fn stale(&self, row: usize, last: Option<&Settled>) -> Part {
        let coordinates = 3 * self.seen(row).len() + self.recording.cloud(row).len();
        Part {
            residuals: last.map_or_else(
                || DVector::zeros(coordinates),
                |last| self.weighted(&last.residuals, None),
            ),
            jacobian: DMatrix::zeros(coordinates, self.unknowns.len()),
            settled: last.cloned(),
        }
    }

    /// What is seen of a settled robot, with its residuals.
    pub fn sight(&self, here: &Model, row: usize, settled: &Equilibrium) -> Sight {
        let measured = &self.recording.points[row];
        let seen = self.seen(row);
        let mut points = markers(&here.transmission, &seen);
        let vectors = (seen.iter().zip(&points))
            .map(|(&m, point)| place(settled, point) - measured[m].unwrap_or_default());
        let cloud = self.recording.cloud(row);
        let touches = match cloud {
            [] => Vec::new(),
            cloud => Surface::new(&here.robot, &self.recording.shown, settled).touches(
                &here.robot,
                settled,
                cloud,
            ),
        };
        let residuals = RowResiduals {
            markers: vectors.collect(),
            distances: touches.iter().map(|touch| touch.distance).collect(),
        };
        points.extend(corners(here.robot.discs().len(), cloud.len()));
        Sight {
            seen,
            points,
            touches,
            residuals,
        }
    }

    /// A row by what is seen in it, and by what each unknown moves its points by (m) over a step.
    pub fn part(
        &self,
        Place { row, last }: Place<'_>,
        here: &Model,
        changed: &[Model],
        sight: Sight,
        moved: Vec<Vec<Vector3<f64>>>,
        configuration: Configuration,
    ) -> Part {
        let coordinates = 3 * sight.seen.len() + sight.touches.len();
        let mut jacobian = DMatrix::zeros(coordinates, self.unknowns.len());
        for (i, (mut moved, changed)) in moved.into_iter().zip(changed).enumerate() {
            moved.iter_mut().for_each(|point| *point /= STEP);
            let corners = moved.split_off(sight.seen.len());
            let growth =
                |touch: &Touch| touch.growth(&corners, STEP, [&here.robot, &changed.robot]);
            let slopes = RowResiduals {
                markers: moved,
                distances: sight.touches.iter().map(growth).collect(),
            };
            jacobian.set_column(i, &self.weighted(&slopes, Some(&sight.residuals)));
        }
        if jacobian.iter().any(|x| !x.is_finite()) {
            return self.stale(row, last);
        }
        Part {
            residuals: self.weighted(&sight.residuals, None),
            jacobian,
            settled: Some(Settled {
                configuration,
                residuals: sight.residuals,
            }),
        }
    }

    /// The residuals of one row.
    fn row(
        &self,
        here: &Model,
        changed: &[Model],
        row: usize,
        last: Option<&Settled>,
        settler: &mut Settler,
        storage: &mut Changed,
    ) -> Part {
        if (self.stop)() {
            return self.stale(row, last);
        }
        let loads = self.recording.loads(row);
        let Ok(command) = here.robot.command(&here.commands[row]) else {
            return self.stale(row, last);
        };
        let settled = match last {
            Some(last) => settler.settle_from(&last.configuration, &command, &loads),
            None => settler.settle(&command, &loads),
        };
        let sensitivity = here.robot.sensitivity(&command, &loads, settled);
        let (settled, Ok(sensitivity)) = (settled.clone(), sensitivity) else {
            return self.stale(row, last);
        };
        let sight = self.sight(here, row, &settled);
        let mut moved = vec![vec![Vector3::zeros(); sight.points.len()]; changed.len()];
        for (moved, changed) in moved.iter_mut().zip(changed) {
            let pairs: Vec<(DiscPoint, DiscPoint)> = (sight.points.iter().copied())
                .zip(sight.towards(changed))
                .collect();
            let commands = &changed.commands[row];
            sensitivity.towards(&changed.robot, commands, &pairs, storage, moved);
        }
        let at = Place { row, last };
        self.part(at, here, changed, sight, moved, settled.configuration)
    }

    /// Residuals whose squares are the pseudo-Huber loss `2 s² (sqrt(1 + |e|²/s²) - 1)` of the residuals `e` (Hartley and Zisserman, Multiple
    /// View Geometry, A6.8); or their derivatives along `change` where residuals are given.
    fn weighted(&self, change: &RowResiduals, residuals: Option<&RowResiduals>) -> DVector<f64> {
        let (vectors, distances) = (&change.markers, &change.distances);
        let mut all = DVector::zeros(3 * vectors.len() + distances.len());
        for (k, vector) in vectors.iter().enumerate() {
            let residual = residuals.map_or(vector, |residuals| &residuals.markers[k]);
            let (weight, slope) = self.weight(residual.norm());
            let out = match residuals {
                None => vector * weight,
                Some(_) => vector * weight + residual * (slope * residual.dot(vector)),
            };
            all.fixed_rows_mut::<3>(3 * k).copy_from(&out);
        }
        for (k, &distance) in distances.iter().enumerate() {
            let residual = residuals.map_or(distance, |residuals| residuals.distances[k]);
            let (weight, slope) = self.weight(residual.abs());
            all[3 * vectors.len() + k] = match residuals {
                None => distance * weight,
                Some(_) => distance * (weight + slope * residual * residual),
            };
        }
        all
    }

    /// What a residual of length `n` is multiplied by, and that factor's derivative by `n` over `n`.
    fn weight(&self, n: f64) -> (f64, f64) {
        let s = self.loss;
        let ratio = n / s;
        if !s.is_finite() || ratio < 1e-4 {
            return (1.0, 0.0);
        }
        let root = (1.0 + ratio * ratio).sqrt();
        let square = 2.0 * s * s * (root - 1.0);
        let weight = square.sqrt() / n;
        // d(rho)/dn = 2 n / root.
        let slope = (2.0 * n / root / (2.0 * square.sqrt()) - weight) / n;
        (weight, slope / n)
    }
}

/// The markers of a transmission that were seen.
fn markers(transmission: &Transmission, seen: &[usize]) -> Vec<DiscPoint> {
    let points = seen.iter().map(|&m| transmission.markers[m].point());
    points.collect()
}

impl Sight {
    /// Its points, those on discs where they are in a changed model.
    pub fn towards(&self, changed: &Model) -> Vec<DiscPoint> {
        let mut points = markers(&changed.transmission, &self.seen);
        points.extend_from_slice(&self.points[self.seen.len()..]);
        points
    }
}

/// Where a point of a settled robot is (m).
pub(super) fn place(settled: &Equilibrium, point: &DiscPoint) -> Vector3<f64> {
    settled.positions[point.disc] + settled.orientations[point.disc] * point.place
}

/// A row, and where it was last at rest.
pub(super) struct Place<'a> {
    pub row: usize,
    pub last: Option<&'a Settled>,
}

pub(super) struct Part {
    residuals: DVector<f64>,
    jacobian: DMatrix<f64>,
    settled: Option<Settled>,
}
