//! The scores of an evaluation, and what they come to over the test commands.

use serde::{Deserialize, Serialize};
use tdcr_base::stats::{quantile, sorted};
use tdcr_learn::metrics::rank_correlation;
use tdcr_learn::predict::About;

/// Distances between two clouds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Distances {
    /// Squared Chamfer distance (m², paper, Eq. cd).
    pub cd: f64,
    /// Earth mover's distance (m, paper, Eq. emd).
    pub emd: f64,
    /// Duality gap of `emd` (m): no matching has a mean distance below `emd - emd_gap`.
    pub emd_gap: f64,
    /// Mean squared distance (m²) of the bijection that makes it least.
    pub emd_squared: f64,
    /// Duality gap of `emd_squared` (m²).
    pub emd_squared_gap: f64,
}

/// Scores of one row for one test command, or their means.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RowScore {
    /// Key of the row.
    pub key: String,
    /// Distances of its cloud from the true one.
    pub distances: Distances,
    /// Distance of the predicted tip from the true one (m): how far the last disc's origin moves when the points of the true
    /// cloud on that disc are laid onto the predicted cloud as a rigid body. `None` where the data set names no robot or
    /// shows too little of its last disc, and in rows of which it is not asked.
    pub tip: Option<f64>,
    /// Mean absolute difference, in [0, 1], of the colours of the predicted points from those of the nearest points
    /// of the whole true cloud ([`color_error`](tdcr_learn::metrics::color_error)). `None` where no colours are predicted,
    /// or all points of the test clouds have one.
    pub color: Option<f64>,
    /// How uncertain the prediction is; `None` where too few points tell, and in rows of which it is not asked.
    pub uncertainty: Option<UncertaintyScore>,
    /// Evaluations of a network that the prediction took.
    pub evaluations: f64,
}

/// Scores of several clouds for one test command, or their means: a row for each, in the order of [`Evaluation::rows`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// The rows; the first is what is evaluated.
    pub rows: Vec<RowScore>,
}

/// How uncertain a prediction is ([`Prediction::uncertainty`](tdcr_learn::predict::Prediction::uncertainty)), and how well
/// that tells where its cloud is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct UncertaintyScore {
    /// Mean over the points (m).
    pub mean: f64,
    /// Share of the points whose distance from the nearest point of the whole true cloud is at most twice their uncertainty.
    pub coverage: f64,
    /// Spearman's rank correlation over the points, in [-1, 1], with the distance from the nearest point of the whole
    /// true cloud; `None` where all points are equally uncertain, or equally wrong.
    pub rank_correlation: Option<f64>,
}

/// What a row of scores is of.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// What gave its clouds.
    pub about: About,
    /// Why it is there.
    pub kind: RowKind,
}

/// Why a row is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RowKind {
    /// It is evaluated.
    Method,
    /// What is evaluated is compared with it.
    Baseline,
    /// Its clouds are other samples of the true surface: a bound on what a predictor can reach, and none itself.
    Reference,
}

/// The scores of every test command.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// What is scored: first what is evaluated, then what it is compared with, references last.
    pub rows: Vec<Row>,
    /// Scores by index in the test split; at least one.
    pub per_test: Vec<Scores>,
    /// Points of a test cloud, and how many of them are distinct: means over the test commands. Clouds of data sets that take
    /// fewer points from the cameras than they are to have are filled up by repetition.
    pub true_points: [f64; 2],
}

/// Quantiles of values, in the unit of the values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Quantiles {
    /// Least.
    pub min: f64,
    /// 5 % lie below.
    pub p5: f64,
    /// 25 % lie below.
    pub p25: f64,
    /// Half lie below.
    pub median: f64,
    /// 75 % lie below.
    pub p75: f64,
    /// 95 % lie below.
    pub p95: f64,
    /// Greatest.
    pub max: f64,
}

impl Distances {
    /// Each distance combined over `all`, by `combine` of the values of one field.
    fn combined(all: &[Self], combine: impl Fn(&mut dyn Iterator<Item = f64>) -> f64) -> Self {
        let over = |pick: fn(&Self) -> f64| combine(&mut all.iter().map(pick));
        Self {
            cd: over(|d| d.cd),
            emd: over(|d| d.emd),
            emd_gap: over(|d| d.emd_gap),
            emd_squared: over(|d| d.emd_squared),
            emd_squared_gap: over(|d| d.emd_squared_gap),
        }
    }
}

impl RowScore {
    /// A row of distances alone.
    pub(super) fn new(key: &str, distances: Distances) -> Self {
        Self {
            key: key.to_owned(),
            distances,
            tip: None,
            color: None,
            uncertainty: None,
            evaluations: 0.0,
        }
    }

    /// Means over the test commands. The mean tip error is over the commands whose tips are seen; colours and uncertainties
    /// are known where they are for all commands.
    fn mean(all: &[&Self]) -> Self {
        let count = all.len() as f64;
        let distances: Vec<Distances> = all.iter().map(|row| row.distances).collect();
        let tips: Vec<f64> = all.iter().filter_map(|row| row.tip).collect();
        let uncertainties: Option<Vec<_>> = all.iter().map(|row| row.uncertainty).collect();
        Self {
            key: all[0].key.clone(),
            distances: Distances::combined(&distances, |x| x.sum::<f64>() / count),
            tip: (!tips.is_empty()).then(|| tips.iter().sum::<f64>() / tips.len() as f64),
            color: {
                let known = all.iter().map(|row| row.color);
                known.sum::<Option<f64>>().map(|sum| sum / count)
            },
            uncertainty: uncertainties.map(|all| UncertaintyScore::mean(&all)),
            evaluations: all.iter().map(|row| row.evaluations).sum::<f64>() / count,
        }
    }
}

impl Scores {
    /// Of what is evaluated.
    pub fn evaluated(&self) -> &RowScore {
        &self.rows[0]
    }

    /// The row of this key; `None` where there is none, as without a robot there are no `mean`, `perfect` and `floor`.
    pub fn get(&self, key: &str) -> Option<&RowScore> {
        self.rows.iter().find(|row| row.key == key)
    }
}

impl Evaluation {
    /// Mean scores over all test commands. A mean gap is a duality gap of the mean distance.
    pub fn mean(&self) -> Scores {
        let row = |k: usize| {
            let all: Vec<&RowScore> = self.per_test.iter().map(|s| &s.rows[k]).collect();
            RowScore::mean(&all)
        };
        Scores {
            rows: (0..self.rows.len()).map(row).collect(),
        }
    }

    /// Greatest value of each distance, and of each gap, over all predictors and test commands.
    pub fn greatest(&self) -> Distances {
        let rows = self.per_test.iter().flat_map(|scores| &scores.rows);
        let all: Vec<Distances> = rows.map(|row| row.distances).collect();
        Distances::combined(&all, |x| x.fold(0.0, f64::max))
    }

    /// Places of the rows that are evaluated: the first row, and others where several are.
    pub fn methods(&self) -> impl Iterator<Item = usize> {
        let rows = self.rows.iter().enumerate();
        rows.filter_map(|(place, row)| (row.kind == RowKind::Method).then_some(place))
    }

    /// What is evaluated, by test command.
    fn evaluated(&self) -> impl Iterator<Item = &RowScore> {
        self.per_test.iter().map(Scores::evaluated)
    }

    /// Spearman's rank correlation over the test commands, in [-1, 1], of the mean uncertainty of the evaluated cloud
    /// with its Chamfer distance; `None` where one is not known, or all are equal.
    pub fn uncertainty_rank_correlation(&self) -> Option<f64> {
        let uncertainty = self.evaluated().map(|row| Some(row.uncertainty?.mean));
        let distances: Vec<f64> = self.evaluated().map(|row| row.distances.cd).collect();
        rank_correlation(&uncertainty.collect::<Option<Vec<_>>>()?, &distances)
    }

    /// Quantiles over the test commands of one distance of the clouds of the row at `place`.
    pub fn quantiles(&self, place: usize, pick: fn(&Distances) -> f64) -> Quantiles {
        let rows = self.per_test.iter().map(|scores| &scores.rows[place]);
        Quantiles::of(rows.map(|row| pick(&row.distances)).collect())
    }

    /// Indices of all test commands, from the worst cloud of the row at `place` by Chamfer distance to the best.
    pub fn worst_first(&self, place: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.per_test.len()).collect();
        let cd = |index: &usize| self.per_test[*index].rows[place].distances.cd;
        order.sort_by(|a, b| cd(b).total_cmp(&cd(a)));
        order
    }

    /// Indices of `count` test commands, from the best evaluated cloud to the worst, evenly spread.
    pub fn spread(&self, count: usize) -> Vec<usize> {
        let worst_first = self.worst_first(0);
        let last = worst_first.len() - 1;
        let mut ranks: Vec<usize> = (0..count)
            .map(|k| (last as f64 * k as f64 / (count.max(2) - 1) as f64).round() as usize)
            .collect();
        ranks.dedup();
        ranks
            .into_iter()
            .map(|rank| worst_first[last - rank])
            .collect()
    }
}

impl UncertaintyScore {
    /// Means over the test commands; that of the correlations is over those which are known.
    fn mean(all: &[Self]) -> Self {
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let known: Vec<f64> = all.iter().filter_map(|s| s.rank_correlation).collect();
        Self {
            mean: mean(&all.iter().map(|s| s.mean).collect::<Vec<_>>()),
            coverage: mean(&all.iter().map(|s| s.coverage).collect::<Vec<_>>()),
            rank_correlation: (!known.is_empty()).then(|| mean(&known)),
        }
    }
}

impl Quantiles {
    /// As [`quantile`] has them; not numbers of no values.
    pub fn of(values: Vec<f64>) -> Self {
        let values = sorted(values);
        let at = |share: f64| quantile(&values, share);
        Self {
            min: at(0.0),
            p5: at(0.05),
            p25: at(0.25),
            median: at(0.5),
            p75: at(0.75),
            p95: at(0.95),
            max: at(1.0),
        }
    }

    /// The quantiles in ascending order, each with its name.
    pub fn named(&self) -> [(&'static str, f64); 7] {
        [
            ("min", self.min),
            ("5 %", self.p5),
            ("25 %", self.p25),
            ("median", self.median),
            ("75 %", self.p75),
            ("95 %", self.p95),
            ("max", self.max),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evaluation(cds: &[f64]) -> Evaluation {
        let distances = |cd: f64| Distances {
            cd,
            emd: 10.0 * cd,
            emd_gap: 1e-9 * cd,
            emd_squared: 100.0 * cd,
            emd_squared_gap: 1e-8 * cd,
        };
        let scores = |&cd: &f64| Scores {
            rows: vec![
                RowScore {
                    color: Some(0.1 * cd),
                    uncertainty: Some(UncertaintyScore {
                        mean: cd.sqrt(),
                        coverage: 0.2 * cd,
                        rank_correlation: (cd > 1.0).then_some(0.25 * cd),
                    }),
                    tip: (cd > 1.0).then_some(cd),
                    evaluations: 8.0 * cd,
                    ..RowScore::new("network", distances(cd))
                },
                RowScore {
                    tip: (cd > 1.0).then_some(4.0 * cd),
                    ..RowScore::new("nearest", distances(2.0 * cd))
                },
                RowScore::new("floor", distances(0.5 * cd)),
            ],
        };
        let row = |key: &str| Row {
            about: About {
                key: key.to_owned(),
                ..About::default()
            },
            kind: match key {
                "network" => RowKind::Method,
                "nearest" => RowKind::Baseline,
                _ => RowKind::Reference,
            },
        };
        Evaluation {
            rows: ["network", "nearest", "floor"].map(row).into(),
            per_test: cds.iter().map(scores).collect(),
            true_points: [10.0, 9.5],
        }
    }

    #[test]
    fn quantiles_of_one_test_are_its_value() {
        let quantiles = evaluation(&[0.3]).quantiles(0, |d| d.emd);
        assert!(quantiles.named().into_iter().all(|(_, value)| value == 3.0));
    }

    #[test]
    fn the_worst_come_first_and_a_spread_runs_from_best_to_worst() {
        let evaluation = evaluation(&[0.3, 0.1, 0.7, 0.2, 1.5]);
        assert_eq!(evaluation.worst_first(0), [4, 2, 0, 3, 1]);
        assert_eq!(evaluation.methods().collect::<Vec<_>>(), [0]);
        assert_eq!(evaluation.spread(3), [1, 0, 4]);
        assert_eq!(evaluation.spread(9), [1, 3, 0, 2, 4]);
    }

    #[test]
    fn uncertainties_correlate_over_the_tests_where_all_are_known() {
        let mut evaluation = evaluation(&[0.3, 0.1, 0.7, 0.2]);
        assert_eq!(evaluation.uncertainty_rank_correlation(), Some(1.0));
        let least = UncertaintyScore {
            mean: 0.0,
            coverage: 1.0,
            rank_correlation: None,
        };
        evaluation.per_test[0].rows[0].uncertainty = Some(least);
        // 1 - 6 sum d^2 / (n (n^2 - 1)), ranks 0, 1, 3, 2 instead of 2, 0, 3, 1.
        let expected = 1.0 - 6.0 * 6.0 / 60.0;
        let found = evaluation.uncertainty_rank_correlation();
        assert!(found.is_some_and(|found| (found - expected).abs() < 1e-15));
        evaluation.per_test[0].rows[0].uncertainty = None;
        assert_eq!(evaluation.uncertainty_rank_correlation(), None);
        assert_eq!(evaluation.mean().evaluated().uncertainty, None);
    }

    #[test]
    fn means_and_greatest_values_are_taken_of_each_distance_alone() {
        let evaluation = evaluation(&[1.0, 3.0]);
        let mean = evaluation.mean();
        let keys: Vec<&str> = mean.rows.iter().map(|row| row.key.as_str()).collect();
        assert_eq!(keys, ["network", "nearest", "floor"]);
        let of = |key: &str| mean.get(key).map(|row| row.distances);
        let network = mean.evaluated();
        assert_eq!((network.distances.cd, network.distances.emd), (2.0, 20.0));
        assert_eq!(of("nearest").map(|d| d.emd_squared), Some(400.0));
        assert_eq!(of("mean"), None);
        assert_eq!(of("floor").map(|d| d.cd), Some(1.0));
        assert_eq!(network.color, Some(0.2));
        let tips: Vec<Option<f64>> = mean.rows.iter().map(|row| row.tip).collect();
        assert_eq!(tips, [Some(3.0), Some(12.0), None]);
        assert_eq!(network.evaluations, 16.0);
        let uncertainty = UncertaintyScore {
            mean: 0.5 * (1.0 + 3.0_f64.sqrt()),
            coverage: 0.4,
            rank_correlation: Some(0.75),
        };
        assert_eq!(network.uncertainty, Some(uncertainty));
        let greatest = evaluation.greatest();
        assert_eq!((greatest.cd, greatest.emd_squared), (6.0, 600.0));
        assert!((greatest.emd_gap - 6e-9).abs() < 1e-20);
    }
}
