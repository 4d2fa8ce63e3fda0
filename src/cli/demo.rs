//! `tdcr demo`: from simulation to scores once, ending in a report.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, bail};
use clap::Args;
use serde::Serialize;
use tdcr::learn::data::{DataSet, Split, split_indices};
use tdcr::learn::flow::Sampler;
use tdcr::learn::train::{FlowPredictor, TrainSettings};
use tdcr::pipeline::{
    CollectSettings, EvalSettings, Evaluation, Evaluator, Metrics, PipelineError, Preset, Trained,
    TrainingData, collect, lock_folder, train,
};
use tdcr::report::{Example, MotorGroup, Report, Stage, Training, contact_sheet, scale_bar};

use super::console::Console;
use super::eval::{page, table};
use super::{PrecisionArgs, output};

/// Simulate, see, learn, predict and evaluate the paper's 2m robot, and write a report
///
/// Interrupted, the same command goes on where it stopped.
#[derive(Debug, Args)]
pub(super) struct DemoArgs {
    /// Folder of everything that the demo makes
    #[arg(long, default_value = "demo_out", value_name = "DIR")]
    out: PathBuf,
    /// Commands to simulate, split 80/10/10
    #[arg(long, default_value_t = 2000, value_name = "N")]
    samples: usize,
    /// Optimiser steps
    #[arg(long, default_value_t = 7000, value_name = "N")]
    steps: u64,
    #[command(flatten)]
    precision: PrecisionArgs,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

const PRESET: Preset = Preset::ALL[0];
/// Test commands that the report shows, from the best prediction to the worst.
const EXAMPLES: usize = 6;
const SHEET_PANEL_WIDTH: usize = 260;

#[derive(Serialize)]
struct DemoMetrics {
    #[serde(flatten)]
    metrics: Metrics,
    /// Wall-clock time of all stages, those before an interruption included (s).
    seconds: f64,
    stages: BTreeMap<String, f64>,
}

pub(super) fn run(args: &DemoArgs, console: &Console) -> anyhow::Result<()> {
    output::folder("--out", &args.out, "a folder for all that the demo makes")?;
    let _lock = lock_folder(&args.out)?;
    let (data, run) = (args.out.join("data"), args.out.join("run"));
    let mut clock = StageClock::open(args.out.join("stages.json"));

    let settings = CollectSettings {
        count: args.samples,
        seed: args.seed,
        ..CollectSettings::default()
    };
    require_as_many(&data, args.samples)?;
    clock.time("collect", || collect(&settings, &data, console).map(drop))?;

    let size = PRESET.size();
    let precision = args.precision.of_width(size.width);
    let training = TrainSettings {
        validate_every: (args.steps / 12).max(1),
        seed: args.seed,
        precision,
        ..PRESET.settings(PRESET.rates[0], args.steps)
    };
    let trained = clock.time("train", || {
        train(
            &TrainingData::Set(data.clone()),
            &run,
            size,
            &training,
            None,
            console,
        )
    })?;

    let scoring = EvalSettings {
        seed: args.seed,
        ..EvalSettings::default()
    };
    let model = Arc::new(trained.model.clone().with_precision(precision)?);
    let predictor = FlowPredictor::new(model.clone(), Sampler::default());
    let (evaluation, examples, per_test) = clock.time("evaluate", || {
        let evaluator = Evaluator::new(Arc::new(predictor), &data, scoring)?;
        let evaluation = evaluator.run(Some(&args.out.join("evaluation.jsonl")), console)?;
        let examples = examples(&evaluator, &evaluation)?;
        let per_test = page::per_test(&evaluator, &evaluation)?;
        Ok((evaluation, examples, per_test))
    })?;

    let metrics = DemoMetrics {
        metrics: Metrics::new(&evaluation, &scoring, Some(&model)),
        seconds: clock.seconds.values().sum(),
        stages: clock.seconds.clone(),
    };
    let report = Report {
        examples,
        per_test: Some(per_test),
        ..report(args, &settings, &trained, &evaluation, &metrics)?
    };
    let json = serde_json::to_vec_pretty(&metrics).context("cannot write the metrics as JSON")?;
    let sheet = contact_sheet_examples(&report.examples);
    for (name, bytes) in [
        ("metrics.json", json),
        ("report.html", report.to_html().into_bytes()),
        ("shapes.png", contact_sheet(&sheet, SHEET_PANEL_WIDTH)),
    ] {
        let path = args.out.join(name);
        output::write(&path, bytes)?;
    }
    tracing::info!(
        "shapes.png: test commands from the best prediction to the worst; the bar is {:.0} cm",
        100.0 * scale_bar(&sheet, SHEET_PANEL_WIDTH)
    );
    console.result(&metrics, |m| {
        format!(
            "{}\nmeans over {} test commands; {:.0} s in all\n{}\nsee {}",
            table(&evaluation),
            m.metrics.tests,
            m.seconds,
            page::headline(&m.metrics),
            args.out.join("report.html").display()
        )
    })
}

/// Refuses to let a data set grow on which a network was, or is being, trained.
fn require_as_many(data: &Path, samples: usize) -> anyhow::Result<()> {
    let held = DataSet::open(data)
        .ok()
        .and_then(|set| set.meta().map(|meta| meta.count));
    match held {
        Some(held) if held != samples => bail!(
            "{} holds {held} samples and --samples is {samples}: ask for {held}, or choose another folder (--out)",
            data.display()
        ),
        _ => Ok(()),
    }
}

/// Adds up the time of each stage over all the runs that it took.
struct StageClock {
    path: PathBuf,
    seconds: BTreeMap<String, f64>,
}

impl StageClock {
    fn open(path: PathBuf) -> Self {
        // Times are for the report alone: without them, or with others, the work goes on as well.
        let seconds = std::fs::read(&path)
            .ok()
            .and_then(|bytes| serde_json::from_slice(&bytes).ok());
        Self {
            seconds: seconds.unwrap_or_default(),
            path,
        }
    }

    fn time<T>(
        &mut self,
        stage: &str,
        work: impl FnOnce() -> Result<T, PipelineError>,
    ) -> Result<T, PipelineError> {
        let start = Instant::now();
        let result = work();
        *self.seconds.entry(stage.to_owned()).or_default() += start.elapsed().as_secs_f64();
        if let Ok(json) = serde_json::to_vec(&self.seconds)
            && let Err(error) = output::write(&self.path, json)
        {
            tracing::warn!("the time of a stage is not noted: {error:#}");
        }
        result
    }
}

fn examples(evaluator: &Evaluator, evaluation: &Evaluation) -> Result<Vec<Example>, PipelineError> {
    let shown = evaluation.spread(EXAMPLES);
    let last = shown.len() - 1;
    let example = |(rank, index): (usize, usize)| {
        let label = match rank {
            0 => format!("test {index}, the best"),
            rank if rank == last => format!("test {index}, the worst"),
            _ => format!("test {index}"),
        };
        page::example(evaluator, evaluation, index, label)
    };
    shown.into_iter().enumerate().map(example).collect()
}

/// At most four of the report's examples, the best and the worst among them.
fn contact_sheet_examples(examples: &[Example]) -> Vec<Example> {
    let count = examples.len().min(4);
    let rank = |k: usize| k * (examples.len() - 1) / (count.max(2) - 1);
    (0..count).map(|k| examples[rank(k)].clone()).collect()
}

fn report(
    args: &DemoArgs,
    settings: &CollectSettings,
    trained: &Trained,
    evaluation: &Evaluation,
    metrics: &DemoMetrics,
) -> anyhow::Result<Report> {
    let splits = split_indices(args.samples, args.seed)?;
    let [train_count, val_count, test_count] = Split::ALL.map(|split| splits.of(split).len());
    let model = &trained.model;
    let stage_seconds = |name: &str| metrics.stages.get(name).copied().unwrap_or(f64::NAN);
    Ok(Report {
        title: "The shape of a 2-module tendon-driven continuum robot, learned from its commands"
            .to_owned(),
        headline: page::headline(&metrics.metrics),
        summary: vec![
            (
                "Robot".to_owned(),
                format!("{} of the paper, without base", settings.robot.name),
            ),
            (
                "Commands".to_owned(),
                format!("{train_count} train, {val_count} validation, {test_count} test"),
            ),
            (
                "Cameras".to_owned(),
                settings.robot.cameras.count().to_string(),
            ),
            (
                "Points per cloud".to_owned(),
                format!(
                    "{}, from {} mm voxels",
                    settings.points,
                    settings.voxel_size * 1e3
                ),
            ),
            (
                "Network".to_owned(),
                format!(
                    "MLP, width {}, depth {}, {} parameters",
                    PRESET.width,
                    PRESET.depth,
                    model.network.params().len()
                ),
            ),
            (
                "Training".to_owned(),
                format!(
                    "{} steps of {} clouds of {} points; best at step {}",
                    model.settings.steps, model.settings.clouds, model.settings.points, model.step
                ),
            ),
            (
                "Sampler".to_owned(),
                page::sampler_text(&Sampler::default()),
            ),
            (
                "Precision".to_owned(),
                page::precision_text(&metrics.metrics).unwrap_or_default(),
            ),
            ("Seed".to_owned(), args.seed.to_string()),
            ("tdcr".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ],
        scores: page::scores(evaluation),
        floor: page::floor(evaluation),
        score_notes: page::score_notes(&metrics.metrics),
        training: Some(Training {
            loss_curve: (1u64..)
                .zip(trained.losses.iter().map(|loss| f64::from(*loss)))
                .collect(),
            validation_curve: trained.validations.clone(),
            validation_note: format!(
                "Computed on {} points of {} clouds: fewer points than in the table, which makes it larger.",
                model.settings.validation_points, model.settings.validation_clouds
            ),
        }),
        motors: MotorGroup::of(Some(&settings.robot), settings.robot.tendon_count()),
        stages: [
            ("Simulate and see", "collect"),
            ("Train", "train"),
            ("Predict and evaluate", "evaluate"),
        ]
        .map(|(name, key)| Stage {
            name: name.to_owned(),
            seconds: stage_seconds(key),
        })
        .into(),
        ..Report::default()
    })
}
