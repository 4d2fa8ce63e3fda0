//! `tdcr eval`.

mod picture;
mod tables;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, anyhow, ensure};
use clap::Args;
use tdcr::learn::data::read_predictions;
use tdcr::learn::flow::Sampler;
use tdcr::learn::train::Model;
use tdcr::pages::{Evaluated, evaluation_page, methods_page};
use tdcr::pipeline::{
    EvalError, EvalSettings, Evaluation, Evaluator, Metrics, PipelineError, Results, SamplerPlan,
    ScoredMethod,
};

use super::console::Console;
use super::{PrecisionArgs, output};

pub(super) use tables::scores as table;

/// The model that is scored where nothing is named.
const DEFAULT_MODEL: &str = "run/model.safetensors";

/// Score a trained model, or the clouds of any program, on the test commands of a data set, beside trivial predictors and
/// the sampling floor; several of them in one table
#[derive(Debug, Args)]
pub(super) struct EvalArgs {
    /// The trained model; several, or one beside `--predictions`, are scored beside each other [default: run/model.safetensors,
    /// without `--predictions`]
    #[arg(long = "model", value_name = "FILE")]
    models: Vec<PathBuf>,
    /// Score the clouds in this file: an NPZ file of `points` (T, N, 3), floats (m), one cloud for each command of the test
    /// split, in its order, or for each of its first that `--tests` scores. It may also hold `rgb` (T, N, 3), and `commands`
    /// (T, D), which are checked against the test split. `tdcr predict --commands FILE --out clouds.npz` writes such a file.
    /// Several files are scored beside each other, each under the name of the method that it has (`method`), or its own; of
    /// training and prediction it may say the times (`training_seconds`, `prediction_seconds`)
    #[arg(long, value_name = "FILE.npz")]
    predictions: Vec<PathBuf>,
    /// Folder of the data set
    #[arg(long, default_value = "data", value_name = "DIR")]
    pub data: PathBuf,
    #[command(flatten)]
    scoring: ScoringArgs,
    /// How many of the worst test commands of each method, by Chamfer distance, to list and to show in the report
    #[arg(long, default_value_t = 5, value_name = "N")]
    worst: usize,
    /// Write an HTML page of the scores: table, distribution, pictures of the worst predictions
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Draw the scores in this file: .png the worst predictions against the true clouds (of several methods the best and the
    /// worst of each), .svg the Chamfer distances of all test commands
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

impl ScoringArgs {
    /// Whether nothing is asked of a model's predictions.
    fn is_default(&self) -> bool {
        self.sampler == SamplerPlan::default() && self.precision.precision.is_none()
    }
}

/// What is evaluated.
enum Scored {
    /// The model in a file, in the precision that it predicts in, and its sampler.
    Model(PathBuf, Arc<Model>, Sampler),
    /// The clouds in a file.
    Clouds(String),
}

impl Scored {
    fn evaluated(&self) -> Evaluated<'_> {
        match self {
            Self::Clouds(name) => Evaluated::Clouds { name },
            Self::Model(file, model, sampler) => Evaluated::Model {
                file,
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
        PipelineError::Eval(EvalError::OfMethod { name, source }) => {
            named_as_option(*source).context(name)
        }
        error => error.into(),
    }
}

/// What is evaluated, and what scores it.
fn prepare(args: &EvalArgs) -> anyhow::Result<(Vec<Scored>, Evaluator)> {
    let settings = args.scoring.settings;
    let own = [PathBuf::from(DEFAULT_MODEL)];
    let models = match (&args.models[..], &args.predictions[..]) {
        ([], []) => &own[..],
        (models, _) => models,
    };
    ensure!(
        !models.is_empty() || args.scoring.is_default(),
        "--sampler and its like, and --precision, are of a model; clouds are scored. Name the model (--model)"
    );
    let several = models.len() + args.predictions.len() > 1;
    let (mut scored, mut methods) = (Vec::new(), Vec::new());
    for file in models {
        let model = super::load_model(file)?;
        let sampler = args.scoring.sampler.resolve(&model)?;
        let precision = (args.scoring.precision).of_width(model.network.shape().width());
        let model = Arc::new(model.with_precision(precision)?);
        let method = ScoredMethod::of_model(model.clone(), sampler)?.read_in(file);
        methods.push(match models.len() {
            1 => method,
            _ => method.named(&file.display().to_string()),
        });
        scored.push(Scored::Model(file.clone(), model, sampler));
    }
    for file in &args.predictions {
        let method = ScoredMethod::of_clouds(read_predictions(file)?);
        methods.push(match several {
            true => method.read_in(file),
            false => method,
        });
        scored.push(Scored::Clouds(file.display().to_string()));
    }
    let evaluator = Evaluator::of_methods(methods, &args.data, settings).map_err(named_as_option);
    let evaluator = match &scored[..] {
        [Scored::Clouds(name)] => evaluator.with_context(|| name.clone()),
        _ => evaluator,
    }?;
    Ok((scored, evaluator))
}

pub(super) fn run(args: &EvalArgs, console: &Console) -> anyhow::Result<()> {
    if let Some(path) = &args.report {
        output::format("--report", path, &["html"])?;
    }
    if let Some(path) = &args.picture {
        output::format("--picture", path, &["png", "svg"])?;
    }
    let (scored, evaluator) = prepare(args)?;
    let evaluated: Vec<Evaluated<'_>> = scored.iter().map(Scored::evaluated).collect();
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
    let alone = match &evaluated[..] {
        [one] => Some(one),
        _ => None,
    };
    let model = alone.and_then(Evaluated::model);
    let results = Results::new(&evaluator, &evaluation, model, args.worst);
    console.result(&results, |results| match alone {
        Some(_) => of_one(&evaluation, results),
        None => of_several(&evaluation, results),
    })?;
    // After the result: a page that cannot be written costs nothing but the page.
    if args.report.is_none() && args.picture.is_none() {
        return Ok(());
    }
    let (html, examples) = match alone {
        Some(one) => {
            let page = evaluation_page(one, &args.data, &evaluator, &evaluation, &results)?;
            (page.to_html(), page.examples)
        }
        None => {
            let page = methods_page(&evaluated, &args.data, &evaluator, &evaluation, &results)?;
            (
                page.to_html(),
                picture::best_and_worst(page.report.examples, evaluated.len()),
            )
        }
    };
    if let Some(path) = &args.picture {
        picture::write(path, &evaluation, &examples)?;
    }
    if let Some(path) = &args.report {
        output::write(path, html)?;
    }
    Ok(())
}

/// The scores of what is evaluated alone.
fn of_one(evaluation: &Evaluation, results: &Results) -> String {
    let m = &results.metrics;
    format!(
        "{}{}{}\n{}\n{}\nmeans over {} test commands{}; {}",
        tables::scores(evaluation),
        (m.repetition_text()).map_or(String::new(), |text| text + "\n"),
        (m.uncertainty_text()).map_or(String::new(), |text| text + "\n"),
        tables::quantiles(&results.network_quantiles),
        tables::worst(&results.worst),
        m.tests,
        m.evaluations.map_or(String::new(), |evaluations| format!(
            ", of {} evaluations of the network each",
            (10.0 * evaluations).round() / 10.0
        )),
        counts(m),
    )
}

/// The scores of several methods.
fn of_several(evaluation: &Evaluation, results: &Results) -> String {
    let m = &results.metrics;
    format!(
        "{}{}{}\n{}\nmeans over {} test commands; {}",
        tables::methods(&results.methods),
        tables::other_scores(evaluation),
        (m.repetition_text()).map_or(String::new(), |text| text + "\n"),
        tables::best_and_worst(&results.methods),
        m.tests,
        counts(m),
    )
}

/// On how many points clouds were compared, and how exactly.
fn counts(m: &Metrics) -> String {
    format!(
        "CD on {} points, EMD and squared\n\
         EMD (least mean squared distance) on {}, exact: their duality gaps are at most {:.1e} m and {:.1e} m²",
        m.points, m.emd_points, m.emd_gap, m.emd_squared_gap,
    )
}
