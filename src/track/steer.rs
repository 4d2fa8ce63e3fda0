//! A tip steered by hand: where it is to go in the world's axes, to the command that brings it there through the model.

use nalgebra::Vector3;
use tdcr_control::belief::{Belief, BeliefError};
use tdcr_control::controller::{ControlError, Limits, StepWeights, TipStep};
use tdcr_hw::rig::Rig;
use tdcr_sim::robot::Loads;
use thiserror::Error;

use super::rig::limits;
use super::{TrackError, TrackOptions};

/// Steps of one search at most, and the distance (m) that counts as none.
const STEPS: usize = 12;
const THERE: f64 = 1e-5;
/// Part of what is wanted by which the tip may stay short of it.
const SHORT: f64 = 0.2;

/// Leads the tip of a rig's robot through its model, in open loop.
pub struct TipSteer {
    belief: Belief,
    limits: Limits,
    widths: Vec<f64>,
    length: f64,
}

/// Why the tip is not led there.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SteerError {
    /// No command within bounds leads there.
    #[error(
        "the tip stays {short:.4} m short of what is wanted: commands, or tensions of {low} to {high} N, are at their ends"
    )]
    OutOfReach {
        /// How far (m).
        short: f64,
        /// Smallest tension (N).
        low: f64,
        /// Largest tension (N).
        high: f64,
    },
    /// The model says nothing there.
    #[error(transparent)]
    Model(#[from] ControlError),
}

impl From<BeliefError> for SteerError {
    fn from(error: BeliefError) -> Self {
        Self::Model(error.into())
    }
}

impl TipSteer {
    /// Within the limits of a rig's commands.
    ///
    /// # Errors
    /// [`TrackError`].
    pub fn new(rig: &Rig) -> Result<Self, TrackError> {
        let limits = limits(rig, &TrackOptions::default())?;
        let robot = rig.robot();
        Ok(Self {
            belief: Belief::new(robot, &Loads::default(), &[])?,
            widths: (0..robot.tendons().len())
                .map(|t| limits.width(t))
                .collect(),
            limits,
            length: robot.arc_lengths().last().copied().unwrap_or(1.0),
        })
    }

    /// Where the model has its tip under a command (m, world frame).
    ///
    /// # Errors
    /// [`SteerError`] where it does not settle.
    pub fn tip(&mut self, command: &[f64]) -> Result<Vector3<f64>, SteerError> {
        Ok(self.belief.tip(command)?)
    }

    /// The command, near `command`, under which the tip is `by` (m, world frame) from where `command` has it.
    ///
    /// # Errors
    /// [`SteerError`].
    pub fn moved(&mut self, command: &[f64], by: Vector3<f64>) -> Result<Vec<f64>, SteerError> {
        let target = self.tip(command)? + by;
        let bounds = [self.limits.low.clone(), self.limits.high.clone()];
        let mut next = command.to_vec();
        for _ in 0..STEPS {
            let linear = self.belief.linearise(&next)?;
            let (tip, jacobian) = linear.tip();
            if (target - tip).norm() < THERE {
                break;
            }
            let [[slopes, _], _] = linear.tendon_jacobians()?;
            let tensions = &linear.equilibrium.tendon_tensions;
            let step = TipStep {
                jacobian: &jacobian,
                wanted: target - tip,
                length: self.length,
                command: &next,
                bounds: &bounds,
                preferred: &self.limits.preferred,
                tensions: Some((tensions, &slopes, self.limits.tension)),
                widths: &self.widths,
                weights: StepWeights::default(),
            };
            next = step.solve()?.command;
        }
        let short = (target - self.tip(&next)?).norm();
        if short > (SHORT * by.norm()).max(THERE) {
            let [low, high] = self.limits.tension;
            return Err(SteerError::OutOfReach { short, low, high });
        }
        Ok(next)
    }
}
