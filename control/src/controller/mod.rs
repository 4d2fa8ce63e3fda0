//! From where the tip is and is to be, to the next command.
//!
//! | controller | what it asks of the model | what it asks of the sensors |
//! |---|---|---|
//! | [`Inverse`] | the command whose equilibrium has the tip at the target | nothing: open loop |
//! | [`ResolvedRate`] | the Jacobian at the estimated equilibrium | the tip's error, its integral, its answers to commands |
//! | [`Predictive`] | equilibria and Jacobians over a horizon | the tip's offset from the model, its answers to commands |
//! | [`MovingPredictive`] | the motion over a horizon, linearised | the tip's offset from the model |
//!
//! The first two take steps by [`TipStep`], a damped least-squares step within the bounds of commands, rates and tensions; the others
//! solve quadratic programs over a horizon within the same bounds.

mod horizon;
mod inverse;
mod moving;
mod predictive;
mod resolved_rate;
mod step;

pub use inverse::Inverse;
pub use moving::{MovingPredictive, MovingPredictiveSettings};
pub use predictive::{Predictive, PredictiveSettings};
pub use resolved_rate::{ResolvedRate, ResolvedRateGains};
pub use step::{Limits, LimitsError, StepWeights, TipStep};

use nalgebra::{DVector, Matrix3xX, Vector3};
use tdcr_sim::dynamics::DynamicsError;
use tdcr_sim::robot::CommandError;
use thiserror::Error;

use crate::belief::{Belief, BeliefError};
use crate::lag::Delay;

/// Steps that are tried: the whole one, its half and its quarter.
const TRIED_STEPS: i32 = 3;

/// What a controller decides on.
pub struct Moment<'a> {
    /// When it is (s, from the path's start).
    pub time: f64,
    /// Time between commands (s).
    pub period: f64,
    /// Where the tip is, as measured, or as the model says from what was measured (m, world frame).
    pub tip: Vector3<f64>,
    /// Where the tip is to be, `periods` from now (m).
    pub target: &'a dyn Fn(usize) -> Vector3<f64>,
    /// Periods from a command to when the tip follows it: 1, and the delay as a robot at rest would have it.
    pub lead: usize,
    /// What is known of the delay beforehand.
    pub delay: Delay,
    /// The model with what was estimated.
    pub estimated: &'a mut Belief,
    /// The model as it was given.
    pub given: &'a mut Belief,
    /// The last command (m or N).
    pub command: &'a [f64],
    /// The command that the tip was measured under (m or N): with a delay, an older one.
    pub acting: &'a [f64],
    /// What the tip's Jacobian has beside that of the estimated model (m per m or N), as the tip's answers to the last commands tell it.
    pub jacobian_correction: &'a Matrix3xX<f64>,
    /// What commands must keep.
    pub limits: &'a Limits,
    /// Tension of each tendon (N), where it is measured.
    pub tensions: Option<&'a [f64]>,
}

impl Moment<'_> {
    /// By what the tip moves from one command to another beside what the estimated model says (m).
    fn beside_model(&self, from: &[f64], to: &[f64]) -> Vector3<f64> {
        let change = to.iter().zip(from).map(|(to, from)| to - from);
        self.jacobian_correction * DVector::from_iterator(to.len(), change)
    }

    /// `next`, or a part of the change that leads there, by what the model among obstacles says of it: near where a robot comes free of an obstacle
    /// its tip follows no Jacobian. The step is halved as long as it leaves the tip farther from its target than no step would (backtracking:
    /// Nocedal and Wright, Numerical Optimization, ch. 3.1), and of the steps tried the best is taken. `beside` is where the tip is beside the
    /// model when it follows the command (m).
    ///
    /// # Errors
    /// [`ControlError::Model`] where the model does not settle.
    fn backtracked(
        &mut self,
        next: Vec<f64>,
        beside: Vector3<f64>,
    ) -> Result<Vec<f64>, ControlError> {
        if !self.estimated.is_among_obstacles() {
            return Ok(next);
        }
        let (from, target) = (self.command, (self.target)(self.lead));
        let mut error = |command: &[f64]| -> Result<f64, ControlError> {
            let tip = self.estimated.tip(command)? + self.beside_model(self.acting, command);
            Ok((target - tip - beside).norm())
        };
        let without = error(from)?;
        let mut best = (f64::INFINITY, next.clone());
        for halvings in 0..TRIED_STEPS {
            let part = 0.5_f64.powi(halvings);
            let pairs = from.iter().zip(&next);
            let tried: Vec<f64> = pairs.map(|(from, to)| from + part * (to - from)).collect();
            let left = error(&tried)?;
            if left < best.0 {
                best = (left, tried);
            }
            if left <= without {
                break;
            }
        }
        Ok(best.1)
    }
}

/// Chooses commands.
pub trait Controller: Send {
    /// Its name, as on the command line.
    fn name(&self) -> &'static str;

    /// Whether it goes by what is measured.
    fn is_closed_loop(&self) -> bool {
        true
    }

    /// The delay (periods) that it told by a model of its own, if it has one.
    fn delay(&self) -> Option<usize> {
        None
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
    /// The model's motion says nothing there.
    #[error(transparent)]
    Motion(#[from] DynamicsError),
    /// The command is none of the model's.
    #[error(transparent)]
    Command(#[from] CommandError),
    /// The step's program has numbers that are not finite.
    #[error("the step from the command {0:?} has numbers that are not finite")]
    NotFinite(Vec<f64>),
}
