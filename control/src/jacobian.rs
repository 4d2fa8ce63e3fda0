//! What the tip's Jacobian has beside the model's, told from how the tip followed its commands.
//!
//! An obstacle that the model does not have, or tendons that stick, change how the tip answers a command more than where it is. From one
//! period to the next the tip moves by `dp = (J + D) du + noise`, `J du` the model's step, and `D` is corrected by what `J` and `D` leave of `dp`, as
//! model-less control of continuum robots does with the whole Jacobian (Yip and Camarillo, IEEE Trans. Robotics 30, 2014). The rows of `D` are
//! Gauss-Markov processes of first order about 0, taken in by a Kalman filter (Qian and Su, Online estimation of image Jacobian matrix by
//! Kalman-Bucy filter, American Control Conference 2002): with the covariance `P` of a row,
//! `D <- D + (dp - (J + D) du) du' P / (du' P du + 2 s²)`. Without noise and with `P = I` that is Broyden's update, the smallest change that explains the
//! step; where a command hardly moves, noise counts for more and `D` stays; and what is not seen again is forgotten.

use std::collections::VecDeque;

use nalgebra::{DMatrix, DVector, Matrix3xX, Vector3};

use crate::belief::Belief;

/// Standard deviation of an entry of `D` before anything was seen: in parts of the robot's length by parts of a tendon's range.
const DEVIATION: f64 = 0.15;
/// Time in which `D` is forgotten to the factor e (s).
const FORGOTTEN: f64 = 5.0;
/// Time over which steps are summed to tell whether the tip follows the model (s), and for which it must not.
const SPAN: f64 = 1.0;
/// Share of the larger of both motions by which they differ where the tip does not follow the model.
const MISMATCH: f64 = 0.5;
/// Deviations of a step above which it is a jump.
const JUMP: f64 = 10.0;
/// Deviations of a coordinate of the tip above which a motion is one.
const MOTION: f64 = 10.0;

/// Observes `D` period by period.
#[derive(Clone, Debug)]
pub(crate) struct JacobianObserver {
    /// `D` in m per m or N.
    correction: Matrix3xX<f64>,
    /// `D` in parts of the length by parts of the tendons' ranges, and the covariance of each of its rows.
    scaled: Matrix3xX<f64>,
    covariance: DMatrix<f64>,
    /// Widths of the tendons' ranges (m or N), the robot's length and the standard deviation of a coordinate of the tip (m).
    widths: Vec<f64>,
    length: f64,
    noise: f64,
    /// The command that acted and where the tip was, a period ago.
    last: Option<(Vec<f64>, Vector3<f64>)>,
    /// The tip's and the model's steps in the last [`SPAN`] (m), the oldest first.
    steps: VecDeque<[Vector3<f64>; 2]>,
    /// Periods for which the tip has not followed the model.
    mismatched: usize,
}

impl JacobianObserver {
    /// Of tendons whose ranges are `widths` (m or N) wide, a robot of `length` (m), and a tip measured with `noise` (m).
    pub fn new(widths: Vec<f64>, length: f64, noise: f64) -> Self {
        let tendons = widths.len();
        let covariance = DMatrix::from_diagonal_element(tendons, tendons, DEVIATION.powi(2));
        Self {
            correction: Matrix3xX::zeros(tendons),
            scaled: Matrix3xX::zeros(tendons),
            covariance,
            widths,
            length,
            noise,
            last: None,
            steps: VecDeque::new(),
            mismatched: 0,
        }
    }

    /// `D` (m per m or N).
    pub fn correction(&self) -> &Matrix3xX<f64> {
        &self.correction
    }

    /// Forgets all: what was seen was taken for answers to other commands than it was of.
    pub fn forget(&mut self) {
        *self = Self::new(self.widths.clone(), self.length, self.noise);
    }

    /// Takes in where the tip was measured under the command `acting` (m or N), a `period` (s) after the last time. Whether the tip has by now, and
    /// not in the period before, gone otherwise than the model for a while.
    pub fn see(
        &mut self,
        model: &mut Belief,
        acting: &[f64],
        tip: Option<Vector3<f64>>,
        period: f64,
    ) -> bool {
        let now = tip.map(|tip| (acting.to_vec(), tip));
        let before = std::mem::replace(&mut self.last, now);
        let (Some(tip), Some((command, tip_before))) = (tip, before) else {
            self.steps.clear();
            return false;
        };
        // Of the model as it is now: what was estimated since is no motion.
        let Ok(expected) = model.moved(&command, acting) else {
            return false;
        };
        let step = tip - tip_before;
        self.correct(acting, &command, step - expected, period);
        self.compare([step, expected], period)
    }

    /// The Kalman update by what the model's step leaves of the tip's (m).
    fn correct(&mut self, acting: &[f64], command: &[f64], left: Vector3<f64>, period: f64) {
        let tendons = self.widths.len();
        let kept = (-period / FORGOTTEN).exp();
        self.scaled *= kept;
        self.covariance *= kept * kept;
        for t in 0..tendons {
            self.covariance[(t, t)] += (1.0 - kept * kept) * DEVIATION.powi(2);
        }
        let change = DVector::from_fn(tendons, |t, _| (acting[t] - command[t]) / self.widths[t]);
        let spread = &self.covariance * &change;
        let noise = self.noise / self.length;
        let variance = change.dot(&spread) + 2.0 * noise * noise;
        if variance > 0.0 {
            let surprise = left / self.length - &self.scaled * &change;
            // A tip that snaps free of an obstacle is no answer to a command: it counts as much less as it is further.
            let variance = variance.max(surprise.norm_squared() / JUMP.powi(2));
            self.scaled += surprise * spread.transpose() / variance;
            self.covariance -= &spread * spread.transpose() / variance;
        }
        for (t, width) in self.widths.iter().enumerate() {
            let column = self.scaled.column(t) * (self.length / width);
            self.correction.set_column(t, &column);
        }
    }

    /// Whether the motions of tip and model have differed for [`SPAN`] as of this period.
    fn compare(&mut self, steps: [Vector3<f64>; 2], period: f64) -> bool {
        let span = (SPAN / period).ceil().max(1.0) as usize;
        self.steps.push_back(steps);
        if self.steps.len() > span {
            self.steps.pop_front();
        }
        let [tip, model] =
            [0, 1].map(|of| self.steps.iter().map(|both| both[of]).sum::<Vector3<f64>>());
        let far = tip.norm().max(model.norm());
        let is_mismatch = far > MOTION * self.noise && (tip - model).norm() > MISMATCH * far;
        self.mismatched = if is_mismatch { self.mismatched + 1 } else { 0 };
        self.mismatched == span
    }
}
