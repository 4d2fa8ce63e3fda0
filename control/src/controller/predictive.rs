//! Model-predictive control over a quasi-static horizon.

use nalgebra::{DMatrix, DVector, Matrix3xX, Vector3};

use super::inverse::{length, widths};
use super::{ControlError, Controller, Moment, StepWeights};
use crate::quadratic::QuadraticProgram;

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
/// rates and tensions, `p` the tip of the estimated equilibrium. It is solved by sequential quadratic programming, Gauss-Newton
/// Hessian and exact Jacobians, from the last horizon moved on by a period (the real-time iteration; Diehl, Bock and Schloeder, SIAM J.
/// Control Optim. 43, 2005). What the model still has wrong is an offset `o` of the tip that goes on at a constant rate; both follow
/// from what is measured by a fading-memory filter of second order (Morrison, Introduction to Sequential Smoothing and
/// Prediction, 1969), so that neither constant errors nor ramps remain (offset-free control; Pannocchia and Rawlings, AIChE J. 49, 2003).
#[derive(Clone, Debug, Default)]
pub struct Predictive {
    /// How it looks ahead.
    pub settings: PredictiveSettings,
    /// The last horizon's commands.
    plan: Vec<Vec<f64>>,
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

    /// The commands to improve on: the last plan moved on by a period, or the last command where there is no plan that led to it.
    fn moved_on(&self, command: &[f64]) -> Vec<Vec<f64>> {
        let horizon = self.settings.horizon.max(1);
        match self.plan.first() {
            Some(first) if first == command && self.plan.len() == horizon => {
                let last = self.plan[horizon - 1].clone();
                self.plan[1..].iter().cloned().chain([last]).collect()
            }
            _ => vec![command.to_vec(); horizon],
        }
    }
}

impl Controller for Predictive {
    fn name(&self) -> &'static str {
        "mpc"
    }

    fn propose(&mut self, moment: &mut Moment<'_>) -> Result<Vec<f64>, ControlError> {
        let model_tip = moment.estimated.tip(moment.acting)?;
        self.observe(moment.tip, model_tip, moment.period);
        let preferred = &moment.limits.preferred;
        let [offset, rate] = self.offset.unwrap_or_default();
        let mut plan = self.moved_on(moment.command);
        for _ in 0..self.settings.programs.max(1) {
            let mut stages = Vec::with_capacity(plan.len());
            for (i, command) in plan.iter().enumerate() {
                let ahead = moment.lead + i;
                let linear = moment.estimated.linearise(command)?;
                let (tip, jacobian) = linear.tip();
                let [[slopes, _], _] = linear.tendon_jacobians()?;
                let expected = tip + offset + rate * (ahead as f64 * moment.period);
                stages.push(Stage {
                    wanted: (moment.target)(ahead) - expected,
                    jacobian,
                    tensions: linear.equilibrium.tendon_tensions,
                    slopes,
                });
            }
            let program = Horizon {
                stages: &stages,
                plan: &plan,
                preferred,
                widths: &widths(moment),
                length: length(moment.estimated),
                weights: self.settings.weights,
            };
            plan = program.improve(moment)?;
        }
        let bounds = moment.limits.next(moment.command);
        let first = plan[0].iter().enumerate();
        let first: Vec<f64> = first
            .map(|(t, value)| value.clamp(bounds[0][t], bounds[1][t]))
            .collect();
        plan[0].clone_from(&first);
        self.plan = plan;
        Ok(first)
    }
}

/// The model about one command of the plan.
struct Stage {
    wanted: Vector3<f64>,
    jacobian: Matrix3xX<f64>,
    tensions: Vec<f64>,
    slopes: DMatrix<f64>,
}

/// The program over the horizon; its variables are the plan's changes in units of the tendons' ranges, stage by stage.
struct Horizon<'a> {
    stages: &'a [Stage],
    plan: &'a [Vec<f64>],
    preferred: &'a [f64],
    widths: &'a [f64],
    length: f64,
    weights: StepWeights,
}

impl Horizon<'_> {
    fn improve(&self, moment: &Moment<'_>) -> Result<Vec<Vec<f64>>, ControlError> {
        let (hessian, gradient) = self.objective(moment.command);
        let (rows, bounds) = self.constraints(moment);
        let program = QuadraticProgram {
            hessian,
            gradient,
            rows,
            bounds,
        };
        let solved = program.solve();
        let x = solved
            .ok_or_else(|| ControlError::NotFinite(self.plan[0].clone()))?
            .x;
        let n = self.widths.len();
        let limits = moment.limits;
        let changed = |(i, command): (usize, &Vec<f64>)| {
            let value = |t: usize| {
                let value = command[t] + x[i * n + t] * self.widths[t];
                value.clamp(limits.low[t], limits.high[t])
            };
            (0..n).map(value).collect()
        };
        Ok(self.plan.iter().enumerate().map(changed).collect())
    }

    fn objective(&self, before: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.widths.len();
        let size = n * self.stages.len();
        let mut hessian = DMatrix::zeros(size, size);
        let mut gradient = DVector::zeros(size);
        let StepWeights { damping, posture } = self.weights;
        for (i, stage) in self.stages.iter().enumerate() {
            let scaled = Matrix3xX::from_fn(n, |row, t| {
                stage.jacobian[(row, t)] * self.widths[t] / self.length
            });
            let square = scaled.transpose() * &scaled;
            let pull = scaled.tr_mul(&(stage.wanted / self.length));
            for t in 0..n {
                let at = i * n + t;
                for other in 0..n {
                    hessian[(at, i * n + other)] += square[(t, other)];
                }
                let here = self.plan[i][t];
                hessian[(at, at)] += posture + damping;
                gradient[at] += posture * (here - self.preferred[t]) / self.widths[t] - pull[t];
                // The change from the stage before, of which the first is given.
                let last = i
                    .checked_sub(1)
                    .map_or(before[t], |last| self.plan[last][t]);
                let change = damping * (here - last) / self.widths[t];
                gradient[at] += change;
                if i > 0 {
                    let earlier = at - n;
                    hessian[(earlier, earlier)] += damping;
                    hessian[(at, earlier)] -= damping;
                    hessian[(earlier, at)] -= damping;
                    gradient[earlier] -= change;
                }
            }
        }
        (hessian, gradient)
    }

    /// Rows and bounds: for each stage and tendon its command up and down, its change up and down, its tension up and down.
    fn constraints(&self, moment: &Moment<'_>) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.widths.len();
        let (size, limits) = (n * self.stages.len(), moment.limits);
        let mut rows = DMatrix::zeros(6 * size, size);
        let mut bounds = DVector::zeros(6 * size);
        for (i, stage) in self.stages.iter().enumerate() {
            let before = i
                .checked_sub(1)
                .map_or(moment.command, |last| &self.plan[last]);
            for (t, (&here, &before)) in self.plan[i].iter().zip(before).enumerate() {
                let (at, width) = (i * n + t, self.widths[t]);
                let change = here - before;
                let room = [
                    (limits.high[t] - here) / width,
                    (here - limits.low[t]) / width,
                    (limits.step[t] - change) / width,
                    (limits.step[t] + change) / width,
                    (limits.tension[1] - stage.tensions[t]).min(1e9),
                    (stage.tensions[t] - limits.tension[0]).min(1e9),
                ];
                for (k, room) in room.into_iter().enumerate() {
                    let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                    let row = 6 * at + k;
                    bounds[row] = room;
                    if k < 4 {
                        rows[(row, at)] = sign;
                    }
                    if (2..4).contains(&k) && i > 0 {
                        rows[(row, at - n)] = -sign;
                    }
                    for other in (0..n).filter(|_| k >= 4) {
                        rows[(row, i * n + other)] =
                            sign * stage.slopes[(t, other)] * self.widths[other];
                    }
                }
            }
        }
        (rows, bounds)
    }
}
