//! The page that `tdcr eval` writes, and what it shares with the demo's.

use tdcr::learn::data::Sample;
use tdcr::learn::flow::{Sampler, TimeGrid};
use tdcr::learn::metrics::nearest_distances;
use tdcr::pipeline::{Distances, Evaluation, Evaluator, PipelineError};
use tdcr::report::{Example, MotorGroup, PerTest, Report, Score};
use tdcr::sim::cloud::PointCloud;
use tdcr::sim::robot::Robot;

use super::eval::{EvalArgs, Metrics};

/// The page on an evaluation that shows the `worst` test commands.
pub(super) fn page(
    args: &EvalArgs,
    evaluator: &Evaluator,
    evaluation: &Evaluation,
    metrics: &Metrics,
    worst: &[usize],
) -> Result<Report, PipelineError> {
    let label = |rank: usize, test: usize| match rank {
        0 => format!("test {test}, the worst"),
        rank => format!("test {test}, number {} of the worst", rank + 1),
    };
    let (model, settings) = (evaluator.model(), evaluator.settings());
    let entry = |name: &str, value: String| (name.to_owned(), value);
    let mut summary = match (&args.predictions, model) {
        (Some(file), _) => vec![entry("Predictions", file.display().to_string())],
        (None, Some(model)) => vec![
            entry("Model", args.model.display().to_string()),
            entry(
                "Network",
                format!("{} parameters", model.network.params().len()),
            ),
            entry("Training", format!("best at step {}", model.step)),
            entry("Sampler", sampler_text(&settings.sampler)),
        ],
        (None, None) => vec![],
    };
    summary.extend(precision_text(metrics).map(|text| entry("Precision", text)));
    summary.extend([
        entry("Data set", args.data.display().to_string()),
        entry("Test commands", metrics.tests.to_string()),
        entry("Seed", settings.seed.to_string()),
        entry("tdcr", env!("CARGO_PKG_VERSION").to_owned()),
    ]);
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
            .map(|(rank, &test)| example(evaluator, evaluation, test, label(rank, test)))
            .collect::<Result<_, _>>()?,
    })
}

fn score(name: &str, distances: Distances) -> Score {
    Score {
        name: name.to_owned(),
        cd: distances.cd,
        emd: distances.emd,
        emd_squared: distances.emd_squared,
    }
}

/// How far the network's clouds are from the true ones, beside those of the nearest training command: root mean square
/// distances between nearest points, and their ratio. CD is the sum of the mean squares both ways, so a ratio of CDs is one
/// of squared distances.
pub(super) fn headline(metrics: &Metrics) -> String {
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
    MotorGroup::of(evaluator.robot().map(Robot::spec), count)
}

/// Mean scores of the predictors.
pub(super) fn scores(evaluation: &Evaluation) -> Vec<Score> {
    let mean = evaluation.mean();
    [
        Some(score("Network", mean.network)),
        Some(score("Nearest training command", mean.nearest)),
        mean.mean.map(|mean| score("Mean command", mean)),
        mean.perfect
            .map(|perfect| score("Perfect predictor", perfect)),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Mean score of second samples of the true surfaces.
pub(super) fn floor(evaluation: &Evaluation) -> Option<Score> {
    let floor = evaluation.mean().floor;
    floor.map(|floor| score("Sampling floor", floor))
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

/// How the scores were computed.
pub(super) fn score_notes(metrics: &Metrics) -> Vec<String> {
    let mut notes = vec![
        format!("Means over {} test commands.", metrics.tests),
        format!(
            "Chamfer distance on {} points of each cloud, earth mover's distances on {}.",
            metrics.points, metrics.emd_points
        ),
        "A perfect predictor draws points of the seen surface independently of each other; the floor's view has its \
         pixels and voxels in a random phase."
            .to_owned(),
        format!(
            "The matchings are optimal: their duality gaps are at most {:.1e} m, and {:.1e} m² where squared.",
            metrics.emd_gap, metrics.emd_squared_gap
        ),
    ];
    notes.extend(tip_note(metrics));
    notes.extend(metrics.uncertainty_text());
    notes
}

/// Chamfer distances of each test command.
pub(super) fn per_test(
    evaluator: &Evaluator,
    evaluation: &Evaluation,
) -> Result<PerTest, PipelineError> {
    let all = &evaluation.per_test;
    let command = |sample: &Sample| sample.condition.motors.iter().map(|&x| x.into()).collect();
    Ok(PerTest {
        network: all.iter().map(|s| s.network.cd).collect(),
        nearest: all.iter().map(|s| s.nearest.cd).collect(),
        floor: all.iter().filter_map(|s| Some(s.floor?.cd)).collect(),
        commands: evaluator.test().iter().map(command).collect(),
        apart: (0..all.len())
            .map(|test| evaluator.distance_to_training(test))
            .collect::<Result<_, _>>()?,
    })
}

/// The clouds of one test command.
pub(super) fn example(
    evaluator: &Evaluator,
    evaluation: &Evaluation,
    test: usize,
    label: String,
) -> Result<Example, PipelineError> {
    let scores = &evaluation.per_test[test];
    let sample = &evaluator.test()[test];
    let condition = &sample.condition;
    let prediction = evaluator.predict(test)?;
    let uncertainty = prediction.uncertainty(&[]).unwrap_or_default();
    Ok(Example {
        label,
        command: condition.motors.iter().map(|&x| x.into()).collect(),
        payload: condition.payload.map(f64::from),
        truth: sample.cloud.clone(),
        error: nearest_distances(&prediction.points, &sample.cloud.points)?,
        uncertainty: uncertainty.into_iter().map(f64::from).collect(),
        tip: scores.tip.map(|tip| tip.network),
        prediction: colorless(prediction.points),
        nearest: colorless(evaluator.nearest(test)?),
        cd: scores.network.cd,
        emd: scores.network.emd,
        cd_nearest: scores.nearest.cd,
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

/// What the sampler is, in a few words.
pub(super) fn sampler_text(sampler: &Sampler) -> String {
    let Sampler {
        method,
        steps,
        grid,
    } = sampler;
    let steps = match grid {
        TimeGrid::Uniform => format!("{steps} equal steps"),
        TimeGrid::Power(power) => format!("{steps} steps, power {power}"),
        TimeGrid::Adaptive(tolerance) => format!("at most {steps} steps, tolerance {tolerance}"),
        _ => format!("at most {steps} steps"),
    };
    format!("{}, {steps}", method.name())
}
