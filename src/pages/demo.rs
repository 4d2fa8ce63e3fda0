//! The demo: from simulation to scores once, ending in a report.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde::Serialize;
use tdcr_base::files::{LARGEST_TEXT, read_text};
use tdcr_learn::data::{DataSet, Recipe, Split, split_indices};
use tdcr_learn::flow::Sampler;
use tdcr_learn::net::{MlpShape, Precision};
use tdcr_learn::options::{DataFacts, Resolved, TrainOptions};
use tdcr_learn::symmetry::SymmetryUse;
use tdcr_learn::train::{FlowPredictor, TrainError, TrainSettings};
use tdcr_sim::robot::RobotSpec;
use tdcr_sim::scene::Scene;

use super::{PageError, evaluation as page, write};
use crate::pipeline::{
    CollectSettings, EvalSettings, Evaluation, Evaluator, Metrics, Monitor, PipelineError,
    TrainRunError, Trained, TrainingData, collect, lock_folder, train,
};
use crate::report::{Example, MotorGroup, Report, Stage, Training, contact_sheet, scale_bar};

/// How large a demo is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DemoSettings {
    /// Commands to simulate, split 80/10/10.
    pub samples: usize,
    /// Optimiser steps.
    pub steps: u64,
    /// Operand type of the network's matrix products; the fastest by default.
    pub precision: Option<Precision>,
    /// Whether the network learns representatives of symmetric conditions.
    pub symmetry: SymmetryUse,
    /// Seed of everything random.
    pub seed: u64,
}

impl Default for DemoSettings {
    fn default() -> Self {
        Self {
            samples: 2000,
            steps: 5500,
            precision: None,
            symmetry: TrainSettings::default().symmetry,
            seed: 0,
        }
    }
}

/// Test commands that the report shows, from the best prediction to the worst.
const EXAMPLES: usize = 6;
const SHEET_PANEL_WIDTH: usize = 260;

/// What the demo found.
#[derive(Clone, Debug)]
pub struct Demo {
    /// The scores of every test command.
    pub evaluation: Evaluation,
    /// Their means, and the times.
    pub metrics: DemoMetrics,
    /// The page.
    pub report: PathBuf,
    /// Length of the scale bar in the picture `shapes.png` (m).
    pub scale_bar: f64,
}

/// What `metrics.json` says.
#[derive(Clone, Debug, Serialize)]
pub struct DemoMetrics {
    /// Mean scores.
    #[serde(flatten)]
    pub metrics: Metrics,
    /// Wall-clock time of all stages, those before an interruption included (s).
    pub seconds: f64,
    /// Wall-clock time of each stage (s).
    pub stages: BTreeMap<String, f64>,
}

/// Simulates, sees, learns, predicts and evaluates the paper's 2m robot, all in the folder `out`: `data`, `run`,
/// `metrics.json`, `report.html` and `shapes.png`. Interrupted, the same call goes on where it stopped.
///
/// # Errors
/// [`PageError::OtherCount`] where the folder holds a demo of another size, [`PageError::Stage`] where a stage fails or is
/// interrupted.
pub fn demo(settings: &DemoSettings, out: &Path, monitor: &dyn Monitor) -> Result<Demo, PageError> {
    // Before the folder is made, which would be left behind.
    split_indices(settings.samples, settings.seed).map_err(PipelineError::from)?;
    let _lock = lock_folder(out)?;
    let (data, run) = (out.join("data"), out.join("run"));
    let mut clock = StageClock::open(out.join("stages.json"));

    let collecting = CollectSettings {
        samples: settings.samples,
        seed: settings.seed,
        ..CollectSettings::default()
    };
    let robot = Recipe::default().subject.robot;
    require_as_many(&data, settings.samples)?;
    clock.time("collect", || {
        collect(&robot, &Scene::default(), &collecting, &data, monitor).map(drop)
    })?;

    let options = TrainOptions {
        steps: Some(settings.steps),
        validate_every: Some((settings.steps / 12).max(1)),
        precision: settings.precision,
        symmetry: Some(settings.symmetry),
        seed: settings.seed,
        ..TrainOptions::default()
    };
    let resolved = options.resolve(&DataFacts::default());
    let Resolved {
        shape,
        settings: training,
    } = resolved
        .map_err(TrainRunError::from)
        .map_err(PipelineError::from)?;
    let trained = clock.time("train", || {
        let data = TrainingData::Set(data.clone());
        train(&data, &run, shape, &training, None, monitor)
    })?;

    let compared = EvalSettings {
        seed: settings.seed,
        ..EvalSettings::default()
    };
    let model = trained.model.clone().with_precision(training.precision);
    let model = Arc::new(
        model
            .map_err(TrainError::from)
            .map_err(PipelineError::from)?,
    );
    let predictor = FlowPredictor::new(model.clone(), Sampler::default());
    let (scoring, evaluation, examples, per_test) = clock.time("evaluate", || {
        let evaluator = Evaluator::new(Arc::new(predictor), &data, compared)?;
        let evaluation = evaluator.run(Some(&out.join("evaluation.jsonl")), monitor)?;
        let examples = examples(&evaluator, &evaluation)?;
        let per_test = page::per_test(&evaluator, &evaluation)?;
        Ok((*evaluator.scoring(), evaluation, examples, per_test))
    })?;

    let metrics = DemoMetrics {
        metrics: Metrics::new(&evaluation, &scoring, Some(&model)),
        seconds: clock.seconds.values().sum(),
        stages: clock.seconds.clone(),
    };
    let report = Report {
        examples,
        per_test: Some(per_test),
        ..report(
            settings,
            (&robot, &collecting),
            &trained,
            &evaluation,
            &metrics,
        )?
    };
    let sheet = contact_sheet_examples(&report.examples);
    let page = out.join("report.html");
    for (path, bytes) in [
        (
            &out.join("metrics.json"),
            serde_json::to_vec_pretty(&metrics)?,
        ),
        (&page, report.to_html().into_bytes()),
        (
            &out.join("shapes.png"),
            contact_sheet(&sheet, SHEET_PANEL_WIDTH),
        ),
    ] {
        write(path, &bytes)?;
    }
    Ok(Demo {
        evaluation,
        metrics,
        report: page,
        scale_bar: scale_bar(&sheet, SHEET_PANEL_WIDTH),
    })
}

/// Refuses to let a data set grow on which a network was, or is being, trained.
fn require_as_many(data: &Path, samples: usize) -> Result<(), PageError> {
    let held = DataSet::open(data)
        .ok()
        .and_then(|set| set.meta().map(|meta| meta.count));
    match held {
        Some(found) if found != samples => Err(PageError::OtherCount {
            path: data.to_owned(),
            found,
            expected: samples,
        }),
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
        let seconds = read_text(&path, LARGEST_TEXT)
            .ok()
            .and_then(|text| serde_json::from_str(&text).ok());
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
            && let Err(error) = write(&self.path, &json)
        {
            tracing::warn!("the time of a stage is not noted: {error}");
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
        page::example(evaluator, evaluation, 0, index, label)
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
    demo: &DemoSettings,
    (robot, settings): (&RobotSpec, &CollectSettings),
    trained: &Trained,
    evaluation: &Evaluation,
    metrics: &DemoMetrics,
) -> Result<Report, PageError> {
    let splits = split_indices(demo.samples, demo.seed).map_err(PipelineError::from)?;
    let [train_count, val_count, test_count] = Split::ALL.map(|split| splits.of(split).len());
    let model = &trained.model;
    let network = MlpShape::default();
    let stage_seconds = |name: &str| metrics.stages.get(name).copied().unwrap_or(f64::NAN);
    Ok(Report {
        title: "The shape of a 2-module tendon-driven continuum robot, learned from its commands"
            .to_owned(),
        headline: page::headline(&metrics.metrics),
        summary: vec![
            (
                "Robot".to_owned(),
                format!("{} of the paper, without base", robot.name),
            ),
            (
                "Commands".to_owned(),
                format!("{train_count} train, {val_count} validation, {test_count} test"),
            ),
            ("Cameras".to_owned(), robot.cameras.count().to_string()),
            (
                "Points per cloud".to_owned(),
                format!(
                    "{}, from {} mm voxels",
                    settings.points,
                    settings.voxel * 1e3
                ),
            ),
            (
                "Network".to_owned(),
                format!(
                    "MLP, width {}, depth {}, {} parameters",
                    network.width,
                    network.depth,
                    model.network.shape().learned_parameters()
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
            ("Refinement".to_owned(), page::refinement_text(model)),
            (
                "Precision".to_owned(),
                page::precision_text(&metrics.metrics).unwrap_or_default(),
            ),
            ("Seed".to_owned(), demo.seed.to_string()),
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
        motors: MotorGroup::of(Some(robot), robot.tendon_count()),
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
