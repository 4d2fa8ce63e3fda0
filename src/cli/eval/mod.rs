//! `tdcr eval`.

mod picture;
mod tables;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, anyhow};
use clap::Args;
use tdcr::learn::data::read_predictions;
use tdcr::learn::flow::Sampler;
use tdcr::learn::train::Model;
use tdcr::pages::{Evaluated, evaluation_page};
use tdcr::pipeline::{EvalSettings, Evaluator, PipelineError, Results, SamplerPlan};

use super::console::Console;
use super::{PrecisionArgs, output};

pub(super) use tables::scores as table;

/// Score a trained model, or the clouds of any program, on the test commands of a data set, beside trivial predictors and
/// the sampling floor
#[derive(Debug, Args)]
pub(super) struct EvalArgs {
    /// The trained model
    #[arg(long, default_value = "run/model.safetensors", value_name = "FILE")]
    pub model: PathBuf,
    /// Score the clouds in this file instead of a model's: an NPZ file of `points` (T, N, 3), floats (m), one cloud for each
    /// command of the test split, in its order. It may also hold `rgb` (T, N, 3), and `commands` (T, D), which are checked
    /// against the test split. `tdcr predict --commands FILE --out clouds.npz` writes such a file
    #[arg(
        long,
        value_name = "FILE.npz",
        conflicts_with_all = ["model", "sampler", "sampler_steps", "sampler_power", "sampler_tolerance", "precision"]
    )]
    pub predictions: Option<PathBuf>,
    /// Folder of the data set
    #[arg(long, default_value = "data", value_name = "DIR")]
    pub data: PathBuf,
    #[command(flatten)]
    scoring: ScoringArgs,
    /// How many of the worst test commands, by Chamfer distance, to list and to show in the report
    #[arg(long, default_value_t = 5, value_name = "N")]
    worst: usize,
    /// Write an HTML page of the scores: table, distribution, pictures of the worst predictions
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Draw the scores in this file: .png the worst predictions against the true clouds, .svg the Chamfer distances of all test
    /// commands
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
}

/// How clouds are compared, and predicted.
#[derive(Debug, Args)]
pub(super) struct ScoringArgs {
    #[command(flatten)]
    settings: EvalSettings,
    #[command(flatten)]
    sampler: SamplerPlan,
    #[command(flatten)]
    precision: PrecisionArgs,
}

/// What is evaluated.
enum Scored {
    /// A model, in the precision that it predicts in, and its sampler.
    Model(Arc<Model>, Sampler),
    /// The clouds in a file.
    Clouds(String),
}

impl Scored {
    fn evaluated<'a>(&'a self, args: &'a EvalArgs) -> Evaluated<'a> {
        match self {
            Self::Clouds(name) => Evaluated::Clouds { name },
            Self::Model(model, sampler) => Evaluated::Model {
                file: &args.model,
                model,
                sampler,
            },
        }
    }
}

/// An error with a number of points as the option that set it.
pub(super) fn named_as_option(error: PipelineError) -> anyhow::Error {
    match error {
        PipelineError::ComparedPoints {
            setting,
            found,
            most,
        } => {
            let option = setting.replace('_', "-");
            anyhow!(
                "--{option} is {found}; expected 1 to {most}, as many points as there are to compare"
            )
        }
        error => error.into(),
    }
}

/// What is evaluated, and what scores it.
fn prepare(args: &EvalArgs) -> anyhow::Result<(Scored, Evaluator)> {
    let settings = args.scoring.settings;
    if let Some(file) = &args.predictions {
        let (name, clouds) = (file.display().to_string(), read_predictions(file)?);
        let evaluator = Evaluator::of_clouds(clouds, &args.data, settings);
        let evaluator = evaluator.map_err(named_as_option);
        let evaluator = evaluator.with_context(|| name.clone())?;
        return Ok((Scored::Clouds(name), evaluator));
    }
    let model = super::load_model(&args.model)?;
    let sampler = args.scoring.sampler.resolve(&model.settings)?;
    let precision = (args.scoring.precision).of_width(model.network.shape().width());
    let model = Arc::new(model.with_precision(precision)?);
    let evaluator = Evaluator::of_model(model.clone(), sampler, &args.data, settings);
    let evaluator = evaluator.map_err(named_as_option)?;
    Ok((Scored::Model(model, sampler), evaluator))
}

pub(super) fn run(args: &EvalArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(path) = &args.report {
        output::format("--report", path, &["html"])?;
    }
    if let Some(path) = &args.picture {
        output::format("--picture", path, &["png", "svg"])?;
    }
    let (scored, evaluator) = prepare(args)?;
    let evaluated = scored.evaluated(args);
    if let Some(note) = evaluator.note() {
        tracing::warn!("{}: {note}", args.data.display());
    }
    if evaluator.lacks_colors() {
        tracing::warn!(
            "{}: all points of the test clouds have one colour, as those that were imported without colours do: the \
             predicted colours are not scored",
            args.data.display()
        );
    }
    let evaluation = evaluator.run(None, console)?;
    let results = Results::new(&evaluator, &evaluation, evaluated.model(), args.worst);
    console.result(&results, |results| {
        let m = &results.metrics;
        format!(
            "{}{}{}\n{}\n{}\nmeans over {} test commands{}; CD on {} points, EMD and squared\n\
             EMD (least mean squared distance) on {}, exact: their duality gaps are at most {:.1e} m and {:.1e} m²",
            tables::scores(&evaluation),
            (m.repetition_text()).map_or(String::new(), |text| text + "\n"),
            (m.uncertainty_text()).map_or(String::new(), |text| text + "\n"),
            tables::quantiles(&results.network_quantiles),
            tables::worst(&results.worst),
            m.tests,
            m.evaluations.map_or(String::new(), |evaluations| format!(
                ", of {} evaluations of the network each",
                (10.0 * evaluations).round() / 10.0
            )),
            m.points,
            m.emd_points,
            m.emd_gap,
            m.emd_squared_gap,
        )
    })?;
    // After the result: a page that cannot be written costs nothing but the page.
    if args.report.is_none() && args.picture.is_none() {
        return Ok(());
    }
    let page = evaluation_page(&evaluated, &args.data, &evaluator, &evaluation, &results)?;
    if let Some(path) = &args.picture {
        picture::write(path, &evaluation, &page.examples)?;
    }
    if let Some(path) = &args.report {
        output::write(path, page.to_html())?;
    }
    Ok(())
}
