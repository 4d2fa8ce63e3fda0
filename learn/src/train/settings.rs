//! Settings of a training run.

use serde::{Deserialize, Serialize};

use super::optimizer::Optimizer;
use crate::flow::{FlowPath, Sampler};
use crate::net::{InitialWeights, Precision};
use crate::prior::Prior;
use crate::symmetry::SymmetryUse;

/// Settings of a training run.
///
/// The defaults are the authors' (clipping, decay of the average, cosine, flow times), but for procedure, optimiser, batch,
/// learning rate and warm-up: Muon, many clouds of few points each, and a high rate learn a small network in minutes on a CPU. The authors'
/// are AdamW, 8 clouds of 20,000 points, a rate of 3e-4 and 1,000 steps of warm-up, for a network of width 512 on a GPU.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainSettings {
    /// Optimiser steps in all.
    pub steps: u64,
    /// Older schedules of a run that was extended, in order; empty for most runs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub earlier: Vec<Schedule>,
    /// Clouds per step.
    pub clouds: usize,
    /// Points per cloud and step, a fresh random subset each time.
    pub points: usize,
    /// Where this project and the authors train differently; this project's in older files, which do not say.
    pub procedure: Procedure,
    /// Optimiser; AdamW in older files, which do not say.
    #[serde(default)]
    pub optimizer: Optimizer,
    /// Operand type of the network's products; 32-bit floats in older files, which do not say.
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
    /// Noise, path and flow times.
    pub path: FlowPath,
    /// Where the flow starts; noise alone in older files, which do not say.
    #[serde(skip_serializing_if = "Prior::is_gaussian")]
    pub prior: Prior,
    /// Whether the data are reduced to representatives before they come to a [`Trainer`](super::Trainer), as the command line
    /// does by default; by which symmetries, if any, stands in [`Provenance`](super::Provenance). No in older files, which do
    /// not say.
    #[serde(default)]
    pub symmetry: SymmetryUse,
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
    /// The last evaluation, learned when the other steps are taken; none in older files, which do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refinement: Option<Refinement>,
    /// Validations without a new best one after which the run ends; `None` takes all steps.
    pub patience: Option<u64>,
    /// Largest ratio of the loss to its running level; a run that exceeds it for ten steps in a row has diverged.
    pub spike_factor: f64,
}

impl TrainSettings {
    /// The paper's weight of the colours' error (Eq. rgb_loss_tdcr): `lambda_rgb`.
    pub const COLOR_WEIGHT: f32 = 0.05;
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            steps: 5500,
            earlier: Vec::new(),
            clouds: 128,
            points: 128,
            procedure: Procedure::Project,
            optimizer: Optimizer::MUON,
            precision: Precision::Float32,
            learning_rate: 2e-2,
            final_learning_rate: 1e-6,
            warmup_steps: 500,
            weight_decay: 1e-4,
            clip_norm: 1.0,
            average_decay: 0.999,
            path: FlowPath::default(),
            prior: Prior::Gaussian,
            symmetry: SymmetryUse::Auto,
            color_weight: Self::COLOR_WEIGHT,
            seed: 0,
            validate_every: 550,
            validation_clouds: 16,
            validation_points: 2048,
            sampler: Sampler::default(),
            target: Target::Velocity,
            refinement: None,
            patience: None,
            spike_factor: 3.0,
        }
    }
}

/// Initial weights, order of the clouds, first step and average of a run: two ways that differ in little.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Procedure {
    /// [`InitialWeights::ZeroFilm`]; clouds drawn with replacement; a warm-up that starts with the first step; an average that
    /// follows fast at first.
    #[default]
    Project,
    /// The authors': [`InitialWeights::Authors`]; the clouds of a set in a random order of their own in each epoch, whose last
    /// steps drop what does not fill a batch (those of a stream, which has no epochs, with replacement); a first step at the
    /// full learning rate, and a warm-up that starts with the second; an average with a constant decay.
    Authors,
}

impl Procedure {
    /// How the weights start.
    pub fn initial_weights(self) -> InitialWeights {
        match self {
            Self::Project => InitialWeights::ZeroFilm,
            Self::Authors => InitialWeights::Authors,
        }
    }
}

/// The schedule of a run before it was extended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// Last step on this schedule; the first is 1.
    pub until: u64,
    /// [`TrainSettings::steps`] at that time.
    pub steps: u64,
    /// [`TrainSettings::warmup_steps`] at that time.
    pub warmup_steps: u64,
}

/// What a network learns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Target {
    /// The velocity at any flow time: the network suits any sampler.
    #[default]
    Velocity,
    /// The mean velocities of a [`Teacher`](super::Teacher) over the steps of [`TrainSettings::sampler`] (Euler's method):
    /// the network suits that sampler alone.
    Steps,
    /// The displacement of a [`Refiner`](super::Refiner): the network suits the last denoising of a prediction alone.
    Refinement,
}

impl Target {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Velocity => "velocity",
            Self::Steps => "steps",
            Self::Refinement => "refinement",
        }
    }
}

/// How a network's last evaluation is learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Refinement {
    /// Optimiser steps.
    pub steps: u64,
    /// Points that the network predicts of each training cloud, to learn from.
    pub points: usize,
}

/// [`Refinement::DEFAULT`].
impl Default for Refinement {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Refinement {
    /// Of a network that a CPU trains in minutes.
    pub const DEFAULT: Self = Self {
        steps: 1500,
        points: 500,
    };

    /// The same of no more than `steps` steps; `None` where that is none.
    pub fn at_most(self, steps: u64) -> Option<Self> {
        let steps = self.steps.min(steps);
        (steps > 0).then_some(Self { steps, ..self })
    }

    /// Points that are predicted of each of `clouds` clouds: no more than its steps see.
    pub(super) fn points_per_cloud(self, settings: &TrainSettings, clouds: usize) -> usize {
        let seen = self
            .steps
            .saturating_mul((settings.clouds * settings.points) as u64);
        let each = usize::try_from(seen / clouds.max(1) as u64).unwrap_or(usize::MAX);
        self.points.min(each.max(settings.points))
    }
}
