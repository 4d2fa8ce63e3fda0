//! One step of the tip, within all bounds.

use nalgebra::{DMatrix, DVector, Matrix3xX, Vector3};
use tdcr_sim::robot::{CommandUnit, Robot};
use thiserror::Error;

use super::ControlError;
use crate::quadratic::QuadraticProgram;

/// What commands must keep.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// Smallest command of each tendon (m or N).
    pub low: Vec<f64>,
    /// Largest command of each tendon (m or N).
    pub high: Vec<f64>,
    /// Largest change of each tendon's command in a period (m or N).
    pub step: Vec<f64>,
    /// Smallest and largest tension of any tendon (N). Where a tendon is beyond, commands lead back or keep it there; what a disturbance
    /// does to it between commands is not foreseen.
    pub tension: [f64; 2],
    /// The command that is preferred among those that do the same (m or N).
    pub preferred: Vec<f64>,
}

/// Why limits make no sense.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum LimitsError {
    /// A rate that is no rate.
    #[error("the rate is {value} {unit}/s; expected a finite number above 0")]
    Rate {
        /// The rate.
        value: f64,
        /// Unit of the commands.
        unit: CommandUnit,
    },
    /// Tensions out of order.
    #[error("tensions of {low} to {high} N; expected the smaller one first")]
    Tension {
        /// The smallest.
        low: f64,
        /// The largest.
        high: f64,
    },
}

/// Share of a tendon's range that its command may change by in a second where nothing else is asked for.
const RATE: f64 = 0.5;

impl Limits {
    /// The ranges of a robot's tendons, whose middle is preferred. `rate` is the largest change of a command in a second (m/s or N/s; half a tendon's range where
    /// it is `None`), `tension` the smallest and largest tension (N).
    ///
    /// # Errors
    /// [`LimitsError`].
    pub fn new(
        robot: &Robot,
        period: f64,
        rate: Option<f64>,
        tension: [f64; 2],
    ) -> Result<Self, LimitsError> {
        let [low, high] = tension;
        if low.is_nan() || high.is_nan() || low >= high {
            return Err(LimitsError::Tension { low, high });
        }
        let tendons = robot.tendons();
        if let (Some(value), Some(tendon)) = (rate, tendons.first())
            && !(value.is_finite() && value > 0.0)
        {
            let unit = tendon.unit();
            return Err(LimitsError::Rate { value, unit });
        }
        let rate = |range: [f64; 2]| rate.unwrap_or(RATE * (range[1] - range[0]));
        Ok(Self {
            low: tendons.iter().map(|tendon| tendon.range[0]).collect(),
            high: tendons.iter().map(|tendon| tendon.range[1]).collect(),
            step: (tendons.iter())
                .map(|tendon| period * rate(tendon.range))
                .collect(),
            tension,
            preferred: (tendons.iter())
                .map(|tendon| (tendon.range[0] + tendon.range[1]) / 2.0)
                .collect(),
        })
    }

    /// The smallest and the largest command of each tendon in the next period, after `command`.
    pub fn next(&self, command: &[f64]) -> [Vec<f64>; 2] {
        let bound = |t: usize, sign: f64| {
            let step = command[t] + sign * self.step[t];
            step.clamp(self.low[t], self.high[t])
        };
        [-1.0, 1.0].map(|sign| (0..command.len()).map(|t| bound(t, sign)).collect())
    }

    /// `proposed` within the bounds of the period after `command`; a number that is not finite becomes the last one.
    pub fn admit(&self, command: &[f64], proposed: Vec<f64>) -> Vec<f64> {
        if proposed.len() != command.len() {
            return command.to_vec();
        }
        let [low, high] = self.next(command);
        let admit = |(t, value): (usize, f64)| match value.is_finite() {
            true => value.clamp(low[t], high[t]),
            false => command[t],
        };
        proposed.into_iter().enumerate().map(admit).collect()
    }

    /// Width of a tendon's range (m or N).
    pub fn width(&self, tendon: usize) -> f64 {
        self.high[tendon] - self.low[tendon]
    }
}

/// How the parts of a step are weighed: of a command in units of its range, of the tip in units of the robot's length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepWeights {
    /// Damping of the command's change: keeps it small where the tip hardly follows (Nakamura and Hanafusa, J. Dyn. Sys. Meas.
    /// Control 108, 1986).
    pub damping: f64,
    /// Pull towards the preferred command, along what the tip does not feel: keeps co-contraction.
    pub posture: f64,
}

impl Default for StepWeights {
    fn default() -> Self {
        Self {
            damping: 1e-4,
            posture: 3e-6,
        }
    }
}

/// The change of a command that moves the tip by what is wanted, within bounds:
/// `min |J d - w|² / l² + damping |d|² + posture |u + d - u_p|²` over changes `d` within the bounds of commands and tensions, commands in
/// units of their ranges and `l` the robot's length.
pub struct TipStep<'a> {
    /// Jacobian of the tip by the command (m per m or N).
    pub jacobian: &'a Matrix3xX<f64>,
    /// What the tip is to move by (m).
    pub wanted: Vector3<f64>,
    /// The robot's length (m).
    pub length: f64,
    /// The command (m or N).
    pub command: &'a [f64],
    /// Smallest and largest command of this step (m or N), around the command.
    pub bounds: &'a [Vec<f64>; 2],
    /// The command that is preferred (m or N).
    pub preferred: &'a [f64],
    /// Tensions (N), their Jacobian by the command, and their bounds.
    pub tensions: Option<(&'a [f64], &'a DMatrix<f64>, [f64; 2])>,
    /// Width of each tendon's range (m or N).
    pub widths: &'a [f64],
    /// How the parts are weighed.
    pub weights: StepWeights,
}

/// What a step was solved to.
pub struct Stepped {
    /// The next command (m or N).
    pub command: Vec<f64>,
    /// Whether bounds keep the tip from where it is wanted.
    pub is_held_back: bool,
}

/// Part of the wanted motion that counts as held back where bounds take it away.
const HELD_BACK: f64 = 0.1;

impl TipStep<'_> {
    /// The best change.
    ///
    /// # Errors
    /// [`ControlError::NotFinite`] for numbers that are not finite.
    pub fn solve(&self) -> Result<Stepped, ControlError> {
        let n = self.command.len();
        let scaled = Matrix3xX::from_fn(n, |row, t| {
            self.jacobian[(row, t)] * self.widths[t] / self.length
        });
        let off = DVector::from_fn(n, |t, _| {
            (self.command[t] - self.preferred[t]) / self.widths[t]
        });
        let mut hessian = scaled.transpose() * &scaled;
        for t in 0..n {
            hessian[(t, t)] += self.weights.damping + self.weights.posture;
        }
        let gradient = off * self.weights.posture - scaled.tr_mul(&(self.wanted / self.length));
        let (rows, bounds) = self.constraints();
        let program = QuadraticProgram {
            hessian: DMatrix::from_fn(n, n, |i, j| hessian[(i, j)]),
            gradient: DVector::from_fn(n, |t, _| gradient[t]),
            rows,
            bounds,
        };
        let solved = program.solve();
        let solved = solved.ok_or_else(|| ControlError::NotFinite(self.command.to_vec()))?;
        let moved = &scaled * &solved.x * self.length;
        let left = (self.wanted - moved).norm();
        let next = |t: usize| {
            let value = self.command[t] + solved.x[t] * self.widths[t];
            value.clamp(self.bounds[0][t], self.bounds[1][t])
        };
        Ok(Stepped {
            command: (0..n).map(next).collect(),
            is_held_back: !solved.active.is_empty() && left > HELD_BACK * self.wanted.norm(),
        })
    }

    /// Rows and bounds: a tendon's command up and down, then tensions up and down.
    fn constraints(&self) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.command.len();
        let tensions = self.tensions.map_or(0, |(tensions, ..)| tensions.len());
        let mut rows = DMatrix::zeros(2 * (n + tensions), n);
        let mut bounds = DVector::zeros(2 * (n + tensions));
        for t in 0..n {
            let room = [0, 1].map(|end| (self.bounds[end][t] - self.command[t]) / self.widths[t]);
            (rows[(2 * t, t)], bounds[2 * t]) = (1.0, room[1]);
            (rows[(2 * t + 1, t)], bounds[2 * t + 1]) = (-1.0, -room[0]);
        }
        if let Some((now, slopes, [low, high])) = self.tensions {
            for (t, &tension) in now.iter().enumerate() {
                let row = 2 * (n + t);
                for column in 0..n {
                    let slope = slopes[(t, column)] * self.widths[column];
                    (rows[(row, column)], rows[(row + 1, column)]) = (slope, -slope);
                }
                // A bound that is no number of newtons away is none.
                let far = 1e9;
                bounds[row] = (high - tension).min(far);
                bounds[row + 1] = (tension - low).min(far);
            }
        }
        (rows, bounds)
    }
}
