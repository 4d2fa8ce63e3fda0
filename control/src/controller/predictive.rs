//! Model-predictive control over a quasi-static horizon.

use nalgebra::Vector3;

use super::horizon::{Horizon, Prediction, moved_on};
use super::{ControlError, Controller, Moment, StepWeights};

/// How [`Predictive`] looks ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PredictiveSettings {
    /// Commands of the horizon, one a period; 1 at least.
    pub horizon: usize,
    /// Quadratic programs solved in a period; 1 at least.
    pub programs: usize,
    /// Bandwidth of the observer of the tip's offset from the model (1/s).
    pub bandwidth: f64,
    /// How the parts of a step are weighed.
    pub weights: StepWeights,
}

impl Default for PredictiveSettings {
    fn default() -> Self {
        Self {
            horizon: 6,
            programs: 1,
            bandwidth: 2.0,
            // Ten times what a single step takes: a plan that reverses tendons at every period would cross their backlash and stick.
            weights: StepWeights {
                damping: 1e-3,
                ..StepWeights::default()
            },
        }
    }
}

/// The commands of a horizon that keep the model's tip nearest to the coming targets, of which the first is given
/// (Rawlings, Mayne and Diehl, Model Predictive Control, 2nd ed., ch. 1 and 8).
///
/// Over the horizon `min Σ |p(u_i) + o_i - r_i|² / l² + damping |u_i - u_(i-1)|² + posture |u_i - u_p|²` within the bounds of commands,
/// rates and tensions, `p` the tip of the estimated equilibrium and what it
/// moves by beside the model, as its answers to the last commands tell. It is solved by sequential quadratic programming, Gauss-Newton
/// Hessian and exact Jacobians, from the last horizon moved on by a period (the real-time iteration; Diehl, Bock and Schloeder, SIAM J.
/// Control Optim. 43, 2005). What the model still has wrong is an offset `o` of the tip that goes on at a constant rate; both follow
/// from what is measured by a fading-memory filter of second order (Morrison, Introduction to Sequential Smoothing and
/// Prediction, 1969), so that neither constant errors nor ramps remain (offset-free control; Pannocchia and Rawlings, AIChE J. 49, 2003).
///
/// Among obstacles the first command's step is shortened where the model's equilibrium after it, not its linearisation, leaves the tip
/// farther from its target than no step: beyond where a robot snaps off an obstacle the program foresees nothing.
#[derive(Clone, Debug, Default)]
pub struct Predictive {
    /// How it looks ahead.
    pub settings: PredictiveSettings,
    /// The last horizon's commands.
    plan: Vec<Vec<f64>>,
    /// The command that acted when the tip was seen last (m or N).
    acting: Option<Vec<f64>>,
    /// Offset of the tip from the model (m), and its rate (m/s).
    offset: Option<[Vector3<f64>; 2]>,
}

impl Predictive {
    /// One that looks ahead as `settings` say.
    pub fn new(settings: PredictiveSettings) -> Self {
        Self {
            settings,
            ..Self::default()
        }
    }

    /// Takes in where the tip is, the model's being at `model`; both m.
    fn observe(&mut self, tip: Vector3<f64>, model: Vector3<f64>, period: f64) {
        let found = tip - model;
        let fading = (-period * self.settings.bandwidth).exp();
        let next = match self.offset {
            None => [found, Vector3::zeros()],
            Some([offset, rate]) => {
                let expected = offset + rate * period;
                let surprise = found - expected;
                [
                    expected + surprise * (1.0 - fading * fading),
                    rate + surprise * ((1.0 - fading).powi(2) / period),
                ]
            }
        };
        self.offset = Some(next);
    }
}

impl Controller for Predictive {
    fn name(&self) -> &'static str {
        "mpc"
    }

    fn propose(&mut self, moment: &mut Moment<'_>) -> Result<Vec<f64>, ControlError> {
        let model_tip = moment.estimated.tip(moment.acting)?;
        if let (Some(last), Some([offset, _])) = (&self.acting, &mut self.offset) {
            *offset += moment.beside_model(last, moment.acting);
        }
        self.acting = Some(moment.acting.to_vec());
        self.observe(moment.tip, model_tip, moment.period);
        let [offset, rate] = self.offset.unwrap_or_default();
        let mut plan = moved_on(&self.plan, moment.command, self.settings.horizon);
        for _ in 0..self.settings.programs.max(1) {
            let mut prediction = Prediction::new(plan.len(), moment.command.len());
            for (i, command) in plan.iter().enumerate() {
                let ahead = moment.lead + i;
                let linear = moment.estimated.linearise(command)?;
                let (tip, mut jacobian) = linear.tip();
                jacobian += moment.jacobian_correction;
                let tip = tip + moment.beside_model(moment.acting, command);
                let [[slopes, _], _] = linear.tendon_jacobians()?;
                let expected = tip + offset + rate * (ahead as f64 * moment.period);
                let mut stage = prediction.stage(i);
                stage.wanted((moment.target)(ahead) - expected);
                stage.tip_by(i, jacobian.as_view());
                stage.tensions(&linear.equilibrium.tendon_tensions);
                stage.tensions_by(i, slopes.as_view());
            }
            let horizon = Horizon {
                prediction,
                plan: &plan,
                weights: self.settings.weights,
                error_rate: 0.0,
            };
            plan = horizon.improve(moment)?;
        }
        let beside = offset + rate * (moment.lead as f64 * moment.period);
        plan[0] = moment.backtracked(plan[0].clone(), beside)?;
        self.plan = plan;
        Ok(self.plan[0].clone())
    }
}
