//! Resolved-rate control with integral action.

use nalgebra::Vector3;

use super::inverse::{length, widths};
use super::{ControlError, Controller, Moment, StepWeights, TipStep};

/// Gains of [`ResolvedRate`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ResolvedRateGains {
    /// Speed per error (1/s).
    pub proportional: f64,
    /// Speed per integral of the error (1/s²).
    pub integral: f64,
}

impl Default for ResolvedRateGains {
    fn default() -> Self {
        Self {
            proportional: 4.0,
            integral: 4.0,
        }
    }
}

/// The tip moves at the target's speed, and by a proportional and an integral part of its error:
/// `v = dr/dt + Kp e + Ki ∫ e dt` (Whitney, Resolved motion rate control, IEEE Trans. Man-Mach. Syst. 10, 1969; the integral as
/// in Siciliano et al., Robotics, ch. 3.7), through the Jacobian at the estimated equilibrium, corrected by what the tip did under the last commands, by damped least squares within bounds.
///
/// The command being the integral of the speed, the loop is of second order with the poles of `s² + Kp s + Ki`: a model that is off at
/// frequency `w` is followed to a share `w² / |Ki - w² + j Kp w|` of the offset. A delay of `d` periods bounds `Kp` to about
/// `1 / (2 d T)`. While bounds hold the tip back the integral stands still (conditional integration).
#[derive(Clone, Debug)]
pub struct ResolvedRate {
    /// Gains.
    pub gains: ResolvedRateGains,
    /// How the parts of a step are weighed.
    pub weights: StepWeights,
    /// Integral of the error (m s).
    integral: Vector3<f64>,
}

impl Default for ResolvedRate {
    fn default() -> Self {
        Self {
            gains: ResolvedRateGains::default(),
            // Three times what a step on the model takes: a tip that an obstacle held comes free of it.
            weights: StepWeights {
                damping: 3e-4,
                ..StepWeights::default()
            },
            integral: Vector3::zeros(),
        }
    }
}

impl Controller for ResolvedRate {
    fn name(&self) -> &'static str {
        "resolved-rate"
    }

    fn propose(&mut self, moment: &mut Moment<'_>) -> Result<Vec<f64>, ControlError> {
        let preferred = &moment.limits.preferred;
        let period = moment.period;
        let acting = moment.acting;
        // Where the tip will be once it follows all commands that are on their way.
        let linear = moment.estimated.linearise(moment.command)?;
        let (model_tip, mut jacobian) = linear.tip();
        jacobian += moment.jacobian_correction;
        let coming = match acting == moment.command {
            true => Vector3::zeros(),
            false => {
                let beside = moment.beside_model(acting, moment.command);
                model_tip - moment.estimated.tip(acting)? + beside
            }
        };
        let tip = moment.tip + coming;
        let [now, next] = [moment.lead - 1, moment.lead].map(|periods| (moment.target)(periods));
        let error = now - tip;
        let speed = error * self.gains.proportional + self.integral * self.gains.integral;
        let [[slopes, _], _] = linear.tendon_jacobians()?;
        let tensions = (moment.tensions).unwrap_or(&linear.equilibrium.tendon_tensions);
        let step = TipStep {
            jacobian: &jacobian,
            wanted: next - now + speed * period,
            length: length(moment.estimated),
            command: moment.command,
            bounds: &moment.limits.next(moment.command),
            preferred,
            tensions: Some((tensions, &slopes, moment.limits.tension)),
            widths: &widths(moment),
            weights: self.weights,
        };
        let stepped = step.solve()?;
        if !stepped.is_held_back {
            self.integral += error * period;
        }
        Ok(stepped.command)
    }
}
