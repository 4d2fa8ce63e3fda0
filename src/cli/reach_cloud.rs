//! `tdcr reach --cloud`: the command under which a trained model sees a wanted cloud.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use serde::Serialize;
use tdcr::learn::data::{Normalisation, OutOfRange, read_cloud};
use tdcr::learn::train::Model;
use tdcr::pipeline::Monitor;
use tdcr::reach::{CloudSearch, reach_cloud};
use tdcr::report::counted;

use super::console::{Console, Interrupted};

/// A cloud in place of a point.
#[derive(Debug, Args)]
pub(super) struct CloudArgs {
    /// Cloud that the robot is to look like (.ply, .pcd, .npy or .npz; m, world frame): the command is looked for by a trained model
    /// alone, from the middle of its training data's
    #[arg(
        long,
        value_name = "FILE",
        conflicts_with_all = ["name_or_path", "scene", "wrenches", "line_load", "tolerance", "out"]
    )]
    pub cloud: Option<PathBuf>,
    /// The trained model of --cloud
    #[arg(
        long,
        default_value = "run/model.safetensors",
        value_name = "FILE",
        requires = "cloud"
    )]
    model: PathBuf,
    /// Command that --cloud starts from, separated by commas
    #[arg(long, value_parser = super::numbers, allow_hyphen_values = true, value_name = "C,C,...", requires = "cloud")]
    start: Option<Box<[f64]>>,
    /// Most steps of --cloud
    #[arg(long, default_value_t = 20, value_name = "N", requires = "cloud")]
    steps: usize,
    /// Points of the clouds that --cloud predicts
    #[arg(long, default_value_t = 2048, value_name = "N", requires = "cloud")]
    points: usize,
}

#[derive(Serialize)]
struct Found<'a> {
    cloud: &'a Path,
    model: &'a Path,
    /// Command (m, N, or the units of imported motors).
    command: &'a [f64],
    /// Mass hung from the tip (kg), where the model takes one.
    payload: Option<f64>,
    /// Mean distance of the points of the wanted cloud and the predicted one from each other (m).
    mean_distance: f64,
    /// The same before the first step, and after each.
    distances: &'a [f64],
    /// Numbers of the command outside the training range.
    out_of_range: Vec<OutOfRange>,
}

/// The middle of the commands that a model was trained on, and the payload where it takes one.
fn start(args: &CloudArgs, model: &Model, payload: f64) -> anyhow::Result<Vec<f64>> {
    let Normalisation {
        motor_min,
        motor_max,
        ..
    } = &model.provenance.normalisation;
    let mut start: Vec<f64> = (motor_min.iter().zip(motor_max))
        .map(|(low, high)| (low + high) / 2.0)
        .collect();
    let subject = model.provenance.subject.as_ref();
    let takes_payload = subject.is_some_and(|subject| subject.payload.is_some());
    if !takes_payload && payload != 0.0 {
        bail!("the model was trained without payloads: leave out --payload");
    }
    let motors = start.len() - usize::from(takes_payload);
    if let Some(given) = &args.start {
        if given.len() != motors {
            bail!("--start has {} numbers; expected {motors}", given.len());
        }
        start[..motors].copy_from_slice(given);
    }
    if takes_payload {
        start[motors] = payload;
    }
    Ok(start)
}

pub(super) fn run(
    args: &CloudArgs,
    file: &Path,
    payload: f64,
    seed: u64,
    console: &Console,
) -> anyhow::Result<()> {
    let model = super::load_model(&args.model)?;
    let wanted = read_cloud(file)?;
    let start = start(args, &model, payload)?;
    let search = CloudSearch {
        steps: args.steps,
        points: args.points,
        seed,
        ..CloudSearch::default()
    };
    let mut go_on = || !console.interrupted();
    let sampler = model.settings.sampler;
    let reached = reach_cloud(
        &model,
        &sampler,
        &wanted.points,
        &start,
        &search,
        &mut go_on,
    )
    .with_context(|| format!("no command for {}", file.display()))?;
    if console.interrupted() {
        return Err(Interrupted.into());
    }
    let subject = model.provenance.subject.as_ref();
    let takes_payload = subject.is_some_and(|subject| subject.payload.is_some());
    let motors = reached.condition.len() - usize::from(takes_payload);
    let (command, payload) = reached.condition.split_at(motors);
    let found = Found {
        cloud: file,
        model: &args.model,
        command,
        payload: payload.first().copied(),
        mean_distance: reached.distance(),
        distances: &reached.distances,
        out_of_range: (model.provenance.normalisation).out_of_range(&reached.condition)?,
    };
    console.result(&found, |found| {
        let command: Vec<String> = found.command.iter().map(|c| format!("{c:.9}")).collect();
        format!(
            "--command {}   {:.2} mm from the cloud in the mean, after {} (at first {:.2} mm)\n",
            command.join(","),
            1e3 * found.mean_distance,
            counted(found.distances.len() - 1, "step"),
            1e3 * found.distances[0]
        )
    })
}
