//! Open loop through the model.

use nalgebra::Vector3;

use super::{ControlError, Controller, Moment, StepWeights, TipStep};
use crate::belief::Belief;

/// Steps of one solve at most.
const STEPS: usize = 6;
/// Distance (m) that counts as none.
const TOLERANCE: f64 = 1e-7;

/// Commands under which the model, as it was given, has its tip at the target: Gauss-Newton steps from the last command, within
/// the bounds of the period. It does not look at what is measured, so that whatever the model has wrong moves the tip.
#[derive(Clone, Debug, Default)]
pub struct Inverse {
    /// How the parts of a step are weighed.
    pub weights: StepWeights,
}

impl Controller for Inverse {
    fn name(&self) -> &'static str {
        "inverse"
    }

    fn is_closed_loop(&self) -> bool {
        false
    }

    fn propose(&mut self, moment: &mut Moment<'_>) -> Result<Vec<f64>, ControlError> {
        let preferred = &moment.limits.preferred;
        let target = (moment.target)(moment.lead);
        reach(moment, target, preferred, self.weights)
    }
}

/// The command of the next period under which the model, as it was given, has its tip nearest to `target` (m).
fn reach(
    moment: &mut Moment<'_>,
    target: Vector3<f64>,
    preferred: &[f64],
    weights: StepWeights,
) -> Result<Vec<f64>, ControlError> {
    let bounds = moment.limits.next(moment.command);
    let widths = widths(moment);
    let tension = moment.limits.tension;
    let model = &mut *moment.given;
    let length = length(model);
    let mut command = moment.command.to_vec();
    for _ in 0..STEPS {
        let linear = model.linearise(&command)?;
        let (tip, jacobian) = linear.tip();
        let wanted = target - tip;
        let [[slopes, _], _] = linear.tendon_jacobians()?;
        let step = TipStep {
            jacobian: &jacobian,
            wanted,
            length,
            command: &command,
            bounds: &bounds,
            preferred,
            tensions: Some((&linear.equilibrium.tendon_tensions, &slopes, tension)),
            widths: &widths,
            weights,
        };
        let next = step.solve()?.command;
        let change = (next.iter().zip(&command).zip(&widths))
            .map(|((a, b), width)| ((a - b) / width).abs())
            .fold(0.0, f64::max);
        command = next;
        if wanted.norm() < TOLERANCE || change < 1e-9 {
            break;
        }
    }
    // In open loop the robot is where the model led it.
    model.rest(&command)?;
    Ok(command)
}

/// Width of each tendon's range (m or N).
pub(super) fn widths(moment: &Moment<'_>) -> Vec<f64> {
    (0..moment.command.len())
        .map(|t| moment.limits.width(t))
        .collect()
}

/// The robot's length (m).
pub(super) fn length(model: &Belief) -> f64 {
    model.robot().arc_lengths().last().copied().unwrap_or(1.0)
}
