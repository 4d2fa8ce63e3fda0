//! The page on an evaluation, and what it shares with the demo's.

use std::path::Path;

use tdcr_learn::data::Sample;
use tdcr_learn::flow::{ColorSteps, Sampler, TimeGrid};
use tdcr_learn::metrics::nearest_distances;
use tdcr_learn::train::Model;
use tdcr_sim::cloud::PointCloud;

use crate::pipeline::{
    Evaluation, Evaluator, Metrics, PipelineError, Results, Row, RowKind, RowScore,
};
use crate::report::{Example, MethodDistances, MotorGroup, PerTest, Report, Role, Score};

/// What is evaluated.
#[derive(Clone, Copy, Debug)]
pub enum Evaluated<'a> {
    /// A trained model.
    Model {
        /// Its file.
        file: &'a Path,
        /// The model, in the precision that it predicts in.
        model: &'a Model,
        /// How its flow is followed.
        sampler: &'a Sampler,
    },
    /// Clouds of any program.
    Clouds {
        /// What they are called: their file.
        name: &'a str,
    },
}

impl<'a> Evaluated<'a> {
    /// The model, if there is one.
    pub fn model(&self) -> Option<&'a Model> {
        match self {
            Self::Model { model, .. } => Some(model),
            Self::Clouds { .. } => None,
        }
    }

    /// What there is to say of it, as name and value.
    pub(super) fn facts(&self) -> Vec<(String, String)> {
        let facts = match self {
            Self::Clouds { name } => vec![("Predictions", (*name).to_owned())],
            Self::Model {
                file,
                model,
                sampler,
            } => vec![
                ("Model", file.display().to_string()),
                (
                    "Network",
                    format!("{} parameters", model.network.shape().learned_parameters()),
                ),
                ("Training", format!("best at step {}", model.step)),
                ("Sampler", sampler_text(sampler)),
                ("Refinement", refinement_text(model)),
            ],
        };
        let named = facts.into_iter();
        named
            .map(|(name, value)| (name.to_owned(), value))
            .collect()
    }
}

/// The page on an evaluation on the data set in the folder `data`, with the worst test commands of `results`.
///
/// # Errors
/// [`PipelineError`] where the clouds that the page shows cannot be predicted again.
pub fn evaluation_page(
    evaluated: &Evaluated<'_>,
    data: &Path,
    evaluator: &Evaluator,
    evaluation: &Evaluation,
    Results { metrics, worst, .. }: &Results,
) -> Result<Report, PipelineError> {
    let label = |rank: usize, test: usize| match rank {
        0 => format!("test {test}, the worst"),
        rank => format!("test {test}, number {} of the worst", rank + 1),
    };
    let entry = |name: &str, value: String| (name.to_owned(), value);
    let mut summary = evaluated.facts();
    summary.extend(precision_text(metrics).map(|text| entry("Precision", text)));
    summary.extend(settings(data, evaluator, metrics));
    Ok(Report {
        title: "A network's clouds against the true ones".to_owned(),
        headline: headline(metrics),
        summary,
        scores: scores(evaluation),
        floor: floor(evaluation),
        score_notes: score_notes(metrics),
        per_test: Some(per_test(evaluator, evaluation)?),
        training: None,
        stages: Vec::new(),
        motors: motors(evaluator),
        examples: (worst.iter().enumerate())
            .map(|(rank, worst)| {
                let label = label(rank, worst.test);
                example(evaluator, evaluation, 0, worst.test, label)
            })
            .collect::<Result<_, _>>()?,
    })
}

/// What all evaluations say of their settings.
pub(super) fn settings(
    data: &Path,
    evaluator: &Evaluator,
    metrics: &Metrics,
) -> [(String, String); 4] {
    [
        ("Data set", data.display().to_string()),
        ("Test commands", metrics.tests.to_string()),
        ("Seed", evaluator.scoring().seed.to_string()),
        ("tdcr", env!("CARGO_PKG_VERSION").to_owned()),
    ]
    .map(|(name, value)| (name.to_owned(), value))
}

/// How far the network's clouds are from the true ones, beside those of the nearest training command: root mean square
/// distances between nearest points, and their ratio. CD is the sum of the mean squares both ways, so a ratio of CDs is one
/// of squared distances.
pub fn headline(metrics: &Metrics) -> String {
    let [network, nearest] = [metrics.cd, metrics.cd_nearest].map(|cd| 1e3 * (cd / 2.0).sqrt());
    format!(
        "Over {} test commands, points of the network's clouds and of the true ones are {network:.2} mm from the nearest \
         point of the other (root mean square, {} points a cloud); with the clouds of the nearest training commands it is \
         {nearest:.2} mm, {:.1} times as far.",
        metrics.tests,
        metrics.points,
        nearest / network
    )
}

/// Which numbers of the data set's commands belong together.
pub(super) fn motors(evaluator: &Evaluator) -> Vec<MotorGroup> {
    let count = evaluator
        .test()
        .first()
        .map_or(0, |sample| sample.condition.motors.len());
    MotorGroup::of(evaluator.shown(), count)
}

/// Key of the row that ratios are of.
const FLOOR: &str = "floor";

/// Mean scores of all rows but the floor, methods first.
pub(super) fn scores(evaluation: &Evaluation) -> Vec<Score> {
    let mut scores = mean_scores(evaluation, |row| row.kind == RowKind::Method);
    scores.extend(mean_scores(evaluation, |row| {
        row.kind != RowKind::Method && row.about.key != FLOOR
    }));
    scores
}

/// Mean score of second samples of the true surfaces.
pub(super) fn floor(evaluation: &Evaluation) -> Option<Score> {
    mean_scores(evaluation, |row| row.about.key == FLOOR).pop()
}

fn mean_scores(evaluation: &Evaluation, which: impl Fn(&Row) -> bool) -> Vec<Score> {
    let mean = evaluation.mean().rows;
    let rows = evaluation.rows.iter().zip(mean);
    rows.filter(|(row, _)| which(row))
        .map(|(row, RowScore { distances, .. })| Score {
            name: title(row),
            cd: distances.cd,
            emd: distances.emd,
            emd_squared: distances.emd_squared,
        })
        .collect()
}

/// A row's name with a capital.
fn title(row: &Row) -> String {
    let mut letters = row.about.name.chars();
    let first = letters.next().into_iter().flat_map(char::to_uppercase);
    first.chain(letters).collect()
}

/// What is said of the tips.
fn tip_note(metrics: &Metrics) -> Option<String> {
    let (network, nearest) = (1e3 * metrics.tip?, 1e3 * metrics.tip_nearest?);
    Some(format!(
        "The tip is off by {network:.2} mm on average in the network's clouds, and by {nearest:.2} mm in those of the nearest \
         training commands: how far the last disc moves when the points of the true cloud on it are laid onto the \
         other cloud as a rigid body."
    ))
}

/// How the scores were computed, and what they are of the tips and uncertainties of the network's clouds.
pub(super) fn score_notes(metrics: &Metrics) -> Vec<String> {
    let mut notes = comparison_notes(metrics);
    notes.extend(tip_note(metrics));
    notes.extend(metrics.uncertainty_text());
    notes
}

/// How the scores were computed.
pub(super) fn comparison_notes(metrics: &Metrics) -> Vec<String> {
    let mut notes = vec![
        format!("Means over {} test commands.", metrics.tests),
        format!(
            "Chamfer distance on {} points of each cloud, earth mover's distances on {}.",
            metrics.points, metrics.emd_points
        ),
        "A perfect predictor draws points of the seen surface independently of each other; evenly spread, it draws half as \
         many again, leaves out isolated and crowded ones and evens the others out, as for the cloud of a refined network; the floor's view \
         has its pixels and voxels in a random phase."
            .to_owned(),
        format!(
            "The matchings are optimal: their duality gaps are at most {:.1e} m, and {:.1e} m² where squared.",
            metrics.emd_gap, metrics.emd_squared_gap
        ),
    ];
    notes.extend(metrics.repetition_text());
    notes
}

/// Chamfer distances of each test command.
pub(super) fn per_test(
    evaluator: &Evaluator,
    evaluation: &Evaluation,
) -> Result<PerTest, PipelineError> {
    let command = |sample: &Sample| sample.condition.motors.iter().map(|&x| x.into()).collect();
    Ok(PerTest {
        methods: methods(evaluation),
        commands: evaluator.test().iter().map(command).collect(),
        apart: (0..evaluation.per_test.len())
            .map(|test| evaluator.distance_to_training(test))
            .collect::<Result<_, _>>()?,
    })
}

/// The rows whose distances are drawn: not the mean command, which is far off, nor the perfect predictors, which are where the
/// floor is.
fn methods(evaluation: &Evaluation) -> Vec<MethodDistances> {
    let mut methods = Vec::new();
    let mut others = 0;
    for (place, row) in evaluation.rows.iter().enumerate() {
        let role = match row.about.key.as_str() {
            _ if place == 0 => Role::Network,
            "nearest" => Role::Nearest,
            FLOOR => Role::Floor,
            "mean" | "perfect" | "perfect-selected" => continue,
            _ => {
                others += 1;
                Role::Other(others - 1)
            }
        };
        let values = evaluation.per_test.iter();
        methods.push(MethodDistances {
            name: title(row),
            role,
            values: values.map(|s| s.rows[place].distances.cd).collect(),
        });
    }
    methods
}

/// The clouds of one test command, the prediction that of the row at `place`.
pub(super) fn example(
    evaluator: &Evaluator,
    evaluation: &Evaluation,
    place: usize,
    test: usize,
    label: String,
) -> Result<Example, PipelineError> {
    let scores = &evaluation.per_test[test];
    let evaluated = &scores.rows[place];
    let sample = &evaluator.test()[test];
    let condition = &sample.condition;
    let prediction = evaluator.predict(place, test)?;
    let uncertainty = prediction.uncertainty(&[]).unwrap_or_default();
    Ok(Example {
        label,
        command: condition.motors.iter().map(|&x| x.into()).collect(),
        payload: condition.payload.map(f64::from),
        truth: sample.cloud.clone(),
        error: nearest_distances(&prediction.points, &sample.cloud.points)?,
        uncertainty: uncertainty.into_iter().map(f64::from).collect(),
        tip: evaluated.tip,
        prediction: colorless(prediction.points),
        nearest: colorless(evaluator.nearest(test)?),
        cd: evaluated.distances.cd,
        emd: evaluated.distances.emd,
        cd_nearest: (scores.get("nearest")).map_or(f64::NAN, |row| row.distances.cd),
    })
}

fn colorless(points: Vec<[f32; 3]>) -> PointCloud {
    let colors = vec![[128; 3]; points.len()];
    PointCloud { points, colors }
}

/// What numbers the network's products are of; `None` where there is no network.
pub(super) fn precision_text(metrics: &Metrics) -> Option<String> {
    let (prediction, training) = (metrics.precision?, metrics.training_precision?);
    Some(format!(
        "{} in prediction, {} in training",
        prediction.name(),
        training.name()
    ))
}

/// How the last evaluation was learned, in a few words.
pub(super) fn refinement_text(model: &Model) -> String {
    let refinement = model.settings.refinement;
    match refinement.filter(|_| model.refinement.is_some()) {
        None => "none".to_owned(),
        Some(refinement) => format!("{} steps", refinement.steps),
    }
}

/// What the sampler is, in a few words.
pub(super) fn sampler_text(sampler: &Sampler) -> String {
    let Sampler {
        method,
        steps,
        grid,
        denoise,
        spare,
        colors,
    } = sampler;
    let steps = match grid {
        TimeGrid::Uniform => format!("{steps} equal steps"),
        TimeGrid::Power(power) => format!("{steps} steps, power {power}"),
        TimeGrid::Adaptive(tolerance) => format!("at most {steps} steps, tolerance {tolerance}"),
        _ => format!("at most {steps} steps"),
    };
    let denoise = denoise.map_or(String::new(), |t| format!(", denoised at {t}"));
    let spare = match spare {
        0.0 => String::new(),
        spare => format!(", {} % spare points", 100.0 * spare),
    };
    let colors = match colors {
        ColorSteps::Free => "",
        ColorSteps::Clamped => ", colours clamped after each step",
    };
    format!("{}, {steps}{denoise}{spare}{colors}", method.name())
}
