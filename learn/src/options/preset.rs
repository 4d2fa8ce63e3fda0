//! Options that fit together.

use serde::{Deserialize, Serialize};

use super::{Net, OptimizerName, TrainOptions};
use crate::flow::{FlowPath, Sampler};
use crate::net::{Channels, ContextLayers, MlpShape, TimeFeatures};
use crate::symmetry::SymmetryUse;
use crate::train::{Procedure, Refinement, TrainSettings};

/// A set of options that fit together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// A small network in minutes on a CPU: the defaults of [`MlpShape`] and [`TrainSettings`].
    #[default]
    Quick,
    /// A larger network in about half an hour on 2 cores.
    Laptop,
    /// The authors' settings, for days on a CPU.
    Paper,
}

impl Preset {
    /// All of them; the first is the default.
    pub const ALL: [Self; 3] = [Self::Quick, Self::Laptop, Self::Paper];

    /// Times that the training set is drawn from by a preset that says no steps, each time as many batches as its clouds fill.
    pub const EPOCHS: u64 = 500;

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Quick => "quick",
            Self::Laptop => "laptop",
            Self::Paper => "paper",
        }
    }

    /// What it is for.
    pub fn purpose(self) -> &'static str {
        match self {
            Self::Quick => "a small network in minutes on a CPU",
            Self::Laptop => "a larger network in about half an hour on 2 cores",
            Self::Paper => "the authors' settings, for days on a CPU",
        }
    }

    /// Its options for this kind of network: a value of all whose default is the preset's. Without steps, a run takes
    /// [`Preset::EPOCHS`].
    pub fn options(self, net: Net) -> TrainOptions {
        match self {
            Self::Quick => quick(net),
            Self::Laptop => TrainOptions {
                preset: self,
                width: Some(128),
                steps: Some(25_000),
                validate_every: Some(2500),
                refinement_steps: Some(4000),
                ..quick(net)
            },
            Self::Paper => paper(net),
        }
    }

    /// Settings that no option says.
    pub(super) fn settings(self) -> TrainSettings {
        match self {
            Self::Quick | Self::Laptop => TrainSettings::default(),
            Self::Paper => TrainSettings {
                procedure: Procedure::Authors,
                sampler: Sampler::PAPER,
                ..TrainSettings::default()
            },
        }
    }
}

/// Many clouds of few points and a high rate learn a small network fast on a CPU.
fn quick(net: Net) -> TrainOptions {
    let MlpShape {
        width,
        depth,
        embedding,
        condition_dim: _,
        condition_blocks,
        octaves,
        time_features,
        channels,
    } = MlpShape::default();
    let settings = TrainSettings::default();
    TrainOptions {
        net,
        preset: Preset::Quick,
        width: Some(width),
        depth: Some(depth),
        embedding: Some(embedding),
        condition_blocks: Some(condition_blocks),
        octaves: Some(octaves),
        time_features: Some(time_features),
        colors: Some(channels == Channels::XyzRgb),
        steps: Some(settings.steps),
        clouds: Some(settings.clouds),
        points: Some(settings.points),
        optimizer: Some(OptimizerName::Muon),
        learning_rate: Some(settings.learning_rate),
        warmup: Some(settings.warmup_steps),
        validate_every: Some(settings.validate_every),
        late_times: Some(settings.path.late_times),
        prior_cut: Some(settings.path.prior_cut.unwrap_or(0.0)),
        refinement_steps: Some(Refinement::DEFAULT.steps),
        symmetry: Some(settings.symmetry),
        layers: Some(ContextLayers::Residual),
        ..TrainOptions::default()
    }
}

/// The authors' network and training, whose batch and rate differ between an MLP and a hybrid.
fn paper(net: Net) -> TrainOptions {
    let (clouds, learning_rate, warmup) = match net {
        Net::Mlp => (8, 3e-4, 1000),
        Net::Hybrid => (32, 8e-4, 4000),
    };
    TrainOptions {
        net,
        preset: Preset::Paper,
        width: Some(512),
        depth: Some(6),
        embedding: Some(256),
        condition_blocks: Some(0),
        octaves: Some(0),
        time_features: Some(TimeFeatures::Plain),
        colors: Some(true),
        clouds: Some(clouds),
        points: Some(20_000),
        optimizer: Some(OptimizerName::Adamw),
        learning_rate: Some(learning_rate),
        warmup: Some(warmup),
        validate_every: Some(5000),
        late_times: Some(FlowPath::PAPER.late_times),
        prior_cut: Some(0.0),
        refinement_steps: Some(0),
        symmetry: Some(SymmetryUse::None),
        layers: Some(ContextLayers::Pvcnn),
        ..TrainOptions::default()
    }
}
