//! Settings of a training run, its learning-rate schedule and its weight averaging.

use serde::{Deserialize, Serialize};

use super::optimizer::Optimizer;
use super::schedule::Schedule;
use crate::flow::{FlowError, FlowPath, Sampler};
use crate::net::{COLOR_WEIGHT, Precision};

/// Largest batch; far above any useful one.
const MAX_CLOUDS: usize = 65_536;

/// Points in a step: what a few gigabytes hold.
const MAX_BATCH: usize = 100_000_000;

/// Settings of a training run.
///
/// The defaults are the authors' (clipping, averaging, cosine, flow times), but for optimiser, batch, learning rate and
/// warm-up: Muon, many clouds of few points each, and a high rate learn a small network in minutes on a CPU. The authors'
/// are AdamW, 8 clouds of 20,000 points, a rate of 3e-4 and 1,000 steps of warm-up, for a network of width 512 on a GPU.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainSettings {
    /// Optimiser steps in all.
    pub steps: u64,
    /// Schedules of a run that was given more steps later, in the order in which it followed them; none in most runs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub earlier: Vec<Schedule>,
    /// Clouds per step.
    pub clouds: usize,
    /// Points per cloud and step, a fresh random subset each time.
    pub points: usize,
    /// How gradients move the weights; AdamW in files of before there was a choice.
    #[serde(default)]
    pub optimizer: Optimizer,
    /// What numbers the network's products are of; floats in files of before there was a choice.
    #[serde(default)]
    pub precision: Precision,
    /// Learning rate of AdamW after warm-up.
    pub learning_rate: f64,
    /// Learning rate at the last step.
    pub final_learning_rate: f64,
    /// Steps of linear warm-up.
    pub warmup_steps: u64,
    /// Decoupled weight decay (per unit of learning rate).
    pub weight_decay: f64,
    /// Largest global norm of the gradient.
    pub clip_norm: f64,
    /// Decay of the exponential moving average of the weights (EMA).
    pub average_decay: f64,
    /// Prior, path and flow times.
    pub path: FlowPath,
    /// Weight of the colours' loss beside the positions'; without effect on networks without colours.
    pub color_weight: f32,
    /// Seed of everything random in the run.
    pub seed: u64,
    /// Steps between validations.
    pub validate_every: u64,
    /// Clouds per validation, spread over the validation set.
    pub validation_clouds: usize,
    /// Points predicted and compared per validation cloud.
    pub validation_points: usize,
    /// Sampler of the validation's predictions.
    pub sampler: Sampler,
    /// What the network learns.
    pub target: Target,
    /// Validations without a new best one after which the run ends; none takes all steps.
    pub patience: Option<u64>,
    /// How many times its running level the loss may be for [`SPIKE_STEPS`] steps on end; above, the run has diverged.
    pub spike_factor: f64,
}

/// Steps on end that the loss must be above its running level times [`TrainSettings::spike_factor`] to be divergence:
/// single batches may be that far off.
pub const SPIKE_STEPS: usize = 10;

/// Losses, before those of the last [`SPIKE_STEPS`] steps, whose median is the running level.
const LEVEL_STEPS: usize = 100;

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            steps: 7000,
            earlier: Vec::new(),
            clouds: 64,
            points: 256,
            optimizer: Optimizer::MUON,
            precision: Precision::Float32,
            learning_rate: 2e-2,
            final_learning_rate: 1e-6,
            warmup_steps: 500,
            weight_decay: 1e-4,
            clip_norm: 1.0,
            average_decay: 0.999,
            path: FlowPath::default(),
            color_weight: COLOR_WEIGHT,
            seed: 0,
            validate_every: 700,
            validation_clouds: 16,
            validation_points: 2048,
            sampler: Sampler::default(),
            target: Target::Velocity,
            patience: None,
            spike_factor: 3.0,
        }
    }
}

/// What a network learns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Target {
    /// The velocity at any flow time, which any sampler may follow.
    #[default]
    Velocity,
    /// The mean velocities over the steps of [`TrainSettings::sampler`], Euler's method, from a
    /// [`Teacher`](super::Teacher): the network is of use with that sampler alone.
    Steps,
}

impl Target {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Velocity => "velocity",
            Self::Steps => "steps",
        }
    }
}

/// A setting out of bounds.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SettingsError {
    /// A setting of the run itself.
    #[error("{field} is {found}, expected {expected}")]
    Value {
        /// Field of [`TrainSettings`].
        field: &'static str,
        /// Its value.
        found: String,
        /// What would be right.
        expected: String,
    },
    /// A setting of the path or of the sampler.
    #[error(transparent)]
    Flow(#[from] FlowError),
}

impl SettingsError {
    pub(super) fn new(field: &'static str, found: impl ToString, expected: impl ToString) -> Self {
        Self::Value {
            field,
            found: found.to_string(),
            expected: expected.to_string(),
        }
    }
}

impl TrainSettings {
    /// Refuses settings with which no run can be made.
    pub fn check(&self) -> Result<(), SettingsError> {
        for (field, value) in [
            ("steps", self.steps),
            ("clouds", self.clouds as u64),
            ("points", self.points as u64),
            ("validate_every", self.validate_every),
            ("validation_clouds", self.validation_clouds as u64),
            ("validation_points", self.validation_points as u64),
        ] {
            if value == 0 {
                return Err(SettingsError::new(field, value, "at least 1"));
            }
        }
        if self.clouds > MAX_CLOUDS {
            let expected = format!("at most {MAX_CLOUDS}");
            return Err(SettingsError::new("clouds", self.clouds, expected));
        }
        let batch = self.clouds.saturating_mul(self.points);
        if batch > MAX_BATCH {
            let expected = format!("at most {MAX_BATCH} points in a step");
            return Err(SettingsError::new("clouds times points", batch, expected));
        }
        self.check_schedule()?;
        for (field, value, least) in [
            ("learning_rate", self.learning_rate, f64::MIN_POSITIVE),
            (
                "muon's learning_rate",
                self.matrix_learning_rate(),
                f64::MIN_POSITIVE,
            ),
            ("final_learning_rate", self.final_learning_rate, 0.0),
            ("weight_decay", self.weight_decay, 0.0),
            ("clip_norm", self.clip_norm, f64::MIN_POSITIVE),
            ("color_weight", self.color_weight.into(), f64::MIN_POSITIVE),
        ] {
            if !(value.is_finite() && value >= least) {
                let sign = if least > 0.0 {
                    "positive"
                } else {
                    "non-negative"
                };
                return Err(SettingsError::new(field, value, format!("a {sign} number")));
            }
        }
        if self.patience == Some(0) {
            return Err(SettingsError::new("patience", 0, "at least 1"));
        }
        if !(self.spike_factor.is_finite() && self.spike_factor > 1.0) {
            let expected = "a number above 1";
            return Err(SettingsError::new(
                "spike_factor",
                self.spike_factor,
                expected,
            ));
        }
        if !(0.0..1.0).contains(&self.average_decay) {
            return Err(SettingsError::new(
                "average_decay",
                self.average_decay,
                "0 or more, below 1",
            ));
        }
        self.path.check()?;
        Ok(self.sampler.check()?)
    }

    /// The running level of `losses`, one per step: the median of up to 100 losses before the last [`SPIKE_STEPS`]. None
    /// while there are fewer than [`SPIKE_STEPS`] before them.
    pub fn loss_level(losses: &[f32]) -> Option<f32> {
        let before = losses.len().checked_sub(SPIKE_STEPS)?;
        if before < SPIKE_STEPS {
            return None;
        }
        let recent = &losses[before.saturating_sub(LEVEL_STEPS)..before];
        let mut sorted = [0.0; LEVEL_STEPS];
        let sorted = &mut sorted[..recent.len()];
        sorted.copy_from_slice(recent);
        let middle = sorted.len() / 2;
        Some(*sorted.select_nth_unstable_by(middle, f32::total_cmp).1)
    }

    /// How many of the last [`SPIKE_STEPS`] losses, from the last one back, are on end above the running level times
    /// [`Self::spike_factor`]: with 0 all is well, with [`SPIKE_STEPS`] the run has diverged.
    pub fn spike_length(&self, losses: &[f32]) -> usize {
        let Some(level) = Self::loss_level(losses) else {
            return 0;
        };
        let limit = self.spike_factor * f64::from(level);
        let last = losses.iter().rev().take(SPIKE_STEPS);
        last.take_while(|loss| f64::from(**loss) > limit).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Losses that fall and scatter by a factor of three either way, as those of few clouds do.
    fn noisy_losses(steps: usize) -> Vec<f32> {
        let scatter = |k: usize| (1.1 * ((k * 7919 % 101) as f32 / 50.0 - 1.0)).exp();
        (0..steps)
            .map(|k| (0.02 + (-(k as f32) / 80.0).exp()) * scatter(k))
            .collect()
    }

    #[test]
    fn a_rise_that_stays_is_a_spike_and_scatter_is_none() {
        let settings = TrainSettings::default();
        let mut losses = noisy_losses(600);
        for steps in 1..=losses.len() {
            assert_eq!(settings.spike_length(&losses[..steps]) / SPIKE_STEPS, 0);
        }
        losses.push(50.0);
        assert_eq!(settings.spike_length(&losses), 1);
        losses.push(0.02);
        assert_eq!(settings.spike_length(&losses), 0);
        for rise in 1..=SPIKE_STEPS {
            losses.push(0.4 + rise as f32);
            assert_eq!(settings.spike_length(&losses), rise);
        }
    }

    #[test]
    fn the_first_losses_of_a_run_have_no_level() {
        let settings = TrainSettings::default();
        let mut losses = vec![1.0; 2 * SPIKE_STEPS - 1];
        losses[SPIKE_STEPS..].fill(100.0);
        assert_eq!(TrainSettings::loss_level(&losses), None);
        assert_eq!(settings.spike_length(&losses), 0);
        losses.push(100.0);
        assert_eq!(TrainSettings::loss_level(&losses), Some(1.0));
        assert_eq!(settings.spike_length(&losses), SPIKE_STEPS);
    }

    #[test]
    fn bad_settings_are_refused_by_name() {
        let good = TrainSettings::default();
        assert_eq!(good.check(), Ok(()));
        let error =
            |settings: TrainSettings| settings.check().expect_err("bad settings").to_string();
        assert_eq!(
            error(TrainSettings {
                clouds: 0,
                ..good.clone()
            }),
            "clouds is 0, expected at least 1"
        );
        assert_eq!(
            error(TrainSettings {
                warmup_steps: 30_000,
                ..good.clone()
            }),
            "warmup_steps is 30000, expected fewer than the 7000 steps"
        );
        assert!(
            error(TrainSettings {
                learning_rate: f64::NAN,
                ..good.clone()
            })
            .starts_with("learning_rate is NaN")
        );
        assert!(
            error(TrainSettings {
                average_decay: 1.0,
                ..good.clone()
            })
            .starts_with("average_decay is 1")
        );
        assert_eq!(
            error(TrainSettings {
                color_weight: 0.0,
                ..good.clone()
            }),
            "color_weight is 0, expected a positive number"
        );
        assert_eq!(
            error(TrainSettings {
                patience: Some(0),
                ..good.clone()
            }),
            "patience is 0, expected at least 1"
        );
        assert_eq!(
            error(TrainSettings {
                spike_factor: 1.0,
                ..good
            }),
            "spike_factor is 1, expected a number above 1"
        );
    }
}
