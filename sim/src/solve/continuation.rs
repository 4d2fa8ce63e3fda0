//! Continuation: the problem to be solved is reached in steps from one whose solution is known, each solve starting
//! from the last solution.

/// Where a continuation stands on its way from 0 to 1, with strides that grow where steps succeed and
/// shrink where they fail (Allgower and Georg, Introduction to Numerical Continuation Methods, 2003, ch. 6).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Continuation {
    done: f64,
    /// Length of the next step.
    pub stride: f64,
    least: f64,
}

impl Continuation {
    /// Starts at 0 with steps of `stride`. A step as short as `least` that fails is the last.
    pub fn new(stride: f64, least: f64) -> Self {
        Self {
            done: 0.0,
            stride,
            least,
        }
    }

    /// Where the next step leads; `None` at the end of the way.
    pub fn target(&self) -> Option<f64> {
        (self.done < 1.0).then(|| f64::min(self.done + self.stride, 1.0))
    }

    /// Goes to the target, and makes the next step `growth` times as long.
    pub fn succeed(&mut self, growth: f64) {
        self.done = f64::min(self.done + self.stride, 1.0);
        self.stride *= growth;
    }

    /// Stays, and makes the next step `factor` times as long. Returns whether to try it.
    pub fn fail(&mut self, factor: f64) -> bool {
        let goes_on = !self.is_least();
        self.stride *= factor;
        goes_on
    }

    /// Whether the next step is the last if it fails.
    pub fn is_least(&self) -> bool {
        self.stride <= self.least
    }
}
