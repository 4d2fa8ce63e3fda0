//! The results of an evaluation, as files and `--json` name them.

use std::collections::BTreeMap;

use serde::Serialize;
use tdcr_learn::net::Precision;
use tdcr_learn::train::Model;

use super::{Distances, Evaluation, Evaluator, Quantiles, RowKind, RowScore, Scores, Scoring};

/// Keys of the rows that every evaluation of a simulated data set has, whose scores have names of their own.
const OWN_KEYS: [&str; 5] = ["nearest", "mean", "perfect", "perfect-selected", "floor"];

/// Mean scores, as `metrics.json` and `--json` name them: CD and squared EMD in m², EMD in m.
#[derive(Clone, Debug, Serialize)]
pub struct Metrics {
    /// Of what is evaluated.
    pub cd: f64,
    /// Of the sampling floor; `None`, as all rows that need a simulation, where the data set names no robot.
    pub cd_floor: Option<f64>,
    /// Of a perfect predictor, whose points are independent of each other.
    pub cd_perfect: Option<f64>,
    /// Of the same where half as many points again are drawn, isolated and crowded ones left out, and the others evened out, as a
    /// network's are.
    pub cd_perfect_selected: Option<f64>,
    /// Of the clouds of the nearest training commands.
    pub cd_nearest: f64,
    /// Of the cloud of the mean command.
    pub cd_mean: Option<f64>,
    /// Earth mover's distances, in the order of the above (m).
    pub emd: f64,
    /// Of the sampling floor.
    pub emd_floor: Option<f64>,
    /// Of the nearest training commands.
    pub emd_nearest: f64,
    /// Of the mean command.
    pub emd_mean: Option<f64>,
    /// Largest duality gap of all EMDs found, of every predictor and test command (m).
    pub emd_gap: f64,
    /// Least mean squared distances, in the same order (m²).
    pub emd_squared: f64,
    /// Of the sampling floor.
    pub emd_squared_floor: Option<f64>,
    /// Of the nearest training commands.
    pub emd_squared_nearest: f64,
    /// Of the mean command.
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
    /// Share of the points of a test command that are no farther than twice their uncertainty from the true cloud; mean over the
    /// commands.
    pub uncertainty_coverage: Option<f64>,
    /// Spearman's rank correlation of a point's uncertainty with its distance from the true cloud, over the points of
    /// a test command; mean over the commands.
    pub uncertainty_rank_points: Option<f64>,
    /// Spearman's rank correlation of a cloud's mean uncertainty with its Chamfer distance, over the test commands.
    pub uncertainty_rank_commands: Option<f64>,
    /// Evaluations of the network in a prediction; mean over the test commands. `None`, as what follows on the network, where
    /// the clouds are another program's.
    pub evaluations: Option<f64>,
    /// Test commands.
    pub tests: usize,
    /// Points of a test cloud; mean.
    pub true_points: f64,
    /// How many of these are distinct; mean. Fewer where clouds were filled up by repetition.
    pub distinct_true_points: f64,
    /// Points of each cloud that the Chamfer distance is computed on.
    pub points: usize,
    /// The same of the earth mover's distances.
    pub emd_points: usize,
    /// Operand type of the network's matrix products when it predicted.
    pub precision: Option<Precision>,
    /// The same when it was trained.
    pub training_precision: Option<Precision>,
    /// Scores of what else was compared, by key.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub others: BTreeMap<String, OtherMetrics>,
}

/// Mean scores of another predictor, in the units of [`Metrics`].
#[derive(Clone, Debug, Serialize)]
pub struct OtherMetrics {
    /// Its name.
    pub name: String,
    /// Chamfer distance.
    pub cd: f64,
    /// Earth mover's distance.
    pub emd: f64,
    /// Least mean squared distance.
    pub emd_squared: f64,
    /// Colour difference.
    pub color: Option<f64>,
    /// Distance of the tip.
    pub tip: Option<f64>,
    /// Evaluations of a network in a prediction.
    pub evaluations: f64,
    /// Training points that it saw.
    pub training_points: u64,
    /// Wall-clock time of its training (s), where that is known.
    pub training_seconds: Option<f64>,
}

impl Metrics {
    /// Of an evaluated model's network, in its present precision; of another program's clouds without a model.
    pub fn new(evaluation: &Evaluation, scoring: &Scoring, model: Option<&Model>) -> Self {
        let mean = evaluation.mean();
        let greatest = evaluation.greatest();
        let RowScore {
            distances,
            tip,
            color,
            uncertainty,
            evaluations,
            ..
        } = mean.evaluated();
        let of = |key: &str| mean.get(key).map(|row| row.distances);
        let [nearest, mean_command, perfect, selected, floor] = OWN_KEYS.map(of);
        // Every evaluation has the nearest training command.
        let nearest = nearest.unwrap_or(*distances);
        Self {
            cd: distances.cd,
            cd_floor: floor.map(|d| d.cd),
            cd_perfect: perfect.map(|d| d.cd),
            cd_perfect_selected: selected.map(|d| d.cd),
            cd_nearest: nearest.cd,
            cd_mean: mean_command.map(|d| d.cd),
            emd: distances.emd,
            emd_floor: floor.map(|d| d.emd),
            emd_nearest: nearest.emd,
            emd_mean: mean_command.map(|d| d.emd),
            emd_gap: greatest.emd_gap,
            emd_squared: distances.emd_squared,
            emd_squared_floor: floor.map(|d| d.emd_squared),
            emd_squared_nearest: nearest.emd_squared,
            emd_squared_mean: mean_command.map(|d| d.emd_squared),
            emd_squared_gap: greatest.emd_squared_gap,
            color: *color,
            tip: *tip,
            tip_nearest: mean.get("nearest").and_then(|row| row.tip),
            uncertainty: uncertainty.map(|u| u.mean),
            uncertainty_coverage: uncertainty.map(|u| u.coverage),
            uncertainty_rank_points: uncertainty.and_then(|u| u.rank_correlation),
            uncertainty_rank_commands: evaluation.uncertainty_rank_correlation(),
            evaluations: model.map(|_| *evaluations),
            tests: evaluation.per_test.len(),
            true_points: evaluation.true_points[0],
            distinct_true_points: evaluation.true_points[1],
            points: scoring.points,
            emd_points: scoring.emd_points,
            precision: model.map(|model| model.network.precision()),
            training_precision: model.map(|model| model.settings.precision),
            others: others(evaluation, &mean),
        }
    }

    /// Where test clouds repeat points, how many are distinct.
    pub fn repetition_text(&self) -> Option<String> {
        (self.distinct_true_points < self.true_points).then(|| {
            format!(
                "Of the {:.0} points of a test cloud, {:.0} are distinct on average: the others repeat them.",
                self.true_points, self.distinct_true_points
            )
        })
    }

    /// How uncertain the network is, and how well that tells its errors.
    pub fn uncertainty_text(&self) -> Option<String> {
        let number = |value: Option<f64>| value.map_or("unknown".to_owned(), |x| format!("{x:.2}"));
        self.uncertainty.map(|mean| {
            format!(
                "Uncertainty of the network's points: {:.3} mm on average; {:.1} % of the points are no farther than twice \
                 theirs from the true cloud. Its rank correlation with the error is {} over the points of a command, {} over \
                 the commands.",
                1e3 * mean,
                100.0 * self.uncertainty_coverage.unwrap_or(f64::NAN),
                number(self.uncertainty_rank_points),
                number(self.uncertainty_rank_commands)
            )
        })
    }
}

/// Scores of what was added to the evaluation.
fn others(evaluation: &Evaluation, mean: &Scores) -> BTreeMap<String, OtherMetrics> {
    let rows = evaluation.rows.iter().zip(&mean.rows).skip(1);
    rows.filter(|(row, _)| !OWN_KEYS.contains(&row.about.key.as_str()))
        .map(|(row, score)| {
            let metrics = OtherMetrics {
                name: row.about.name.clone(),
                cd: score.distances.cd,
                emd: score.distances.emd,
                emd_squared: score.distances.emd_squared,
                color: score.color,
                tip: score.tip,
                evaluations: score.evaluations,
                training_points: row.about.training.points,
                training_seconds: row.about.training.seconds,
            };
            (row.about.key.clone(), metrics)
        })
        .collect()
}

/// All that `tdcr eval --json` says of an evaluation.
#[derive(Clone, Debug, Serialize)]
pub struct Results {
    /// Means over the test commands; what is evaluated is the first method.
    #[serde(flatten)]
    pub metrics: Metrics,
    /// Quantiles over the test commands, of the first method.
    pub network_quantiles: DistanceQuantiles,
    /// The test commands with the greatest Chamfer distances of the first method, the worst first.
    pub worst: Vec<ScoredTest>,
    /// Where several methods are evaluated: these, what they are compared with, and the references. Nothing for a single one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub methods: Vec<MethodScores>,
}

/// A row of the table of several methods: means over the test commands.
#[derive(Clone, Debug, Serialize)]
pub struct MethodScores {
    /// Key of the row.
    pub key: String,
    /// Name of the row.
    pub name: String,
    /// Why it is there.
    pub kind: RowKind,
    /// Chamfer distance (m²).
    pub cd: f64,
    /// In units of the sampling floor's; `None` where the data set names no robot.
    pub cd_over_floor: Option<f64>,
    /// Earth mover's distance (m).
    pub emd: f64,
    /// Least mean squared distance (m²).
    pub emd_squared: f64,
    /// Distance of the tip (m).
    pub tip: Option<f64>,
    /// Time of all processors that its training took (s), where that is known.
    pub training_seconds: Option<f64>,
    /// Time that a prediction takes (s), where that is known.
    pub prediction_seconds: Option<f64>,
    /// Quantiles over the test commands, of a method.
    pub quantiles: Option<DistanceQuantiles>,
    /// The test commands of a method with the greatest Chamfer distances, the worst first.
    pub worst: Vec<ScoredTest>,
    /// That with the least.
    pub best: Option<ScoredTest>,
}

/// Quantiles of distances over the test commands.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct DistanceQuantiles {
    /// Of the Chamfer distance (m²).
    pub cd: Quantiles,
    /// Of the earth mover's distance (m).
    pub emd: Quantiles,
    /// Of the least mean squared distance (m²).
    pub emd_squared: Quantiles,
}

/// A test command, and the distances of a method's cloud.
#[derive(Clone, Debug, Serialize)]
pub struct ScoredTest {
    /// Index in the test split.
    pub test: usize,
    /// The command: a value for each motor.
    pub command: Vec<f32>,
    /// Mass hung from the tip (kg); `None` in a data set without payloads.
    pub payload: Option<f32>,
    /// Chamfer distance (m²).
    pub cd: f64,
    /// Earth mover's distance (m).
    pub emd: f64,
    /// Least mean squared distance (m²).
    pub emd_squared: f64,
}

impl Results {
    /// With the `worst` worst test commands of each method; `model` is the evaluated one in its present precision, `None` for
    /// another program's clouds, and for several methods.
    pub fn new(
        evaluator: &Evaluator,
        evaluation: &Evaluation,
        model: Option<&Model>,
        worst: usize,
    ) -> Self {
        let several = evaluation.methods().nth(1).is_some();
        let mean = evaluation.mean();
        let order = methods_first(evaluation).filter(|_| several);
        Self {
            metrics: Metrics::new(evaluation, evaluator.scoring(), model),
            network_quantiles: DistanceQuantiles::new(evaluation, 0),
            worst: worst_tests(evaluator, evaluation, 0, worst),
            methods: order
                .map(|place| MethodScores::new(evaluator, evaluation, &mean, place, worst))
                .collect(),
        }
    }
}

/// Places of the rows, the methods before all others.
fn methods_first(evaluation: &Evaluation) -> impl Iterator<Item = usize> {
    let is_method = |place: &usize| evaluation.rows[*place].kind == RowKind::Method;
    let others = (0..evaluation.rows.len()).filter(move |place| !is_method(place));
    evaluation.methods().chain(others)
}

impl MethodScores {
    fn new(
        evaluator: &Evaluator,
        evaluation: &Evaluation,
        mean: &Scores,
        place: usize,
        worst: usize,
    ) -> Self {
        let (row, score) = (&evaluation.rows[place], &mean.rows[place]);
        let is_method = row.kind == RowKind::Method;
        let best = evaluation.worst_first(place).pop();
        Self {
            key: row.about.key.clone(),
            name: row.about.name.clone(),
            kind: row.kind,
            cd: score.distances.cd,
            cd_over_floor: mean
                .get("floor")
                .map(|floor| score.distances.cd / floor.distances.cd),
            emd: score.distances.emd,
            emd_squared: score.distances.emd_squared,
            tip: score.tip,
            training_seconds: row.about.training.processor_seconds,
            prediction_seconds: row.about.prediction_seconds,
            quantiles: is_method.then(|| DistanceQuantiles::new(evaluation, place)),
            worst: match is_method {
                true => worst_tests(evaluator, evaluation, place, worst),
                false => Vec::new(),
            },
            best: best
                .filter(|_| is_method)
                .map(|test| ScoredTest::new(evaluator, evaluation, place, test)),
        }
    }
}

impl DistanceQuantiles {
    /// Of the row at `place`.
    fn new(evaluation: &Evaluation, place: usize) -> Self {
        Self {
            cd: evaluation.quantiles(place, |d| d.cd),
            emd: evaluation.quantiles(place, |d| d.emd),
            emd_squared: evaluation.quantiles(place, |d| d.emd_squared),
        }
    }
}

/// The `count` worst test commands of the row at `place`.
fn worst_tests(
    evaluator: &Evaluator,
    evaluation: &Evaluation,
    place: usize,
    count: usize,
) -> Vec<ScoredTest> {
    let worst = evaluation.worst_first(place).into_iter().take(count);
    worst
        .map(|test| ScoredTest::new(evaluator, evaluation, place, test))
        .collect()
}

impl ScoredTest {
    fn new(evaluator: &Evaluator, evaluation: &Evaluation, place: usize, test: usize) -> Self {
        let Distances {
            cd,
            emd,
            emd_squared,
            ..
        } = evaluation.per_test[test].rows[place].distances;
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
