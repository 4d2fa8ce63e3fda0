//! `tdcr train`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tdcr::learn::train::TrainSettings;
use tdcr::pipeline::{NetworkSize, model_path, train};

use super::console::Console;

/// Train a velocity network on a data set by action-conditioned flow matching
///
/// Interrupted, the same command goes on where it stopped.
#[derive(Debug, Args)]
pub(super) struct TrainArgs {
    /// Folder of the data set
    #[arg(long, default_value = "data", value_name = "DIR")]
    data: PathBuf,
    /// Folder of the run: model and state
    #[arg(long, default_value = "run", value_name = "DIR")]
    out: PathBuf,
    /// Features per layer
    #[arg(long, default_value_t = 96, value_name = "N")]
    width: usize,
    /// Layers
    #[arg(long, default_value_t = 6, value_name = "N")]
    depth: usize,
    /// Features of the embedding of time and command
    #[arg(long, default_value_t = 128, value_name = "N")]
    embedding: usize,
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
    let trained = train(&args.data, &args.out, size, &settings, console)?;
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
