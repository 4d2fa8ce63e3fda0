//! Quadratic programs over the commands of a horizon.

use nalgebra::{DMatrix, DMatrixView, DVector, Vector3};

use super::inverse::{length, widths};
use super::{ControlError, Moment, StepWeights};
use crate::quadratic::QuadraticProgram;

/// The commands to improve on: the last plan moved on by a period, or the last command where there is no plan that led to it.
pub(super) fn moved_on(plan: &[Vec<f64>], command: &[f64], horizon: usize) -> Vec<Vec<f64>> {
    let horizon = horizon.max(1);
    match plan {
        [first, rest @ ..] if first == command && plan.len() == horizon => {
            let last = &plan[horizon - 1];
            rest.iter().chain([last]).cloned().collect()
        }
        _ => vec![command.to_vec(); horizon],
    }
}

/// What a plan leads to, to first order: tip and tensions at each of its stages, by all of its commands.
pub(super) struct Prediction {
    /// By what the tip is to move (m), three rows a stage.
    pub wanted: DVector<f64>,
    /// By what it moves with each command (m per m or N), a column for each tendon and stage.
    pub tip: DMatrix<f64>,
    /// Tensions (N), a row for each tendon and stage.
    pub tensions: DVector<f64>,
    /// By what they change with each command (N per m or N).
    pub slopes: DMatrix<f64>,
}

/// One stage of a [`Prediction`] that is being written.
pub(super) struct Stage<'p> {
    prediction: &'p mut Prediction,
    place: usize,
}

impl Prediction {
    /// Of so many stages and tendons, nothing in it.
    pub fn new(stages: usize, tendons: usize) -> Self {
        let size = stages * tendons;
        Self {
            wanted: DVector::zeros(3 * stages),
            tip: DMatrix::zeros(3 * stages, size),
            tensions: DVector::zeros(size),
            slopes: DMatrix::zeros(size, size),
        }
    }

    /// The stage after the command `place`.
    pub fn stage(&mut self, place: usize) -> Stage<'_> {
        Stage {
            prediction: self,
            place,
        }
    }
}

impl Stage<'_> {
    /// By what the tip is to move (m).
    pub fn wanted(&mut self, wanted: Vector3<f64>) {
        let mut rows = self.prediction.wanted.fixed_rows_mut::<3>(3 * self.place);
        rows.copy_from(&wanted);
    }

    /// By what the tip moves with command `command` of the plan (m per m or N).
    pub fn tip_by(&mut self, command: usize, jacobian: DMatrixView<'_, f64>) {
        let at = (3 * self.place, command * jacobian.ncols());
        let mut block = self.prediction.tip.view_mut(at, jacobian.shape());
        block.copy_from(&jacobian);
    }

    /// The tensions (N).
    pub fn tensions(&mut self, tensions: &[f64]) {
        let first = self.place * tensions.len();
        let mut rows = (self.prediction.tensions).rows_mut(first, tensions.len());
        rows.copy_from_slice(tensions);
    }

    /// By what the tensions change with command `command` of the plan (N per m or N).
    pub fn tensions_by(&mut self, command: usize, slopes: DMatrixView<'_, f64>) {
        let tendons = slopes.nrows();
        let at = (self.place * tendons, command * tendons);
        let mut block = self.prediction.slopes.view_mut(at, slopes.shape());
        block.copy_from(&slopes);
    }
}

/// The program over the horizon:
/// `min Σ |e_i|² / l² + error_rate |e_i - e_(i-1)|² / l² + damping |u_i - u_(i-1)|² + posture |u_i - u_p|²` within the bounds of commands, rates and tensions. Its
/// variables are the plan's changes in units of the tendons' ranges, stage by stage.
pub(super) struct Horizon<'a> {
    /// What the plan leads to.
    pub prediction: Prediction,
    /// The commands to improve on.
    pub plan: &'a [Vec<f64>],
    /// How the parts are weighed.
    pub weights: StepWeights,
    /// Weight of the change of the error `e = p - r` from stage to stage.
    pub error_rate: f64,
}

impl Horizon<'_> {
    /// The improved plan; its first command is within the bounds of the period after the moment's.
    ///
    /// # Errors
    /// [`ControlError::NotFinite`] for numbers that are not finite.
    pub fn improve(&self, moment: &Moment<'_>) -> Result<Vec<Vec<f64>>, ControlError> {
        let widths = widths(moment);
        let (hessian, gradient) = self.objective(moment, &widths);
        let (rows, bounds) = self.constraints(moment, &widths);
        let program = QuadraticProgram {
            hessian,
            gradient,
            rows,
            bounds,
        };
        let solved = program.solve();
        let x = solved
            .ok_or_else(|| ControlError::NotFinite(self.plan[0].clone()))?
            .x;
        let n = widths.len();
        let [low, high] = moment.limits.next(moment.command);
        let changed = |(i, command): (usize, &Vec<f64>)| {
            let value = |t: usize| {
                let value = command[t] + x[i * n + t] * widths[t];
                match i {
                    0 => value.clamp(low[t], high[t]),
                    _ => value.clamp(moment.limits.low[t], moment.limits.high[t]),
                }
            };
            (0..n).map(value).collect()
        };
        Ok(self.plan.iter().enumerate().map(changed).collect())
    }

    fn objective(&self, moment: &Moment<'_>, widths: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let (n, length) = (widths.len(), length(moment.estimated));
        let mut scaled = self.prediction.tip.clone();
        for (column, mut jacobian) in scaled.column_iter_mut().enumerate() {
            jacobian *= widths[column % n] / length;
        }
        let wanted = &self.prediction.wanted / length;
        let mut hessian = scaled.tr_mul(&scaled);
        let mut gradient = -scaled.tr_mul(&wanted);
        if self.error_rate > 0.0 {
            let later = scaled.nrows() - 3;
            let changes = scaled.rows(3, later) - scaled.rows(0, later);
            hessian += changes.tr_mul(&changes) * self.error_rate;
            gradient -=
                changes.tr_mul(&(wanted.rows(3, later) - wanted.rows(0, later))) * self.error_rate;
        }
        let StepWeights { damping, posture } = self.weights;
        let preferred = &moment.limits.preferred;
        for (i, command) in self.plan.iter().enumerate() {
            for t in 0..n {
                let (at, here) = (i * n + t, command[t]);
                hessian[(at, at)] += posture + damping;
                gradient[at] += posture * (here - preferred[t]) / widths[t];
                // The change from the stage before, of which the first is given.
                let last = i
                    .checked_sub(1)
                    .map_or(moment.command[t], |last| self.plan[last][t]);
                let change = damping * (here - last) / widths[t];
                gradient[at] += change;
                if i > 0 {
                    let earlier = at - n;
                    hessian[(earlier, earlier)] += damping;
                    hessian[(at, earlier)] -= damping;
                    hessian[(earlier, at)] -= damping;
                    gradient[earlier] -= change;
                }
            }
        }
        (hessian, gradient)
    }

    /// Rows and bounds: for each stage and tendon its command up and down, its change up and down, its tension up and down.
    fn constraints(&self, moment: &Moment<'_>, widths: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let (n, limits) = (widths.len(), moment.limits);
        let size = n * self.plan.len();
        let mut rows = DMatrix::zeros(6 * size, size);
        let mut bounds = DVector::zeros(6 * size);
        for (i, command) in self.plan.iter().enumerate() {
            let before = i
                .checked_sub(1)
                .map_or(moment.command, |last| &self.plan[last]);
            for (t, (&here, &before)) in command.iter().zip(before).enumerate() {
                let (at, width) = (i * n + t, widths[t]);
                let change = here - before;
                let tension = self.prediction.tensions[at];
                let room = [
                    (limits.high[t] - here) / width,
                    (here - limits.low[t]) / width,
                    (limits.step[t] - change) / width,
                    (limits.step[t] + change) / width,
                    (limits.tension[1] - tension).min(1e9),
                    (tension - limits.tension[0]).min(1e9),
                ];
                for (k, room) in room.into_iter().enumerate() {
                    let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                    let row = 6 * at + k;
                    bounds[row] = room;
                    if k < 4 {
                        rows[(row, at)] = sign;
                    }
                    if (2..4).contains(&k) && i > 0 {
                        rows[(row, at - n)] = -sign;
                    }
                    for column in (0..size).filter(|_| k >= 4) {
                        let slope = self.prediction.slopes[(at, column)];
                        rows[(row, column)] = sign * slope * widths[column % n];
                    }
                }
            }
        }
        (rows, bounds)
    }
}
