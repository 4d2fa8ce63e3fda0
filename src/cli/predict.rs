//! `tdcr predict`.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::bail;
use clap::Args;
use serde::Serialize;
use tdcr::learn::train::Model;
use tdcr::sim::cloud::write_ply;
use tdcr::sim::robot::{Loads, Robot};

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
    /// Mass hung from the tip (kg), for a model of data with payloads
    #[arg(long, allow_hyphen_values = true, value_name = "KG")]
    payload: Option<f64>,
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

/// Points of a network that predicts positions alone are drawn in this colour.
const COLOR: [u8; 3] = [0, 114, 178];

pub(super) fn run(args: &PredictArgs, console: &Console) -> anyhow::Result<()> {
    let sampler = args.sampler.sampler()?;
    let model = Model::load(&args.model)?;
    let condition = condition(args, &model)?;
    let start = Instant::now();
    let prediction = model.predict(&condition, args.points, args.seed, &sampler)?;
    let seconds = start.elapsed().as_secs_f64();
    let cloud = prediction.into_cloud(COLOR);
    let bound = |pick: fn(f32, f32) -> f32, from: f32| {
        cloud.points.iter().fold([from; 3], |b, p| {
            std::array::from_fn(|axis| pick(b[axis], p[axis]))
        })
    };
    let predicted = Predicted {
        file: args.out.clone(),
        points: cloud.len(),
        min: bound(f32::min, f32::INFINITY),
        max: bound(f32::max, f32::NEG_INFINITY),
        seconds,
    };
    write_ply(&args.out, &cloud)?;
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

/// The command and, for a model of data with payloads, the payload.
fn condition(args: &PredictArgs, model: &Model) -> anyhow::Result<Vec<f64>> {
    let mut condition = args.command.lengths.clone();
    let subject = model.provenance.subject.as_ref();
    if let Some(subject) = subject {
        Robot::new(subject.robot.clone())?.command(&condition)?;
    }
    match (subject.and_then(|subject| subject.payload), args.payload) {
        (Some(_), Some(mass)) => {
            Loads::payload(mass)?;
            condition.push(mass);
        }
        (Some(range), None) => {
            bail!("the model was trained with payloads of {range} kg: say --payload KG, 0 for none")
        }
        (None, Some(_)) => bail!("the model was trained without payloads: leave out --payload"),
        (None, None) => {}
    }
    Ok(condition)
}
