//! `tdcr collect`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tdcr::learn::data::{Split, split_indices};
use tdcr::pipeline::{CollectSettings, collect};
use tdcr::sim::render::BaseVisibility;

use super::console::Console;

/// Make a data set: settle random commands, see each with the camera ring, keep the clouds
///
/// Interrupted, the same command goes on where it stopped.
#[derive(Debug, Args)]
pub(super) struct CollectArgs {
    /// 2m, 3m, 5m, or the path of a robot file (.toml, .json, .xml or .urdf)
    #[arg(long, default_value = "2m")]
    robot: String,
    /// Number of commands, split 80/10/10 into train, val and test
    #[arg(long, default_value_t = 1000, value_name = "N", value_parser = super::amount)]
    samples: usize,
    /// Points per cloud
    #[arg(long, default_value_t = 10_000, value_name = "N", value_parser = super::amount)]
    points: usize,
    /// Edge of the voxels that thin the fused clouds (m)
    #[arg(long, default_value_t = 0.002, value_name = "M", value_parser = super::positive, allow_hyphen_values = true)]
    voxel: f64,
    /// Show the robot's base to the cameras
    #[arg(long)]
    base: bool,
    /// Seed of commands, samples and splits
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Folder of the data set
    #[arg(long, default_value = "data", value_name = "DIR")]
    out: PathBuf,
}

#[derive(Serialize)]
struct Collected {
    dir: PathBuf,
    robot: String,
    train: usize,
    val: usize,
    test: usize,
    points: usize,
}

pub(super) fn run(args: &CollectArgs, console: &Console) -> anyhow::Result<()> {
    let splits = split_indices(args.samples, args.seed)?;
    let settings = CollectSettings {
        robot: super::load_robot(&args.robot)?,
        base: if args.base {
            BaseVisibility::Shown
        } else {
            BaseVisibility::Hidden
        },
        count: args.samples,
        points: args.points,
        voxel_size: args.voxel,
        seed: args.seed,
    };
    collect(&settings, &args.out, console)?;
    let collected = Collected {
        dir: args.out.clone(),
        robot: settings.robot.name,
        train: splits.of(Split::Train).len(),
        val: splits.of(Split::Val).len(),
        test: splits.of(Split::Test).len(),
        points: args.points,
    };
    console.result(&collected, |c| {
        format!(
            "{}: {} train, {} val and {} test clouds of {} points of robot {}",
            c.dir.display(),
            c.train,
            c.val,
            c.test,
            c.points,
            c.robot
        )
    })
}
