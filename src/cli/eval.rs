//! `tdcr eval`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tdcr::learn::net::Precision;
use tdcr::learn::train::{Model, TrainSettings};
use tdcr::pipeline::{Distances, EvalSettings, Evaluation, Evaluator, Quantiles, Scores, TipError};

use super::console::Console;
use super::eval_page;
use super::{PrecisionArgs, SamplerArgs, output};

/// Score a trained model on the test commands of a data set, beside trivial predictors and the floor
#[derive(Debug, Args)]
pub(super) struct EvalArgs {
    /// The trained model
    #[arg(long, default_value = "run/model.safetensors", value_name = "FILE")]
    pub model: PathBuf,
    /// Folder of the data set
    #[arg(long, default_value = "data", value_name = "DIR")]
    pub data: PathBuf,
    #[command(flatten)]
    scoring: ScoringArgs,
    /// Test commands to name, and to show in the report: those predicted worst, by Chamfer distance
    #[arg(long, default_value_t = 5, value_name = "N")]
    worst: usize,
    /// Write a page on the scores: table, distribution, pictures of the worst predictions
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

/// How clouds are compared.
#[derive(Debug, Args)]
pub(super) struct ScoringArgs {
    /// Points of each cloud that the Chamfer distance is computed on
    #[arg(long, default_value_t = 10_000, value_name = "N")]
    points: usize,
    /// Points of each cloud that the exact earth mover's distances are computed on
    #[arg(long, default_value_t = 2000, value_name = "N")]
    emd_points: usize,
    #[command(flatten)]
    sampler: SamplerArgs,
    #[command(flatten)]
    precision: PrecisionArgs,
    /// Seed of noise and subsets
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

impl ScoringArgs {
    pub fn settings(&self, model: &Model) -> anyhow::Result<EvalSettings> {
        Ok(EvalSettings {
            points: self.points,
            emd_points: self.emd_points,
            sampler: self.sampler.sampler(&model.settings)?,
            precision: self.precision.of_width(model.network.shape().width()),
            seed: self.seed,
        })
    }
}

/// Mean scores, as `metrics.json` and `--json` name them: CD and squared EMD in m², EMD in m.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Metrics {
    pub cd: f64,
    pub cd_floor: Option<f64>,
    /// Of a perfect predictor, whose points are independent of each other.
    pub cd_perfect: Option<f64>,
    pub cd_nearest: f64,
    pub cd_mean: Option<f64>,
    pub emd: f64,
    pub emd_floor: Option<f64>,
    pub emd_nearest: f64,
    pub emd_mean: Option<f64>,
    /// Largest duality gap of all EMDs found, of every predictor and test command (m).
    pub emd_gap: f64,
    pub emd_squared: f64,
    pub emd_squared_floor: Option<f64>,
    pub emd_squared_nearest: f64,
    pub emd_squared_mean: Option<f64>,
    /// Largest duality gap of all squared EMDs found (m²).
    pub emd_squared_gap: f64,
    /// Mean absolute colour difference of predicted points from the nearest true ones, in [0, 1]; `None` where the
    /// network or the data set has no colours.
    pub color: Option<f64>,
    /// Mean distance of the tip in the network's clouds from the true one (m); `None` where the data set names no robot.
    pub tip: Option<f64>,
    /// The same in the clouds of the nearest training commands (m).
    pub tip_nearest: Option<f64>,
    /// Mean uncertainty of the network's points (m); `None` where too few points tell.
    pub uncertainty: Option<f64>,
    /// Spearman's rank correlation of a point's uncertainty with its distance from the true cloud, over the points of
    /// a test command; mean over the commands.
    pub uncertainty_rank_points: Option<f64>,
    /// Spearman's rank correlation of a cloud's mean uncertainty with its Chamfer distance, over the test commands.
    pub uncertainty_rank_commands: Option<f64>,
    /// Evaluations of the network in a prediction; mean over the test commands.
    pub evaluations: f64,
    pub tests: usize,
    pub points: usize,
    pub emd_points: usize,
    /// Numbers of the network's products when it predicted, and when it was trained.
    pub precision: Precision,
    pub training_precision: Precision,
}

/// What `tdcr eval` says.
#[derive(Serialize)]
struct Evaluated {
    #[serde(flatten)]
    metrics: Metrics,
    network_quantiles: NetworkQuantiles,
    worst: Vec<WorstTest>,
}

/// Quantiles of the network's distances over the test commands.
#[derive(Serialize)]
struct NetworkQuantiles {
    cd: Quantiles,
    emd: Quantiles,
    emd_squared: Quantiles,
}

/// A test command that the network predicts badly.
#[derive(Serialize)]
struct WorstTest {
    /// Index in the test split.
    test: usize,
    command: Vec<f32>,
    /// Mass hung from the tip (kg); `None` in a data set without payloads.
    payload: Option<f32>,
    cd: f64,
    emd: f64,
    emd_squared: f64,
}

impl Metrics {
    /// Of a network that was trained with `training`.
    pub fn new(evaluation: &Evaluation, settings: &EvalSettings, training: &TrainSettings) -> Self {
        let Scores {
            network,
            nearest,
            mean,
            perfect,
            floor,
            color,
            uncertainty,
            tip,
            evaluations,
        } = evaluation.mean();
        let greatest = evaluation.greatest();
        Self {
            cd: network.cd,
            cd_floor: floor.map(|d| d.cd),
            cd_perfect: perfect.map(|d| d.cd),
            cd_nearest: nearest.cd,
            cd_mean: mean.map(|d| d.cd),
            emd: network.emd,
            emd_floor: floor.map(|d| d.emd),
            emd_nearest: nearest.emd,
            emd_mean: mean.map(|d| d.emd),
            emd_gap: greatest.emd_gap,
            emd_squared: network.emd_squared,
            emd_squared_floor: floor.map(|d| d.emd_squared),
            emd_squared_nearest: nearest.emd_squared,
            emd_squared_mean: mean.map(|d| d.emd_squared),
            emd_squared_gap: greatest.emd_squared_gap,
            color,
            tip: tip.map(|tip| tip.network),
            tip_nearest: tip.map(|tip| tip.nearest),
            uncertainty: uncertainty.map(|u| u.mean),
            uncertainty_rank_points: uncertainty.and_then(|u| u.rank_correlation),
            uncertainty_rank_commands: evaluation.uncertainty_rank_correlation(),
            evaluations,
            tests: evaluation.per_test.len(),
            points: settings.points,
            emd_points: settings.emd_points,
            precision: settings.precision,
            training_precision: training.precision,
        }
    }

    /// How uncertain the network is, and how well that tells its errors.
    pub fn uncertainty_text(&self) -> Option<String> {
        let number = |value: Option<f64>| value.map_or("unknown".to_owned(), |x| format!("{x:.2}"));
        self.uncertainty.map(|mean| {
            format!(
                "Uncertainty of the network's points: {:.3} mm on average. Its rank correlation with the error is {} over \
                 the points of a command, {} over the commands.",
                1e3 * mean,
                number(self.uncertainty_rank_points),
                number(self.uncertainty_rank_commands)
            )
        })
    }
}

impl WorstTest {
    fn new(evaluator: &Evaluator, evaluation: &Evaluation, test: usize) -> Self {
        let Distances {
            cd,
            emd,
            emd_squared,
            ..
        } = evaluation.per_test[test].network;
        let condition = &evaluator.test()[test].condition;
        Self {
            test,
            command: condition.motors.clone(),
            payload: condition.payload,
            cd,
            emd,
            emd_squared,
        }
    }
}

/// The table of mean scores.
pub(super) fn table(evaluation: &Evaluation) -> String {
    let mut text = String::from(
        "                           CD (1e-4 m²)   EMD (mm)   sq. EMD (1e-4 m²)   CD / floor\n",
    );
    let Scores {
        network,
        nearest,
        mean,
        perfect,
        floor,
        color,
        tip,
        ..
    } = evaluation.mean();
    for (name, distances) in [
        ("network", Some(network)),
        ("nearest training command", Some(nearest)),
        ("mean command", mean),
        ("perfect predictor", perfect),
        ("sampling floor", floor),
    ] {
        let Some(d) = distances else { continue };
        let ratio = floor.map_or("-".to_owned(), |floor| format!("{:.1}", d.cd / floor.cd));
        let (cd, emd, emd_squared) = (d.cd * 1e4, d.emd * 1e3, d.emd_squared * 1e4);
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{name:26} {cd:12.4} {emd:10.3} {emd_squared:19.4} {ratio:>12}"
        );
    }
    if let Some(TipError { network, nearest }) = tip {
        let [network, nearest] = [network, nearest].map(|x| 1e3 * x);
        let _ = writeln!(
            text,
            "tip off by (mm): network {network:.2}, nearest training command {nearest:.2}"
        );
    }
    if let Some(color) = color {
        let _ = writeln!(text, "colour error of the network, of 1: {color:.4}");
    }
    text
}

/// The table of the network's quantiles.
fn quantile_table(quantiles: &NetworkQuantiles) -> String {
    let mut text = format!("{:26}", "network, over the tests");
    let mut body = String::new();
    for (name, _) in quantiles.cd.named() {
        let _ = write!(text, "{name:>10}");
    }
    for (name, scale, of) in [
        ("CD (1e-4 m²)", 1e4, &quantiles.cd),
        ("EMD (mm)", 1e3, &quantiles.emd),
        ("sq. EMD (1e-4 m²)", 1e4, &quantiles.emd_squared),
    ] {
        let _ = write!(body, "\n{name:26}");
        for (_, value) in of.named() {
            let _ = write!(body, "{:10.4}", value * scale);
        }
    }
    text + &body + "\n"
}

/// The list of the worst predictions.
fn worst_table(worst: &[WorstTest]) -> String {
    let mut text = String::new();
    for (rank, test) in worst.iter().enumerate() {
        let name = if rank == 0 { "worst: test" } else { "test" };
        let command: Vec<String> = test.command.iter().map(f32::to_string).collect();
        let payload = test
            .payload
            .map_or(String::new(), |kg| format!(" --payload {kg}"));
        let _ = writeln!(
            text,
            "{name:>11} {:<6} CD {:.4}e-4 m², EMD {:.3} mm   --command {}{payload}",
            test.test,
            test.cd * 1e4,
            test.emd * 1e3,
            command.join(","),
        );
    }
    text
}

pub(super) fn run(args: &EvalArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(path) = &args.report {
        output::format("--report", path, &["html"])?;
    }
    let model = Model::load(&args.model)?;
    let settings = args.scoring.settings(&model)?;
    let evaluator = Evaluator::new(&model, &args.data, settings)?;
    if evaluator.lacks_colors() {
        tracing::warn!(
            "{}: all points of the test clouds have one colour, as those that were imported without colours do: the \
             network's colours are not scored",
            args.data.display()
        );
    }
    let evaluation = evaluator.run(None, console)?;
    let mut worst = evaluation.worst_first();
    worst.truncate(args.worst);
    let metrics = Metrics::new(&evaluation, &settings, &model.settings);
    let evaluated = Evaluated {
        metrics,
        network_quantiles: NetworkQuantiles {
            cd: evaluation.quantiles(|d| d.cd),
            emd: evaluation.quantiles(|d| d.emd),
            emd_squared: evaluation.quantiles(|d| d.emd_squared),
        },
        worst: (worst.iter())
            .map(|&test| WorstTest::new(&evaluator, &evaluation, test))
            .collect(),
    };
    console.result(&evaluated, |e| {
        let m = &e.metrics;
        format!(
            "{}{}\n{}\n{}\nmeans over {} test commands, of {} evaluations of the network each; CD on {} points, EMD and squared\n\
             EMD (least mean squared distance) on {}, exact: their duality gaps are at most {:.1e} m and {:.1e} m²",
            table(&evaluation),
            (m.uncertainty_text()).map_or(String::new(), |text| text + "\n"),
            quantile_table(&e.network_quantiles),
            worst_table(&e.worst),
            m.tests,
            (10.0 * m.evaluations).round() / 10.0,
            m.points,
            m.emd_points,
            m.emd_gap,
            m.emd_squared_gap,
        )
    })?;
    // After the result: a page that cannot be written costs nothing but the page.
    if let Some(path) = &args.report {
        let page = eval_page::page(args, &evaluator, &evaluation, &evaluated.metrics, &worst)?;
        output::write(path, page.to_html())?;
    }
    Ok(())
}
