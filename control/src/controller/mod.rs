//! From where the tip is and is to be, to the next command.
//!
//! | controller | what it asks of the model | what it asks of the sensors |
//! |---|---|---|
//! | [`Inverse`] | the command whose equilibrium has the tip at the target | nothing: open loop |
//! | [`ResolvedRate`] | the Jacobian at the estimated equilibrium | the tip's error, and its integral |
//! | [`Predictive`] | equilibria and Jacobians over a horizon | the tip's offset from the model |
//!
//! All three take their steps by [`TipStep`]: a damped least-squares step within the bounds of commands, rates and tensions.

mod inverse;
mod predictive;
mod resolved_rate;
mod step;

pub use inverse::Inverse;
pub use predictive::{Predictive, PredictiveSettings};
pub use resolved_rate::{ResolvedRate, ResolvedRateGains};
pub use step::{Limits, LimitsError, StepWeights, TipStep};

use nalgebra::Vector3;
use thiserror::Error;

use crate::belief::{Belief, BeliefError};

/// What a controller decides on.
pub struct Moment<'a> {
    /// Time between commands (s).
    pub period: f64,
    /// Where the tip is, as measured, or as the model says from what was measured (m, world frame).
    pub tip: Vector3<f64>,
    /// Where the tip is to be, `periods` from now (m).
    pub target: &'a dyn Fn(usize) -> Vector3<f64>,
    /// Periods from a command to when the tip follows it: 1, and the delay that is known of.
    pub lead: usize,
    /// The model with what was estimated.
    pub estimated: &'a mut Belief,
    /// The model as it was given.
    pub given: &'a mut Belief,
    /// The last command (m or N).
    pub command: &'a [f64],
    /// The command that the tip was measured under (m or N): with a delay, an older one.
    pub acting: &'a [f64],
    /// What commands must keep.
    pub limits: &'a Limits,
    /// Tension of each tendon (N), where it is measured.
    pub tensions: Option<&'a [f64]>,
}

/// Chooses commands.
pub trait Controller: Send {
    /// Its name, as on the command line.
    fn name(&self) -> &'static str;

    /// Whether it goes by what is measured.
    fn is_closed_loop(&self) -> bool {
        true
    }

    /// The next command (m or N), within the moment's limits.
    ///
    /// # Errors
    /// [`ControlError`] where it has none; the last command is then held.
    fn propose(&mut self, moment: &mut Moment<'_>) -> Result<Vec<f64>, ControlError>;
}

/// Why a controller has no command.
#[derive(Clone, Debug, Error)]
#[non_exhaustive]
pub enum ControlError {
    /// The model says nothing there.
    #[error(transparent)]
    Model(#[from] BeliefError),
    /// The step's program has numbers that are not finite.
    #[error("the step from the command {0:?} has numbers that are not finite")]
    NotFinite(Vec<f64>),
}
