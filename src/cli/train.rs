//! `tdcr train`.

use std::fmt::Display;
use std::path::PathBuf;

use anyhow::ensure;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use serde::Serialize;
use tdcr::learn::data::{DataSet, PayloadRange, Recipe, Split, StreamSpec, Subject};
use tdcr::learn::flow::{Coupling, FlowPath};
use tdcr::learn::net::{Channels, ContextLayers, ContextShape, Precision, Processor, TimeFeatures};
use tdcr::learn::symmetry::SymmetryUse;
use tdcr::learn::train::{Model, Optimizer, TrainSettings};
use tdcr::pipeline::{
    Length, Preset, Rates, StreamSettings, TrainPlan, TrainingData, model_path, train,
};

use super::PrecisionArgs;
use super::console::Console;

/// Train a velocity network on a data set or a stream by action-conditioned flow matching
///
/// Interrupted, the same command goes on where it stopped; with more --steps it goes on from where the run ended.
#[derive(Debug, Args)]
pub(super) struct TrainArgs {
    /// Folder of the data set
    #[arg(long, default_value = "data", value_name = "DIR")]
    data: PathBuf,
    #[command(flatten)]
    stream: StreamArgs,
    /// Folder of the run: model, state, and the log as log.csv and for TensorBoard
    #[arg(long, default_value = "run", value_name = "DIR")]
    out: PathBuf,
    /// Network: each point on its own, or with features of the cloud around it
    #[arg(long, value_enum, default_value_t = Net::Mlp)]
    net: Net,
    /// Set of defaults, for the options that list one per preset
    #[arg(long, default_value = Preset::default().name, value_parser = preset())]
    preset: Preset,
    #[arg(long, value_name = "N", help = by_preset("Features per layer", |p| p.size.width))]
    width: Option<usize>,
    #[arg(long, value_name = "N", help = by_preset("Layers", |p| p.size.depth))]
    depth: Option<usize>,
    #[arg(long, value_name = "N", help = by_preset("Features of the embedding of time and command", |p| p.size.embedding))]
    embedding: Option<usize>,
    #[arg(long, value_name = "N", help = by_preset("Residual blocks that a command passes through, once per cloud, on its way to the embedding", |p| p.size.condition_blocks))]
    condition_blocks: Option<usize>,
    #[arg(long, value_name = "N", help = by_preset("Octaves of the Fourier features of the points' positions", |p| p.size.octaves))]
    octaves: Option<usize>,
    #[arg(long, value_parser = super::time_features(), help = by_preset("Features of the flow time that the network sees: half of them of the logarithm of the noise that is left, so that its last hundredths differ (late), or the paper's (plain)", |p| p.size.time_features.name()))]
    time_features: Option<TimeFeatures>,
    #[arg(long, help = by_preset("Learn the colours of the points beside their positions", |p| colored(p.size.channels)), overrides_with = "no_colors")]
    colors: bool,
    /// Learn positions alone
    #[arg(long, overrides_with = "colors")]
    no_colors: bool,
    /// Weight of the colours' error beside the positions'
    #[arg(long, default_value_t = TrainSettings::default().color_weight, value_name = "W", requires = "colors", allow_hyphen_values = true)]
    color_weight: f32,
    #[arg(long, value_name = "N", help = by_preset("Optimiser steps", |p| match p.length {
        Length::Steps(steps) => steps.to_string(),
        Length::Epochs(epochs) => format!("{epochs} epochs"),
    }))]
    steps: Option<u64>,
    #[arg(long, value_name = "N", help = by_network("Clouds per step", |r| r.clouds))]
    clouds: Option<usize>,
    #[arg(long, value_name = "N", help = by_preset("Points per cloud and step, or all that a cloud has", |p| p.points))]
    points: Option<usize>,
    #[command(flatten)]
    precision: PrecisionArgs,
    #[arg(long, value_enum, help = by_preset("Optimiser", |p| p.optimizer.name()))]
    optimizer: Option<OptimizerName>,
    #[arg(long, value_name = "RATE", help = by_network("Learning rate after warm-up; Muon's own follows in proportion", |r| r.learning_rate))]
    learning_rate: Option<f64>,
    #[arg(long, value_name = "N", help = by_network("Steps of warm-up, at most a tenth of all", |r| r.warmup_steps))]
    warmup: Option<u64>,
    #[arg(long, value_name = "N", help = by_preset("Steps between validations", |p| p.validate_every))]
    validate_every: Option<u64>,
    /// End the run after so many validations without a better one [default: take all steps]
    #[arg(long, value_name = "N")]
    patience: Option<u64>,
    /// How noise is coupled to the points of a cloud: independent, or optimal-transport[:K], matched within K points
    #[arg(long, default_value = "independent", value_name = "COUPLING")]
    coupling: Coupling,
    /// Flow times are Beta(ALPHA, 1): 1 is uniform, above it they are mostly near the data
    #[arg(long, default_value_t = FlowPath::default().time_exponent, value_name = "ALPHA", allow_hyphen_values = true)]
    time_exponent: f32,
    #[arg(long, value_name = "SHARE", allow_hyphen_values = true, help = by_preset("Share of the flow times that are drawn near the data instead, with 1 - t log-uniform from 0.003 to 0.15", |p| p.path.late_times))]
    late_times: Option<f32>,
    #[arg(long, value_name = "R", allow_hyphen_values = true, help = by_preset("Where the noise that the flow starts from is cut off, in its standard deviations; 0: nowhere", |p| p.path.prior_cut.unwrap_or(0.0)))]
    prior_cut: Option<f32>,
    #[arg(long, value_name = "N", help = by_preset("Steps of the refinement, at most a third of --steps: a copy of the network learns on the ends of its own flow, and takes its place in the last evaluation of a prediction; 0: none", |p| p.refinement.map_or(0, |refinement| refinement.steps)))]
    refinement_steps: Option<u64>,
    /// Start the flow from the simulated surface of this robot (as `tdcr collect --robot`) under the same command, not from
    /// noise: for a model of the robot that the data show, which needs few samples then
    #[arg(long, value_name = "ROBOT", conflicts_with = "stream")]
    surface_prior: Option<String>,
    #[arg(long, value_parser = super::symmetry_use(), help = by_preset("Learn one representative of all commands that the robot's symmetries make alike, such as permuted tendons, where robot, base and cameras have them (auto), or every command (none)", |p| p.symmetry.name()))]
    symmetry: Option<SymmetryUse>,
    /// Standard deviation of the noise that the flow starts from, in units of the data's scale [default: 0.5; 0.005 about a
    /// simulated surface]
    #[arg(long, value_name = "SIGMA", allow_hyphen_values = true)]
    prior_deviation: Option<f32>,
    /// Start from the weights of this model, which has the same shape, robot and normalisation: to continue a run with
    /// other settings [default: random weights]
    #[arg(long, value_name = "FILE")]
    init: Option<PathBuf>,
    /// Normalise commands and points as this model does, not by the data set's own ranges. Needed with --init to continue
    /// from simulated to recorded clouds, or on a set that has grown. Commands must be in the model's units
    #[arg(long, value_name = "FILE", conflicts_with = "stream")]
    normalisation_from: Option<PathBuf>,
    /// Seed of weights, noise and subsets
    #[arg(long, default_value_t = 0)]
    seed: u64,
    // The heading holds for what follows it.
    #[command(flatten)]
    context: ContextArgs,
}

/// Whether colours are learned, in a word.
fn colored(channels: Channels) -> &'static str {
    match channels == Channels::XyzRgb {
        true => "yes",
        false => "no",
    }
}

/// Parses the name of a preset.
fn preset() -> impl TypedValueParser<Value = Preset> {
    let value = |preset: Preset| PossibleValue::new(preset.name).help(preset.purpose);
    PossibleValuesParser::new(Preset::ALL.map(value))
        .map(|name| Preset::named(&name).expect("one of the possible values"))
}

/// The help of an option whose default is the preset's.
fn by_preset<T: Display>(about: &str, value: fn(&Preset) -> T) -> String {
    let defaults = Preset::ALL.map(|preset| format!("{} {}", preset.name, value(&preset)));
    format!("{about} [default: {}]", defaults.join(", "))
}

/// The same where it may be another for the hybrid network.
fn by_network<T: Display + PartialEq>(about: &str, value: fn(&Rates) -> T) -> String {
    let defaults = Preset::ALL.map(|preset| {
        let [mlp, hybrid] = preset.rates.each_ref().map(value);
        match mlp == hybrid {
            true => format!("{} {mlp}", preset.name),
            false => format!("{} {mlp}, hybrid {hybrid}", preset.name),
        }
    });
    format!("{about} [default: {}]", defaults.join("; "))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Net {
    /// Each point on its own
    Mlp,
    /// Point-voxel convolutions add features of the cloud around each point; far slower
    Hybrid,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum OptimizerName {
    /// AdamW for all weights, the paper's; takes lower learning rates
    Adamw,
    /// Muon for the hidden layers' matrices, AdamW for the rest
    Muon,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Layers {
    /// Residual blocks with GroupNorm, which learn from clouds one after another
    Residual,
    /// The authors', with BatchNorm: trained by `python -m tdcr.torch.train`
    Pvcnn,
}

/// Layers and sizes of the context network.
#[derive(Debug, Args)]
#[command(next_help_heading = "Context of --net hybrid")]
struct ContextArgs {
    #[arg(long, value_enum, help = by_preset("Layers of the context network", |p| p.layers.name()))]
    layers: Option<Layers>,
    /// Features of the three stages [default: 80,112,112]
    #[arg(long, value_name = "N,N,N", value_delimiter = ',')]
    channels: Option<Vec<usize>>,
    /// Voxels per edge in the three stages [default: 24,16,8]
    #[arg(long, value_name = "N,N,N", value_delimiter = ',')]
    resolutions: Option<Vec<usize>>,
    /// Point-voxel blocks per stage [default: 2]
    #[arg(long, value_name = "N")]
    blocks: Option<usize>,
    /// Features of a point's context [default: 64]
    #[arg(long, value_name = "N")]
    context: Option<usize>,
}

impl ContextArgs {
    /// The context network's shape; none for an MLP, which has none.
    fn shape(&self, net: Net, preset: &Preset) -> anyhow::Result<Option<ContextShape>> {
        if net == Net::Mlp {
            for (option, given) in [
                ("layers", self.layers.is_some()),
                ("channels", self.channels.is_some()),
                ("resolutions", self.resolutions.is_some()),
                ("blocks", self.blocks.is_some()),
                ("context", self.context.is_some()),
            ] {
                ensure!(
                    !given,
                    "--{option} is of --net hybrid, the network is an mlp"
                );
            }
            return Ok(None);
        }
        let mut shape = ContextShape::of(match self.layers {
            None => preset.layers,
            Some(Layers::Residual) => ContextLayers::Residual,
            Some(Layers::Pvcnn) => ContextLayers::Pvcnn,
        });
        for (stage, channels) in per_stage("channels", self.channels.as_deref())? {
            shape.stages[stage].channels = channels;
        }
        for (stage, resolution) in per_stage("resolutions", self.resolutions.as_deref())? {
            shape.stages[stage].resolution = resolution;
        }
        shape.blocks = self.blocks.unwrap_or(shape.blocks);
        shape.features = self.context.unwrap_or(shape.features);
        Ok(Some(shape))
    }
}

/// The values of an option, one per stage; none where it is not given.
fn per_stage(
    option: &str,
    values: Option<&[usize]>,
) -> anyhow::Result<impl Iterator<Item = (usize, usize)>> {
    let values = values.unwrap_or_default();
    ensure!(
        values.is_empty() || values.len() == 3,
        "--{option} has {} values, expected 3, one per stage",
        values.len()
    );
    Ok(values.iter().copied().enumerate())
}

/// Training without a data set.
#[derive(Debug, Args)]
struct StreamArgs {
    /// Train on fresh samples of this robot (as `tdcr collect --robot`) instead of a data set. Commands and points are
    /// scaled by the tendons' ranges and the reach of the straight robot
    #[arg(long, value_name = "ROBOT", conflicts_with = "data")]
    stream: Option<String>,
    /// Show the robot's base to the stream's cameras
    #[arg(long, requires = "stream")]
    base: bool,
    /// Payloads of the stream (kg)
    #[arg(long, value_name = "MIN:MAX", value_parser = super::collect::payload_range, requires = "stream", allow_hyphen_values = true)]
    payload: Option<PayloadRange>,
    /// Points per cloud of the stream
    #[arg(long, default_value_t = StreamSpec::default().points, value_name = "N", value_parser = super::amount, requires = "stream")]
    stream_points: usize,
    /// Edge of the voxels that thin the stream's clouds (m)
    #[arg(long, default_value_t = Recipe::default().voxel_size, value_name = "M", value_parser = super::positive, requires = "stream")]
    voxel: f64,
    /// Simulate the noise of a real depth camera in the stream's clouds
    #[arg(long, value_enum, requires = "stream")]
    noise: Option<super::Noise>,
    /// Clouds of the stream that a step draws from
    #[arg(long, default_value_t = StreamSettings::default().window, value_name = "N", value_parser = super::amount, requires = "stream")]
    window: usize,
    /// Clouds of the window that are replaced by fresh ones after each step
    #[arg(long, default_value_t = StreamSettings::default().fresh, value_name = "N", value_parser = super::amount, requires = "stream")]
    fresh: usize,
    /// Folder of a data set whose val split validates; by default clouds of the stream that no step sees
    #[arg(long, value_name = "DIR", requires = "stream")]
    validation: Option<PathBuf>,
}

/// The data set, in its own units or in those of a model.
fn set_data(args: &TrainArgs) -> anyhow::Result<TrainingData> {
    let dir = args.data.clone();
    let Some(file) = &args.normalisation_from else {
        return Ok(TrainingData::Set(dir));
    };
    let units = Model::load(file)?.provenance.normalisation;
    let own = DataSet::open(&dir)?.normalisation().clone();
    for (what, command) in [("smallest", &own.motor_min), ("largest", &own.motor_max)] {
        for range in units.out_of_range(command)? {
            let width = range.max - range.min;
            if !(range.min - width..=range.max + width).contains(&range.value) {
                tracing::warn!(
                    "the {what} value of motor {} in {} is {}, far outside the model's {} to {}: are they in one unit?",
                    range.index + 1,
                    dir.display(),
                    range.value,
                    range.min,
                    range.max
                );
            }
        }
    }
    Ok(TrainingData::SetIn(dir, Box::new(units)))
}

/// The data set, or the stream where one is asked for.
fn training_data(args: &TrainArgs) -> anyhow::Result<TrainingData> {
    let Some(robot) = &args.stream.stream else {
        return set_data(args);
    };
    let StreamArgs {
        base,
        payload,
        stream_points,
        voxel,
        noise,
        window,
        fresh,
        ref validation,
        ..
    } = args.stream;
    let subject = Subject {
        robot: super::load_robot(robot)?,
        base: super::visibility(base),
        payload,
    };
    let recipe = Recipe {
        subject,
        voxel_size: voxel,
        sensor: noise.map(super::Noise::sensor),
    };
    Ok(TrainingData::Stream(Box::new(StreamSettings {
        spec: StreamSpec {
            recipe,
            points: stream_points,
            seed: args.seed,
        },
        window,
        fresh,
        validation: validation.clone(),
    })))
}

/// What is asked for.
fn plan(args: &TrainArgs) -> anyhow::Result<TrainPlan> {
    Ok(TrainPlan {
        preset: args.preset,
        width: args.width,
        depth: args.depth,
        embedding: args.embedding,
        context: args.context.shape(args.net, &args.preset)?,
        channels: match (args.colors, args.no_colors) {
            (true, _) => Some(Channels::XyzRgb),
            (_, true) => Some(Channels::Xyz),
            (false, false) => None,
        },
        color_weight: args.color_weight,
        steps: args.steps,
        clouds: args.clouds,
        points: args.points,
        precision: args.precision.precision,
        optimizer: args.optimizer.map(|name| match name {
            OptimizerName::Adamw => Optimizer::AdamW,
            OptimizerName::Muon => Optimizer::MUON,
        }),
        learning_rate: args.learning_rate,
        warmup_steps: args.warmup,
        validate_every: args.validate_every,
        patience: args.patience,
        coupling: args.coupling,
        time_exponent: args.time_exponent,
        late_times: args.late_times,
        prior_cut: args.prior_cut,
        refinement_steps: args.refinement_steps,
        condition_blocks: args.condition_blocks,
        octaves: args.octaves,
        time_features: args.time_features,
        surface_prior: args
            .surface_prior
            .as_deref()
            .map(super::load_robot)
            .transpose()?,
        symmetry: args.symmetry,
        prior_deviation: args.prior_deviation,
        seed: args.seed,
    })
}

/// Says where the clouds have fewer points than `asked` for: steps take all that there are.
fn warn_of_few_points(asked: usize, data: &TrainingData) -> anyhow::Result<()> {
    let found = match data {
        TrainingData::Set(dir) | TrainingData::SetIn(dir, _) => {
            DataSet::open(dir)?.points_per_cloud(Split::Train)?
        }
        TrainingData::Stream(stream) => stream.spec.points,
    };
    if asked > found {
        tracing::warn!(
            "--points {asked} is more than the {found} points of a cloud: every step takes all {found}"
        );
    }
    Ok(())
}

#[derive(Serialize)]
struct Run {
    model: PathBuf,
    parameters: usize,
    steps: u64,
    best_step: u64,
    /// Validation Chamfer distance of the best step (m²).
    validation_cd: f64,
    /// Operand type of the network's matrix products.
    precision: Precision,
    /// Vector width of the kernels that it ran on (numbers).
    vector_lanes: usize,
}

pub(super) fn run(args: &TrainArgs, console: &Console) -> anyhow::Result<()> {
    super::output::folder("--out", &args.out, "a folder for the run")?;
    let plan = plan(args)?;
    let data = training_data(args)?;
    let (size, settings) = plan.settle(&data)?;
    if let Some(asked) = args.points {
        warn_of_few_points(asked, &data)?;
    }
    let initial = args.init.as_deref().map(Model::load).transpose()?;
    let trained = train(&data, &args.out, size, &settings, initial.as_ref(), console)?;
    let scale = trained.model.provenance.normalisation.scale;
    let run = Run {
        model: model_path(&args.out),
        parameters: trained.model.network.shape().learned_parameters(),
        steps: trained.losses.len() as u64,
        best_step: trained.model.step,
        validation_cd: trained.model.validation_distance * scale * scale,
        precision: settings.precision,
        vector_lanes: Processor::detect().vector_lanes,
    };
    console.summary(&run, |r| {
        format!(
            "{}: {} parameters, best at step {} of {}, validation CD {:.3e} m²",
            r.model.display(),
            r.parameters,
            r.best_step,
            r.steps,
            r.validation_cd
        )
    })
}
