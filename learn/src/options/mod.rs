//! What a training run is asked for, and what becomes of it.
//!
//! [`TrainOptions`] is the one list of a run's options. The command line (`tdcr train`), Python (`tdcr.train`) and training in
//! PyTorch take their names, documentation and types from it, so a new option is a field here and its line in
//! [`TrainOptions::resolve`]. A [`Preset`] is a value of it; [`TrainOptions::resolve`] makes network and settings of the options, with
//! all defaults that depend on others.

#[cfg(feature = "cli")]
pub mod cli;
mod preset;
mod resolve;
mod robot;

pub use preset::Preset;
pub use resolve::{DataFacts, OptionsError, Resolved};
pub use robot::RobotChoice;

use std::fmt::Display;
use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::flow::{Coupling, FlowPath};
use crate::net::{ContextLayers, Precision, TimeFeatures};
use crate::symmetry::SymmetryUse;
use crate::train::{Optimizer, TrainSettings};

/// Options of a training run; what is `None` is the preset's, unless its documentation says otherwise.
///
/// In JSON a field has the name of its option.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[cfg_attr(
    feature = "cli",
    derive(clap::Args),
    command(mut_args(cli::with_preset_values))
)]
pub struct TrainOptions {
    /// Network: each point on its own, or with features of the cloud around it.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub net: Net,
    /// Set of defaults, for the options that list one per preset.
    #[cfg_attr(
        feature = "cli",
        arg(long, default_value = Preset::default().name(), value_parser = cli::preset())
    )]
    pub preset: Preset,
    /// Features per layer.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub width: Option<usize>,
    /// Layers.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub depth: Option<usize>,
    /// Features of the embedding of time and command.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub embedding: Option<usize>,
    /// Residual blocks that a command passes through, once per cloud, on its way to the embedding.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub condition_blocks: Option<usize>,
    /// Octaves of the Fourier features of the points' positions.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub octaves: Option<usize>,
    /// Features of the flow time that the network sees: half of them of the logarithm of the noise that is left, so that its last
    /// hundredths differ (late), or the paper's (plain).
    #[cfg_attr(
        feature = "cli",
        arg(long, value_parser = cli::named(TimeFeatures::ALL, TimeFeatures::name))
    )]
    pub time_features: Option<TimeFeatures>,
    /// Learn the colours of the points beside their positions.
    #[cfg_attr(
        feature = "cli",
        arg(
            long,
            num_args = 0,
            default_missing_value = "true",
            overrides_with = "no_colors"
        )
    )]
    pub colors: Option<bool>,
    /// Learn positions alone.
    // The other half of a switch: in JSON, `colors` is false.
    #[cfg_attr(feature = "cli", arg(long, overrides_with = "colors"))]
    #[serde(skip)]
    pub no_colors: bool,
    /// Weight of the colours' error beside the positions'.
    #[cfg_attr(
        feature = "cli",
        arg(
            long,
            default_value_t = TrainSettings::COLOR_WEIGHT,
            value_name = "W",
            requires = "colors",
            allow_hyphen_values = true
        )
    )]
    pub color_weight: f32,
    /// Optimiser steps.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub steps: Option<u64>,
    /// Clouds per step.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub clouds: Option<usize>,
    /// Points per cloud and step, or all that a cloud has.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub points: Option<usize>,
    /// Operand type of the network's matrix products: bfloat16 has 8 significant bits. It is many times faster on a processor
    /// with a matrix unit (AMX), and faster on AMD's with AVX-512 BF16. Sums are float32 in either [default: bfloat16 on
    /// such a processor if the width is a multiple of 32, else float32].
    #[cfg_attr(
        feature = "cli",
        arg(long, value_parser = cli::named(Precision::ALL, Precision::name))
    )]
    pub precision: Option<Precision>,
    /// Optimiser.
    #[cfg_attr(feature = "cli", arg(long, value_enum))]
    pub optimizer: Option<OptimizerName>,
    /// Learning rate after warm-up; Muon's own follows in proportion.
    #[cfg_attr(feature = "cli", arg(long, value_name = "RATE"))]
    pub learning_rate: Option<f64>,
    /// Steps of warm-up, at most a tenth of all.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub warmup: Option<u64>,
    /// Steps between validations.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub validate_every: Option<u64>,
    /// End the run after so many validations without a better one [default: take all steps].
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub patience: Option<u64>,
    /// How noise is coupled to the points of a cloud: independent, or optimal-transport[:K], matched within K points.
    #[cfg_attr(
        feature = "cli",
        arg(long, default_value = "independent", value_name = "COUPLING")
    )]
    // The brackets are no link: they say that `:K` may be left out.
    #[allow(rustdoc::broken_intra_doc_links)]
    #[serde(serialize_with = "to_text", deserialize_with = "from_text")]
    pub coupling: Coupling,
    /// Flow times are Beta(ALPHA, 1): 1 is uniform, above it they are mostly near the data.
    #[cfg_attr(
        feature = "cli",
        arg(
            long,
            default_value_t = FlowPath::DEFAULT.time_exponent,
            value_name = "ALPHA",
            allow_hyphen_values = true
        )
    )]
    pub time_exponent: f32,
    /// Share of the flow times that are drawn near the data instead, with 1 - t log-uniform from 0.003 to 0.15.
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "SHARE", allow_hyphen_values = true)
    )]
    pub late_times: Option<f32>,
    /// Where the noise that the flow starts from is cut off, in its standard deviations; 0: nowhere.
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "R", allow_hyphen_values = true)
    )]
    pub prior_cut: Option<f32>,
    /// Steps of the refinement, at most a third of --steps: a copy of the network learns on the ends of its own flow, and takes its
    /// place in the last evaluation of a prediction; 0: none.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub refinement_steps: Option<u64>,
    /// Start the flow from the simulated surface of this robot (as `tdcr collect --robot`) under the same command, not from
    /// noise: for a model of the robot that the data show, which needs few samples then.
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "ROBOT", conflicts_with = "stream")
    )]
    pub surface_prior: Option<RobotChoice>,
    /// Learn one representative of all commands that the robot's symmetries make alike, such as permuted tendons, where robot, base
    /// and cameras have them (auto), or every command (none).
    #[cfg_attr(
        feature = "cli",
        arg(long, value_parser = cli::named(SymmetryUse::ALL, SymmetryUse::name))
    )]
    pub symmetry: Option<SymmetryUse>,
    /// Standard deviation of the noise that the flow starts from, in units of the data's scale [default: 0.5; 0.005 about a
    /// simulated surface].
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "SIGMA", allow_hyphen_values = true)
    )]
    pub prior_deviation: Option<f32>,
    /// Start from the weights of this model, which has the same shape, robot and normalisation: to continue a run with
    /// other settings [default: random weights].
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub init: Option<PathBuf>,
    /// Normalise commands and points as this model does, not by the data set's own ranges. Needed with --init to continue
    /// from simulated to recorded clouds, or on a set that has grown. Commands must be in the model's units.
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "FILE", conflicts_with = "stream")
    )]
    pub normalisation_from: Option<PathBuf>,
    /// Seed of weights, noise and subsets.
    #[cfg_attr(feature = "cli", arg(long, default_value_t = 0))]
    pub seed: u64,
    /// Layers of the context network.
    #[cfg_attr(
        feature = "cli",
        arg(long, value_parser = cli::layers(), help_heading = cli::CONTEXT)
    )]
    pub layers: Option<ContextLayers>,
    /// Features of the three stages [default: 80,112,112].
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "N,N,N", value_delimiter = ',', help_heading = cli::CONTEXT)
    )]
    pub channels: Option<Vec<usize>>,
    /// Voxels per edge in the three stages [default: 24,16,8].
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "N,N,N", value_delimiter = ',', help_heading = cli::CONTEXT)
    )]
    pub resolutions: Option<Vec<usize>>,
    /// Point-voxel blocks per stage [default: 2].
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "N", help_heading = cli::CONTEXT)
    )]
    pub blocks: Option<usize>,
    /// Features of a point's context [default: 64].
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "N", help_heading = cli::CONTEXT)
    )]
    pub context: Option<usize>,
}

/// Those of the command line: an MLP by the default preset.
impl Default for TrainOptions {
    fn default() -> Self {
        Self {
            net: Net::default(),
            preset: Preset::default(),
            width: None,
            depth: None,
            embedding: None,
            condition_blocks: None,
            octaves: None,
            time_features: None,
            colors: None,
            no_colors: false,
            color_weight: TrainSettings::COLOR_WEIGHT,
            steps: None,
            clouds: None,
            points: None,
            precision: None,
            optimizer: None,
            learning_rate: None,
            warmup: None,
            validate_every: None,
            patience: None,
            coupling: FlowPath::DEFAULT.coupling,
            time_exponent: FlowPath::DEFAULT.time_exponent,
            late_times: None,
            prior_cut: None,
            refinement_steps: None,
            surface_prior: None,
            symmetry: None,
            prior_deviation: None,
            init: None,
            normalisation_from: None,
            seed: 0,
            layers: None,
            channels: None,
            resolutions: None,
            blocks: None,
            context: None,
        }
    }
}

/// Which network is trained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Net {
    /// Each point on its own.
    #[default]
    Mlp,
    /// Point-voxel convolutions add features of the cloud around each point; far slower.
    Hybrid,
}

/// An optimiser, whose rates are in proportion to the run's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum OptimizerName {
    /// AdamW for all weights, the paper's; takes lower learning rates.
    // As it stands in the settings of a model.
    #[serde(alias = "adam-w")]
    Adamw,
    /// Muon for the hidden layers' matrices, AdamW for the rest.
    Muon,
}

impl OptimizerName {
    /// The optimiser, at the rates of the presets.
    fn optimizer(self) -> Optimizer {
        match self {
            Self::Adamw => Optimizer::AdamW,
            Self::Muon => Optimizer::MUON,
        }
    }
}

/// Writes a value as the command line takes it.
fn to_text<S: Serializer>(value: &impl Display, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(value)
}

/// Reads a value as the command line does.
fn from_text<'de, D, T>(deserializer: D) -> Result<T, D::Error>
where
    D: Deserializer<'de>,
    T: FromStr<Err: Display>,
{
    let text = String::deserialize(deserializer)?;
    text.parse().map_err(serde::de::Error::custom)
}
