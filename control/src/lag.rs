//! After how many periods the tip follows a command.

use std::collections::VecDeque;

use nalgebra::Vector3;

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

/// Which delay is the true one, by the squares that each leaves.
#[derive(Clone, Debug)]
pub(crate) struct DelayChoice {
    now: usize,
    /// For each delay that it may be, the sum of squares (m²).
    left: Vec<f64>,
    may_change: bool,
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
        let best = (0..self.left.len()).min_by(|&a, &b| self.left[a].total_cmp(&self.left[b]));
        if let Some(best) = best
            && self.left[best] < BETTER * self.left[self.now]
        {
            self.now = best;
        }
    }
}

/// Tells the delay `d` from the tip's steps, the robot at rest at every period: that which leaves the least of
/// `Σ |p_k - p_(k-1) - (m_(k-1-d) - m_(k-2-d))|²`, `p_k` the tip as measured at period `k` and `m_k` the model's under the command given then.
#[derive(Clone, Debug)]
pub(crate) struct Lag {
    choice: DelayChoice,
    /// Delays that it may be.
    delays: usize,
    /// Of the model's tip: its steps by the last commands, the newest first (m).
    steps: VecDeque<Vector3<f64>>,
    last_tip: Option<Vector3<f64>>,
}

impl Lag {
    pub fn new(delay: Delay) -> Self {
        Self {
            choice: DelayChoice::new(delay),
            delays: delay.most() + 1,
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
        if let (Some(step), true) = (step, self.steps.len() == self.delays) {
            let left = |expected: &Vector3<f64>| (step - expected).norm_squared();
            self.choice.weigh(self.steps.iter().map(left));
        }
    }

    /// Takes in by how much the model's tip moves with this period's command (m).
    pub fn command(&mut self, step: Vector3<f64>) {
        self.steps.push_front(step);
        self.steps.truncate(self.delays);
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
