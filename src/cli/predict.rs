//! `tdcr predict`.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde::Serialize;
use tdcr::learn::train::Model;
use tdcr::sim::cloud::{PointCloud, write_ply};
use tdcr::sim::robot::Robot;

use super::console::Console;
use super::{CommandArg, SamplerArgs};

/// Predict the cloud of a settled robot for one command, and write it as PLY
#[derive(Debug, Args)]
pub(super) struct PredictArgs {
    /// The trained model
    #[arg(long, default_value = "run/model.safetensors", value_name = "FILE")]
    model: PathBuf,
    #[command(flatten)]
    command: CommandArg,
    /// Points of the cloud
    #[arg(long, default_value_t = 10_000, value_name = "N", value_parser = super::amount)]
    points: usize,
    #[command(flatten)]
    sampler: SamplerArgs,
    /// Seed of the noise that the cloud starts from
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The PLY file to write
    #[arg(long, default_value = "prediction.ply", value_name = "FILE")]
    out: PathBuf,
}

#[derive(Serialize)]
struct Predicted {
    file: PathBuf,
    points: usize,
    /// Corners of the cloud's bounding box (m).
    min: [f32; 3],
    max: [f32; 3],
    seconds: f64,
}

/// The network predicts positions alone; predicted points are drawn in this colour.
const COLOR: [u8; 3] = [0, 114, 178];

pub(super) fn run(args: &PredictArgs, console: &Console) -> anyhow::Result<()> {
    let sampler = args.sampler.sampler()?;
    let model = Model::load(&args.model)?;
    if let Some(spec) = &model.provenance.robot {
        Robot::new(spec.clone())?.command(&args.command.lengths)?;
    }
    let start = Instant::now();
    let points = model.predict(&args.command.lengths, args.points, args.seed, &sampler)?;
    let seconds = start.elapsed().as_secs_f64();
    let bound = |pick: fn(f32, f32) -> f32, from: f32| {
        points.iter().fold([from; 3], |b, p| {
            std::array::from_fn(|axis| pick(b[axis], p[axis]))
        })
    };
    let predicted = Predicted {
        file: args.out.clone(),
        points: points.len(),
        min: bound(f32::min, f32::INFINITY),
        max: bound(f32::max, f32::NEG_INFINITY),
        seconds,
    };
    let colors = vec![COLOR; points.len()];
    write_ply(&args.out, &PointCloud { points, colors })?;
    console.result(&predicted, |p| {
        format!(
            "{}: {} points from {:.3?} to {:.3?} m, predicted in {:.2} s",
            p.file.display(),
            p.points,
            p.min,
            p.max,
            p.seconds
        )
    })
}
