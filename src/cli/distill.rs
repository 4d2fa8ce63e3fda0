//! `tdcr distill`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tdcr::learn::net::Precision;
use tdcr::learn::train::TrainSettings;
use tdcr::pipeline::{distill, distillation, model_path};

use super::PrecisionArgs;
use super::console::Console;

/// Distil a trained network into one that predicts with a few evaluations instead of many
///
/// The result is a model like any other, for predict and eval. Interrupted, the same command goes on where it stopped.
#[derive(Debug, Args)]
pub(super) struct DistillArgs {
    /// The trained model
    #[arg(long, default_value = "run/model.safetensors", value_name = "FILE")]
    model: PathBuf,
    /// Folder of a data set whose val split validates; its clouds are not trained on
    #[arg(long, default_value = "data", value_name = "DIR")]
    data: PathBuf,
    /// Folder of the run: model, state, and the log as log.csv and for TensorBoard
    #[arg(long, default_value = "distilled", value_name = "DIR")]
    out: PathBuf,
    /// Evaluations of a network in a prediction; the last one takes the points to the surface near them, or of a refined teacher the last two
    #[arg(long, default_value_t = 4, value_name = "N", value_parser = super::amount)]
    evaluations: usize,
    /// Exponent p of the time grid 1 - (1 - k/n)^p of the n evaluations before these
    #[arg(long, default_value_t = 3.0, value_name = "P")]
    power: f32,
    /// Optimiser steps
    #[arg(long, default_value_t = 4000, value_name = "N")]
    steps: u64,
    #[command(flatten)]
    precision: PrecisionArgs,
    /// Seed of commands and noise
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

#[derive(Serialize)]
struct Run {
    model: PathBuf,
    evaluations: usize,
    steps: u64,
    best_step: u64,
    /// Validation Chamfer distance of the best step (m²).
    validation_cd: f64,
    /// The same of the teacher, as it was trained.
    teacher_validation_cd: f64,
    /// Operand type of the networks' matrix products.
    precision: Precision,
}

pub(super) fn run(args: &DistillArgs, console: &Console) -> anyhow::Result<()> {
    super::output::folder("--out", &args.out, "a folder for the run")?;
    let teacher = super::load_model(&args.model)?;
    let settings = TrainSettings {
        seed: args.seed,
        precision: args.precision.of_width(teacher.network.shape().width()),
        ..distillation(&teacher, args.evaluations, args.power, args.steps)
    };
    let student = distill(&teacher, &args.data, &args.out, &settings, console)?.model;
    let area = student.provenance.normalisation.scale.powi(2);
    let run = Run {
        model: model_path(&args.out),
        evaluations: args.evaluations,
        steps: args.steps,
        best_step: student.step,
        validation_cd: student.validation_distance * area,
        teacher_validation_cd: teacher.validation_distance * area,
        precision: settings.precision,
    };
    console.summary(&run, |r| {
        format!(
            "{}: {} evaluations, best at step {} of {}, validation CD {:.3e} m²; the teacher's was {:.3e}",
            r.model.display(),
            r.evaluations,
            r.best_step,
            r.steps,
            r.validation_cd,
            r.teacher_validation_cd
        )
    })
}
