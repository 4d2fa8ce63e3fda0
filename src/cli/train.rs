//! `tdcr train`.

use std::path::PathBuf;

use anyhow::{anyhow, bail};
use clap::Args;
use serde::Serialize;
use tdcr::learn::data::{DataSet, Split};
use tdcr::learn::net::{Precision, Processor};
use tdcr::learn::options::{OptionsError, Resolved, RobotChoice, TrainOptions};
use tdcr::learn::train::Model;
use tdcr::pipeline::{StreamOptions, TrainingData, model_path, train};

use super::console::Console;
use super::scene::SceneArgs;

/// Train a velocity network on a data set or a stream by action-conditioned flow matching
///
/// Interrupted, the same command goes on where it stopped; with more --steps it goes on from where the run ended.
#[derive(Debug, Args)]
pub(super) struct TrainArgs {
    /// Folder of the data set
    // What a stream's options require is not asked for where it conflicts with what is given, so that these must conflict, too.
    #[arg(long, default_value = "data", value_name = "DIR", conflicts_with_all = ["StreamOptions", "scene"])]
    data: PathBuf,
    #[command(flatten)]
    stream: StreamArgs,
    /// Folder of the run: model, state, and the log as log.csv and for TensorBoard
    #[arg(long, default_value = "run", value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    options: TrainOptions,
}

/// Training without a data set.
#[derive(Debug, Args)]
struct StreamArgs {
    /// Train on fresh samples of this robot (as `tdcr collect --robot`) instead of a data set. Commands and points are
    /// scaled by the tendons' ranges and the reach of the straight robot
    #[arg(long, value_name = "ROBOT", conflicts_with = "data")]
    stream: Option<String>,
    #[command(flatten)]
    options: StreamOptions,
    #[command(flatten)]
    scene: SceneArgs,
}

/// The data set, in its own units or in those of a model.
fn set_data(args: &TrainArgs) -> anyhow::Result<TrainingData> {
    let dir = args.data.clone();
    let Some(file) = &args.options.normalisation_from else {
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
        if args.stream.scene.is_given() {
            bail!("--scene goes with --stream: a data set has the scene that it was collected in");
        }
        return set_data(args);
    };
    let robot = super::load_robot(robot)?;
    let scene = args.stream.scene.load()?;
    let stream = (args.stream.options).settings(robot, scene, args.options.seed);
    Ok(TrainingData::Stream(Box::new(stream)))
}

/// What is asked for, with the robot of its file; warns of what was ignored there.
fn options(args: &TrainArgs) -> anyhow::Result<TrainOptions> {
    let mut options = args.options.clone();
    options.check().map_err(in_words)?;
    if let Some(RobotChoice::Named(name)) = &options.surface_prior {
        options.surface_prior = Some(super::load_robot(name)?.into());
    }
    Ok(options)
}

/// What is wrong with options, by their names here.
fn in_words(error: OptionsError) -> anyhow::Error {
    match error {
        OptionsError::NoContext { option } => {
            anyhow!("--{option} is of --net hybrid, the network is an mlp")
        }
        OptionsError::Stages { .. } => anyhow!("--{error}"),
        other => other.into(),
    }
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
    let options = options(args)?;
    let data = training_data(args)?;
    let Resolved { shape, settings } = options.resolve(&data.facts()?).map_err(in_words)?;
    if let Some(asked) = options.points {
        warn_of_few_points(asked, &data)?;
    }
    let initial = options.init.as_deref().map(Model::load).transpose()?;
    let trained = train(
        &data,
        &args.out,
        shape,
        &settings,
        initial.as_ref(),
        console,
    )?;
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
