//! Networks and settings of training that fit together.

use tdcr_learn::flow::{FlowPath, Method, Sampler, TimeGrid};
use tdcr_learn::net::{Channels, ContextLayers, TimeFeatures};
use tdcr_learn::symmetry::SymmetryUse;
use tdcr_learn::train::{Optimizer, Procedure, Refinement, Target, TrainSettings};

use super::NetworkSize;

/// Sizes and settings that fit together; all else is as in [`TrainSettings::default`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// Its name.
    pub name: &'static str,
    /// What it is for.
    pub purpose: &'static str,
    /// Size of an MLP; a hybrid has a context network besides.
    pub size: NetworkSize,
    /// How long the run is.
    pub length: Length,
    /// Points per cloud and step, or all of a cloud where it has fewer.
    pub points: usize,
    /// Steps between validations.
    pub validate_every: u64,
    /// Sampler of the validation's predictions.
    pub sampler: Sampler,
    /// Prior and flow times.
    pub path: FlowPath,
    /// The last evaluation, learned when all steps are taken; at most a third of the run.
    pub refinement: Option<Refinement>,
    /// How gradients move the weights.
    pub optimizer: Optimizer,
    /// Whether it learns representatives of symmetric conditions.
    pub symmetry: SymmetryUse,
    /// Where this project and the authors train differently.
    pub procedure: Procedure,
    /// Which layers a hybrid's context network is made of.
    pub layers: ContextLayers,
    /// What differs between the networks: an MLP's, a hybrid's.
    pub rates: [Rates; 2],
}

/// Batch and learning rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Clouds per step.
    pub clouds: usize,
    /// Learning rate after warm-up.
    pub learning_rate: f64,
    /// Steps of warm-up; at most a tenth of the run.
    pub warmup_steps: u64,
}

/// Length of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Length {
    /// Optimiser steps.
    Steps(u64),
    /// Times that the training set is drawn from, each time as many batches as its clouds fill, at least one.
    Epochs(u64),
}

/// Many clouds of few points and a high rate: learns a small network fast on a CPU.
const FEW_POINTS: Rates = Rates {
    clouds: 128,
    learning_rate: 2e-2,
    warmup_steps: 500,
};

/// A network that a CPU trains in minutes.
const SMALL: NetworkSize = NetworkSize {
    width: 96,
    depth: 6,
    embedding: 128,
    condition_blocks: 0,
    octaves: 6,
    time_features: TimeFeatures::Late,
    context: None,
    channels: Channels::Xyz,
};

impl Preset {
    /// All of them; the first is the default.
    pub const ALL: [Self; 3] = [
        Self {
            name: "quick",
            purpose: "a small network in minutes on a CPU",
            size: SMALL,
            length: Length::Steps(5500),
            points: 128,
            validate_every: 550,
            sampler: Sampler::DEFAULT,
            refinement: Some(Refinement::DEFAULT),
            path: FlowPath::DEFAULT,
            optimizer: Optimizer::MUON,
            symmetry: SymmetryUse::Auto,
            procedure: Procedure::Project,
            layers: ContextLayers::Residual,
            rates: [FEW_POINTS; 2],
        },
        Self {
            name: "laptop",
            purpose: "a larger network in about half an hour on 2 cores",
            size: NetworkSize {
                width: 128,
                ..SMALL
            },
            length: Length::Steps(25_000),
            points: 128,
            validate_every: 2500,
            sampler: Sampler::DEFAULT,
            refinement: Some(Refinement {
                steps: 4000,
                ..Refinement::DEFAULT
            }),
            path: FlowPath::DEFAULT,
            optimizer: Optimizer::MUON,
            symmetry: SymmetryUse::Auto,
            procedure: Procedure::Project,
            layers: ContextLayers::Residual,
            rates: [FEW_POINTS; 2],
        },
        Self {
            name: "paper",
            purpose: "the authors' settings, for days on a CPU",
            size: NetworkSize {
                width: 512,
                depth: 6,
                embedding: 256,
                condition_blocks: 0,
                octaves: 0,
                time_features: TimeFeatures::Plain,
                context: None,
                channels: Channels::XyzRgb,
            },
            length: Length::Epochs(500),
            points: 20_000,
            validate_every: 5000,
            sampler: Sampler::PAPER,
            refinement: None,
            path: FlowPath::PAPER,
            optimizer: Optimizer::AdamW,
            symmetry: SymmetryUse::None,
            procedure: Procedure::Authors,
            layers: ContextLayers::Pvcnn,
            rates: [
                Rates {
                    clouds: 8,
                    learning_rate: 3e-4,
                    warmup_steps: 1000,
                },
                Rates {
                    clouds: 32,
                    learning_rate: 8e-4,
                    warmup_steps: 4000,
                },
            ],
        },
    ];

    /// The preset of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|preset| preset.name == name)
    }
}

impl Length {
    /// Steps of a run with batches of `clouds` clouds from a training set of `set` clouds.
    pub fn steps(self, clouds: usize, set: usize) -> u64 {
        match self {
            Self::Steps(steps) => steps,
            Self::Epochs(epochs) => epochs * (set / clouds.max(1)).max(1) as u64,
        }
    }
}

/// Flow time of a student's last denoising: its steps come as near to the surface as points do about then.
const STUDENT_DENOISE: f32 = 0.99;

/// The sampler of a student that predicts by `evaluations` of its network: Euler's steps on a grid of exponent `power`, and where
/// there are several evaluations, the last one is a denoising.
pub fn student_sampler(evaluations: usize, power: f32) -> Sampler {
    let several = evaluations > 1;
    Sampler {
        method: Method::Euler,
        steps: evaluations - usize::from(several),
        grid: TimeGrid::Power(power),
        denoise: several.then_some(STUDENT_DENOISE),
        ..Sampler::DEFAULT
    }
}

/// Settings of the distillation of a network trained with `teacher`, to the steps of `sampler`: lower rates than those that
/// the teacher was trained at, as the student starts where it ended.
pub fn distillation(teacher: &TrainSettings, sampler: Sampler, steps: u64) -> TrainSettings {
    TrainSettings {
        steps,
        clouds: sampler.evaluations() * 64usize.div_ceil(sampler.evaluations()),
        optimizer: Optimizer::Muon {
            learning_rate: 5e-3,
        },
        learning_rate: 5e-3,
        warmup_steps: (steps / 10).min(100),
        path: teacher.path,
        symmetry: teacher.symmetry,
        color_weight: teacher.color_weight,
        sampler,
        target: Target::Steps,
        validate_every: 500,
        ..TrainSettings::default()
    }
}

impl Default for Preset {
    fn default() -> Self {
        Self::ALL[0]
    }
}

impl Preset {
    /// Settings of a run of `steps` steps with the rates of one of the networks.
    pub fn settings(&self, rates: Rates, steps: u64) -> TrainSettings {
        TrainSettings {
            steps,
            clouds: rates.clouds,
            points: self.points,
            learning_rate: rates.learning_rate,
            warmup_steps: rates.warmup_steps.min(steps / 10),
            validate_every: self.validate_every,
            sampler: self.sampler,
            refinement: self
                .refinement
                .and_then(|refinement| refinement.at_most(steps / 3)),
            optimizer: self.optimizer,
            path: self.path,
            symmetry: self.symmetry,
            procedure: self.procedure,
            ..TrainSettings::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_preset_is_the_default_settings() {
        let quick = Preset::default();
        assert_eq!(quick.name, "quick");
        let settings = quick.settings(quick.rates[0], quick.length.steps(64, 1));
        let refinement = quick.refinement;
        assert_eq!(
            settings,
            TrainSettings {
                refinement,
                ..TrainSettings::default()
            }
        );
        let short = quick.settings(quick.rates[0], 60).refinement;
        assert_eq!(short.map(|refinement| refinement.steps), Some(20));
        assert_eq!(quick.settings(quick.rates[0], 2).refinement, None);
    }

    #[test]
    fn an_epoch_is_as_many_batches_as_the_clouds_fill() {
        assert_eq!(Length::Epochs(500).steps(8, 8000), 500_000);
        assert_eq!(Length::Epochs(3).steps(8, 17), 6);
        assert_eq!(Length::Epochs(3).steps(8, 7), 3);
        assert_eq!(Length::Steps(7).steps(8, 17), 7);
    }
}
