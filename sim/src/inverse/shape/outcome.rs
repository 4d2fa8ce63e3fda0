//! How a search for a command ended.

use super::Obstruction;
use crate::scene::Nearest;

/// How a search ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// Every target is met within the tolerance.
    Reached,
    /// Nothing near the command comes nearer to the targets: it is stationary. As the search is
    /// local, from the best of its starts, another command far off is not excluded.
    Unreachable {
        /// The tendons that a bound keeps from coming nearer.
        active: Vec<ActiveBound>,
        /// The obstacles that keep it away, by the clearance from them that is asked for, the strongest first. Without one, or where
        /// none is, nothing is here.
        obstacles: Vec<Obstruction>,
        /// Frank and Wolfe's gap (m): the most that the weighted distance, the root of the weighted
        /// sum of squares, could fall by anywhere in the box of commands, were it linear. At most
        /// the tolerance.
        gap: f64,
    },
    /// It comes nearer to an obstacle than the clearance that is asked for, or touches it: no command was found that keeps clear.
    TooNear {
        /// The obstacle, the disc and their gap.
        nearest: Nearest,
    },
    /// The search came to a halt at a command that is not stationary, for example where tendons go
    /// slack, where equilibria vanish, or for want of steps.
    Stalled {
        /// As for [`Outcome::Unreachable`], above the tolerance.
        gap: f64,
    },
}

/// A tendon whose command is at the end of its range, and would have to go past it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActiveBound {
    /// The tendon.
    pub tendon: usize,
    /// Which end.
    pub bound: Bound,
}

/// An end of a tendon's range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// The smallest command.
    Low,
    /// The largest command.
    High,
}
