//! `tdcr train`.

use std::path::PathBuf;

use anyhow::ensure;
use clap::{Args, ValueEnum};
use serde::Serialize;
use tdcr::learn::data::{PayloadRange, Recipe, StreamSpec, Subject};
use tdcr::learn::net::{Channels, ContextShape};
use tdcr::learn::train::TrainSettings;
use tdcr::pipeline::{NetworkSize, StreamSettings, TrainingData, model_path, train};

use super::console::Console;

/// Train a velocity network on a data set or a stream by action-conditioned flow matching
///
/// Interrupted, the same command goes on where it stopped.
#[derive(Debug, Args)]
pub(super) struct TrainArgs {
    /// Folder of the data set
    #[arg(long, default_value = "data", value_name = "DIR")]
    data: PathBuf,
    #[command(flatten)]
    stream: StreamArgs,
    /// Folder of the run: model and state
    #[arg(long, default_value = "run", value_name = "DIR")]
    out: PathBuf,
    /// Network: every point alone, or with a context from the cloud about it
    #[arg(long, value_enum, default_value_t = Net::Mlp)]
    net: Net,
    /// Features per layer
    #[arg(long, default_value_t = 96, value_name = "N")]
    width: usize,
    /// Layers
    #[arg(long, default_value_t = 6, value_name = "N")]
    depth: usize,
    /// Features of the embedding of time and command
    #[arg(long, default_value_t = 128, value_name = "N")]
    embedding: usize,
    /// Learn the colours of the points beside their positions
    #[arg(long)]
    colors: bool,
    /// Optimiser steps
    #[arg(long, default_value_t = TrainSettings::default().steps, value_name = "N")]
    steps: u64,
    /// Clouds per step
    #[arg(long, default_value_t = TrainSettings::default().clouds, value_name = "N")]
    clouds: usize,
    /// Points per cloud and step
    #[arg(long, default_value_t = TrainSettings::default().points, value_name = "N")]
    points: usize,
    /// Learning rate after warm-up
    #[arg(long, default_value_t = TrainSettings::default().learning_rate, value_name = "RATE")]
    learning_rate: f64,
    /// Steps between validations
    #[arg(long, default_value_t = TrainSettings::default().validate_every, value_name = "N")]
    validate_every: u64,
    /// Seed of weights, noise and subsets
    #[arg(long, default_value_t = 0)]
    seed: u64,
    // The heading holds for what follows it.
    #[command(flatten)]
    context: ContextArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Net {
    /// Every point alone
    Mlp,
    /// Point-voxel convolutions give points a context; far slower
    Hybrid,
}

/// Sizes of the context network.
#[derive(Debug, Args)]
#[command(next_help_heading = "Context of --net hybrid")]
struct ContextArgs {
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
    fn shape(&self, net: Net) -> anyhow::Result<Option<ContextShape>> {
        if net == Net::Mlp {
            for (option, given) in [
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
        let mut shape = ContextShape::default();
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
    /// Train on fresh samples of this robot instead of a data set: 2m, 3m, 5m, or a robot file. Commands and points are
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
    #[arg(long, default_value_t = 2000, value_name = "N", value_parser = super::amount, requires = "stream")]
    stream_points: usize,
    /// Edge of the voxels that thin the stream's clouds (m)
    #[arg(long, default_value_t = 0.002, value_name = "M", value_parser = super::positive, requires = "stream")]
    voxel: f64,
    /// See the stream's clouds with the faults of a real camera
    #[arg(long, value_enum, requires = "stream")]
    noise: Option<super::Noise>,
    /// Clouds of the stream that a step draws from
    #[arg(long, default_value_t = 512, value_name = "N", value_parser = super::amount, requires = "stream")]
    window: usize,
    /// Clouds of the window that are replaced by fresh ones after each step
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = super::amount, requires = "stream")]
    fresh: usize,
    /// Folder of a data set whose val split validates; by default clouds of the stream that no step sees
    #[arg(long, value_name = "DIR", requires = "stream")]
    validation: Option<PathBuf>,
}

/// The data set, or the stream where one is asked for.
fn training_data(args: &TrainArgs) -> anyhow::Result<TrainingData> {
    let Some(robot) = &args.stream.stream else {
        return Ok(TrainingData::Set(args.data.clone()));
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

#[derive(Serialize)]
struct Run {
    model: PathBuf,
    parameters: usize,
    steps: u64,
    best_step: u64,
    /// Validation Chamfer distance of the best step (m²).
    validation_cd: f64,
}

pub(super) fn run(args: &TrainArgs, console: &Console) -> anyhow::Result<()> {
    let size = NetworkSize {
        width: args.width,
        depth: args.depth,
        embedding: args.embedding,
        context: args.context.shape(args.net)?,
        channels: match args.colors {
            true => Channels::XyzRgb,
            false => Channels::Xyz,
        },
    };
    let defaults = TrainSettings::default();
    let settings = TrainSettings {
        steps: args.steps,
        clouds: args.clouds,
        points: args.points,
        learning_rate: args.learning_rate,
        warmup_steps: defaults.warmup_steps.min(args.steps / 10),
        validate_every: args.validate_every,
        seed: args.seed,
        ..defaults
    };
    let data = training_data(args)?;
    let trained = train(&data, &args.out, size, &settings, console)?;
    let scale = trained.model.provenance.normalisation.scale;
    let run = Run {
        model: model_path(&args.out),
        parameters: trained.model.network.params().len(),
        steps: args.steps,
        best_step: trained.model.step,
        validation_cd: trained.model.validation_distance * scale * scale,
    };
    console.result(&run, |r| {
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
