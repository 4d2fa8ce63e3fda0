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

#[cfg(test)]
mod tests {
    use super::*;

    /// Goes on in steps that succeed up to `longest`; returns where they led.
    fn targets(longest: f64, least: f64) -> Vec<f64> {
        let mut continuation = Continuation::new(1.0, least);
        let mut reached = vec![0.0];
        while let Some(target) = continuation.target() {
            if target - reached[reached.len() - 1] <= longest {
                reached.push(target);
                continuation.succeed(2.0);
            } else if !continuation.fail(0.5) {
                break;
            }
        }
        reached
    }

    #[test]
    fn steps_shrink_until_they_succeed_and_end_at_the_goal() {
        assert_eq!(targets(0.3, 1e-3), [0.0, 0.25, 0.5, 0.75, 1.0]);
    }

    #[test]
    fn the_way_ends_where_a_step_of_the_least_stride_fails() {
        assert_eq!(targets(0.1, 0.125), [0.0]);
        assert_eq!(targets(0.1, 0.0625).last(), Some(&1.0));
    }
}
