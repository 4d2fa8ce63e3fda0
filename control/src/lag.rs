//! After how many periods the tip follows a command.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};

/// The delay between a command and when the tendons get it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delay {
    /// So many periods.
    Known(usize),
    /// Told from how the tip follows its commands: at most so many periods.
    Estimated {
        /// The longest delay that is looked for.
        most: usize,
    },
}

impl Delay {
    /// The longest delay that it can be (periods).
    pub fn most(self) -> usize {
        match self {
            Self::Known(periods) => periods,
            Self::Estimated { most } => most,
        }
    }
}

/// Share of the sums of squares that is kept in a period.
const KEPT: f64 = 0.99;
/// A delay takes the place of another where it leaves less than this share of the other's squares.
const BETTER: f64 = 0.3;
/// Periods for which a delay must be better by a fit of the model's steps.
const SURE: usize = 10;

/// Which delay is the true one, by the squares that each leaves.
#[derive(Clone, Debug)]
pub(crate) struct DelayChoice {
    now: usize,
    /// For each delay that it may be, the sum of squares (m²).
    left: Vec<f64>,
    may_change: bool,
    /// The delay that was the better one of late, and for how many periods.
    lasted: (usize, usize),
}

impl DelayChoice {
    pub fn new(delay: Delay) -> Self {
        let (now, may_change) = match delay {
            Delay::Known(periods) => (periods, false),
            Delay::Estimated { .. } => (0, true),
        };
        Self {
            now,
            left: vec![0.0; delay.most() + 1],
            may_change,
            lasted: (now, 0),
        }
    }

    /// The delay in periods, as far as is known.
    pub fn periods(&self) -> usize {
        self.now
    }

    /// Takes in what each delay leaves in this period (m²), the shortest delay's first; older periods count less.
    pub fn weigh(&mut self, squares: impl IntoIterator<Item = f64>) {
        if !self.may_change {
            return;
        }
        for (left, square) in self.left.iter_mut().zip(squares) {
            *left = KEPT * *left + square;
        }
        if let Some(better) = self.better() {
            self.now = better;
        }
    }

    /// Takes in what each delay leaves of all periods so far, the shortest delay's first: for the model's steps as they are, and as they can be made to
    /// fit best (m²). A delay that is better only by the latter must be so for a while.
    fn compare(&mut self, plain: &[f64], fitted: Vec<f64>) {
        if !self.may_change {
            return;
        }
        self.left = fitted;
        let Some(better) = self.better() else {
            self.lasted = (self.now, 0);
            return;
        };
        let (last, lasted) = self.lasted;
        self.lasted = (better, if last == better { lasted + 1 } else { 1 });
        let is_plain = plain[better] < BETTER * self.left[self.now];
        if is_plain || self.lasted.1 >= SURE {
            self.now = better;
        }
    }

    /// The delay that leaves so much less than the present one as to take its place.
    fn better(&self) -> Option<usize> {
        let best = (0..self.left.len()).min_by(|&a, &b| self.left[a].total_cmp(&self.left[b]));
        best.filter(|&best| self.left[best] < BETTER * self.left[self.now])
    }
}

/// Tells the delay `d` from the tip's steps, the robot at rest at every period: that which leaves the least of
/// `min_A Σ |p_k - p_(k-1) - A (m_(k-1-d) - m_(k-2-d))|²`, `p_k` the tip as measured at period `k`, `m_k` the model's under the command given then, and `A` any
/// symmetric matrix: a robot that something keeps from moving as far as the model has it is not late.
#[derive(Clone, Debug)]
pub(crate) struct Lag {
    choice: DelayChoice,
    /// For each delay that it may be, how the tip's steps go with the model's.
    fits: Vec<Fit>,
    /// Of the model's tip: its steps by the last commands, the newest first (m).
    steps: VecDeque<Vector3<f64>>,
    last_tip: Option<Vector3<f64>>,
}

impl Lag {
    pub fn new(delay: Delay) -> Self {
        Self {
            choice: DelayChoice::new(delay),
            fits: vec![Fit::default(); delay.most() + 1],
            steps: VecDeque::new(),
            last_tip: None,
        }
    }

    /// The delay in periods, as far as is known.
    pub fn periods(&self) -> usize {
        self.choice.periods()
    }

    /// Takes in where the tip is measured now; before the command of this period.
    pub fn measure(&mut self, tip: Option<Vector3<f64>>) {
        let step = tip.zip(self.last_tip).map(|(tip, last)| tip - last);
        self.last_tip = tip;
        if let (Some(step), true) = (step, self.steps.len() == self.fits.len()) {
            for (fit, &expected) in self.fits.iter_mut().zip(&self.steps) {
                fit.see(step, expected);
            }
            let plain = self.fits.iter().map(|fit| fit.left + NOTHING);
            let fitted = self.fits.iter().map(Fit::fitted);
            (self.choice).compare(&plain.collect::<Vec<f64>>(), fitted.collect());
        }
    }

    /// Takes in by how much the model's tip moves with this period's command (m).
    pub fn command(&mut self, step: Vector3<f64>) {
        self.steps.push_front(step);
        self.steps.truncate(self.fits.len());
    }
}

/// Sums of products of the steps `m` of the model and of what they leave, `e = s - m`, of the tip's steps `s`; older ones count less.
#[derive(Clone, Debug, Default)]
struct Fit {
    /// `Σ m m'`, `Σ e m'` and `Σ e' e` (m²).
    model: Matrix3<f64>,
    left_by_model: Matrix3<f64>,
    left: f64,
}

/// Share of the sums of a [`Fit`] that is kept in a period: noise of the periods in which the tip rested must not hide how it starts.
const KEPT_IN_FITS: f64 = 0.95;
/// Part of the model's motion that binds the matrix of a [`Fit`] to the identity.
const BOUND: f64 = 0.01;
/// What steps leave without telling anything (m²).
const NOTHING: f64 = 1e-8;

impl Fit {
    fn see(&mut self, step: Vector3<f64>, model: Vector3<f64>) {
        let left = step - model;
        self.model = self.model * KEPT_IN_FITS + model * model.transpose();
        self.left_by_model = self.left_by_model * KEPT_IN_FITS + left * model.transpose();
        self.left = self.left * KEPT_IN_FITS + left.norm_squared();
    }

    /// What the best `I + D` leaves (m²), `D` symmetric: `D G + G D = C + C'` for `G = Σ m m'` and `C = Σ e m'`, solved along the principal directions
    /// of `G`.
    fn fitted(&self) -> f64 {
        let principal = self.model.symmetric_eigen();
        let (ways, sizes) = (principal.eigenvectors, principal.eigenvalues);
        let along = ways.transpose() * (self.left_by_model + self.left_by_model.transpose()) * ways;
        let bound = 2.0 * BOUND * self.model.trace() + f64::MIN_POSITIVE;
        let best = Matrix3::from_fn(|i, j| along[(i, j)] / (sizes[i] + sizes[j] + bound));
        let explained =
            (best * along).trace() - (best * Matrix3::from_diagonal(&sizes) * best).trace();
        (self.left - explained).max(0.0) + NOTHING
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_delay_is_told_from_how_the_tip_starts() {
        for delay in 0..4_usize {
            let mut lag = Lag::new(Delay::Estimated { most: 4 });
            let place = |k: i32| Vector3::x() * 1e-3 * f64::from((k - 20).max(0)).powf(1.3);
            for k in 0..60 {
                // The model's steps are a tenth too long.
                lag.measure(Some(place(k - 1 - delay as i32)));
                lag.command((place(k) - place(k - 1)) * 1.1);
            }
            assert_eq!(lag.periods(), delay);
        }
    }

    #[test]
    fn a_tip_that_rests_tells_none() {
        let mut lag = Lag::new(Delay::Estimated { most: 4 });
        for _ in 0..60 {
            lag.measure(Some(Vector3::zeros()));
            lag.command(Vector3::zeros());
        }
        assert_eq!(lag.periods(), 0);
    }
}
