//! `tdcr eval`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tdcr::learn::train::Model;
use tdcr::pipeline::{EvalSettings, Evaluation, Evaluator, Scores};

use super::SamplerArgs;
use super::console::Console;

/// Score a trained model on the test commands of a data set, beside trivial predictors and the floor
#[derive(Debug, Args)]
pub(super) struct EvalArgs {
    /// The trained model
    #[arg(long, default_value = "run/model.safetensors", value_name = "FILE")]
    model: PathBuf,
    /// Folder of the data set
    #[arg(long, default_value = "data", value_name = "DIR")]
    data: PathBuf,
    #[command(flatten)]
    scoring: ScoringArgs,
}

/// How clouds are compared.
#[derive(Debug, Args)]
pub(super) struct ScoringArgs {
    /// Points of each cloud that the Chamfer distance is computed on
    #[arg(long, default_value_t = 10_000, value_name = "N")]
    points: usize,
    /// Points of each cloud that the exact earth mover's distance is computed on
    #[arg(long, default_value_t = 2000, value_name = "N")]
    emd_points: usize,
    #[command(flatten)]
    sampler: SamplerArgs,
    /// Seed of noise and subsets
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

impl ScoringArgs {
    pub fn settings(&self) -> anyhow::Result<EvalSettings> {
        Ok(EvalSettings {
            points: self.points,
            emd_points: self.emd_points,
            sampler: self.sampler.sampler()?,
            seed: self.seed,
        })
    }
}

/// Mean scores, as `metrics.json` and `--json` name them: CD in m², EMD in m.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Metrics {
    pub cd: f64,
    pub cd_floor: Option<f64>,
    pub cd_nearest: f64,
    pub cd_mean: Option<f64>,
    pub emd: f64,
    pub emd_floor: Option<f64>,
    pub emd_nearest: f64,
    pub emd_mean: Option<f64>,
    /// Mean absolute colour difference of predicted points from the nearest true ones, in [0, 1].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<f64>,
    pub tests: usize,
    pub points: usize,
    pub emd_points: usize,
}

impl Metrics {
    pub fn new(evaluation: &Evaluation, settings: &EvalSettings) -> Self {
        let Scores {
            network,
            nearest,
            mean,
            floor,
            color,
        } = evaluation.mean();
        Self {
            cd: network.cd,
            cd_floor: floor.map(|d| d.cd),
            cd_nearest: nearest.cd,
            cd_mean: mean.map(|d| d.cd),
            emd: network.emd,
            emd_floor: floor.map(|d| d.emd),
            emd_nearest: nearest.emd,
            emd_mean: mean.map(|d| d.emd),
            color,
            tests: evaluation.per_test.len(),
            points: settings.points,
            emd_points: settings.emd_points,
        }
    }
}

/// The table of mean scores.
pub(super) fn table(metrics: &Metrics) -> String {
    let mut text =
        String::from("                           CD (1e-4 m²)   EMD (mm)   CD / floor\n");
    let mut row = |name: &str, cd: f64, emd: f64| {
        let ratio = (metrics.cd_floor).map_or("-".to_owned(), |floor| format!("{:.1}", cd / floor));
        let (cd, emd) = (cd * 1e4, emd * 1e3);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name:26} {cd:12.4} {emd:10.3} {ratio:>12}");
    };
    row("network", metrics.cd, metrics.emd);
    row(
        "nearest training command",
        metrics.cd_nearest,
        metrics.emd_nearest,
    );
    for (name, cd, emd) in [
        ("mean command", metrics.cd_mean, metrics.emd_mean),
        ("sampling floor", metrics.cd_floor, metrics.emd_floor),
    ] {
        if let (Some(cd), Some(emd)) = (cd, emd) {
            row(name, cd, emd);
        }
    }
    if let Some(color) = metrics.color {
        let _ = writeln!(text, "colour error of the network, of 1: {color:.4}");
    }
    text
}

pub(super) fn run(args: &EvalArgs, console: &Console) -> anyhow::Result<()> {
    let settings = args.scoring.settings()?;
    let model = Model::load(&args.model)?;
    let evaluation = Evaluator::new(&model, &args.data, settings)?.run(None, console)?;
    console.result(&Metrics::new(&evaluation, &settings), |m| {
        format!(
            "{}\nmeans over {} test commands; CD on {} points, EMD on {}",
            table(m),
            m.tests,
            m.points,
            m.emd_points
        )
    })
}
