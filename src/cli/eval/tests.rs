//! A predictor of one's own beside those that every evaluation has.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use std::path::Path;
use std::sync::Arc;

use tdcr::learn::data::{Condition, DataSet, PredictedClouds, Split};
use tdcr::learn::predict::{About, PredictError, Prediction, Predictor, TrainingCost};
use tdcr::pages::{Evaluated, evaluation_page};
use tdcr::pipeline::{
    CollectSettings, EvalError, EvalSettings, Evaluation, Evaluator, Metrics, Monitor,
    PipelineError, Results, Silent, collect,
};

use super::table;
use crate::cli::with_hint;

/// Predicts a cloud that it was given, whatever the condition.
struct Fixed {
    key: &'static str,
    points: Vec<[f32; 3]>,
}

impl Predictor for Fixed {
    fn about(&self) -> About {
        About {
            key: self.key.to_owned(),
            name: "fixed guess".to_owned(),
            method: "one cloud for all conditions".to_owned(),
            training: TrainingCost {
                points: 7,
                seconds: Some(0.5),
                ..TrainingCost::default()
            },
            ..About::default()
        }
    }

    fn predict(&self, _: &Condition, _: usize, _: u64) -> Result<Prediction, PredictError> {
        Ok(Prediction {
            points: self.points.clone(),
            colors: None,
            evaluations: 3,
            ..Prediction::default()
        })
    }
}

const SETTINGS: EvalSettings = EvalSettings {
    points: Some(300),
    emd_points: Some(60),
    tests: None,
    seed: 5,
};

fn fixed(key: &'static str, data: &Path) -> Arc<Fixed> {
    let validation = DataSet::open(data).unwrap().read_split(Split::Val).unwrap();
    let points = validation[0].cloud.points.clone();
    Arc::new(Fixed { key, points })
}

/// A small data set in `folder`.
fn collected(folder: &Path) -> std::path::PathBuf {
    let data = folder.join("data");
    let settings = CollectSettings {
        samples: 20,
        points: 300,
        ..CollectSettings::default()
    };
    collect(
        &tdcr::learn::data::Recipe::default().subject.robot,
        &tdcr::sim::scene::Scene::default(),
        &settings,
        &data,
        &Silent,
    )
    .unwrap();
    data
}

fn keys(evaluation: &Evaluation) -> Vec<&str> {
    let rows = evaluation.rows.iter();
    rows.map(|row| row.about.key.as_str()).collect()
}

#[test]
fn an_added_predictor_is_scored_in_json_in_the_table_and_in_the_report() {
    let folder = tempfile::tempdir().unwrap();
    let data = collected(folder.path());
    let alone = Evaluator::new(fixed("first", &data), &data, SETTINGS).unwrap();
    let alone = alone.run(None, &Silent).unwrap();
    assert_eq!(
        keys(&alone),
        [
            "first",
            "nearest",
            "mean",
            "perfect",
            "perfect-selected",
            "floor"
        ]
    );

    let mut evaluator = Evaluator::new(fixed("first", &data), &data, SETTINGS).unwrap();
    evaluator.compare(fixed("toy", &data)).unwrap();
    for taken in ["first", "toy", "mean", "floor"] {
        let refused = evaluator.compare(fixed(taken, &data));
        assert!(
            matches!(refused, Err(PipelineError::Eval(EvalError::SameKey { key })) if key == taken)
        );
    }
    let journal = folder.path().join("journal");
    let evaluation = evaluator.run(Some(&journal), &Silent).unwrap();
    let expected = [
        "first",
        "nearest",
        "mean",
        "toy",
        "perfect",
        "perfect-selected",
        "floor",
    ];
    assert_eq!(keys(&evaluation), expected);
    // What is added changes no other row, and is found again in the journal.
    for (with, without) in evaluation.per_test.iter().zip(&alone.per_test) {
        for row in &without.rows {
            assert_eq!(with.get(&row.key), Some(row));
        }
        assert_eq!(
            with.rows.iter().map(|row| &row.key).collect::<Vec<_>>(),
            expected
        );
    }
    let written = std::fs::read(&journal).unwrap();
    let again = evaluator.run(Some(&journal), &Silent).unwrap();
    assert_eq!(again.per_test, evaluation.per_test);
    assert_eq!(std::fs::read(&journal).unwrap(), written);

    let mean = evaluation.mean();
    let toy = mean.get("toy").unwrap();
    assert!(toy.distances.cd > 0.0 && toy.tip.is_some_and(|tip| tip > 0.0));
    let json = |evaluation| {
        serde_json::to_value(Metrics::new(evaluation, evaluator.scoring(), None)).unwrap()
    };
    let (scores, scores_alone) = (json(&evaluation), json(&alone));
    assert_eq!(scores["others"]["toy"]["cd"], toy.distances.cd);
    assert_eq!(scores["others"]["toy"]["evaluations"], 3.0);
    assert_eq!(scores["others"]["toy"]["training_points"], 7);
    assert_eq!(scores_alone.get("others"), None);
    for key in [
        "cd",
        "cd_nearest",
        "cd_mean",
        "cd_perfect",
        "cd_perfect_selected",
        "cd_floor",
        "tip_nearest",
    ] {
        assert_eq!(scores[key], scores_alone[key], "{key}");
    }
    let text = table(&evaluation);
    let row = text.lines().filter(|line| line.starts_with("fixed guess "));
    assert_eq!(row.count(), 2, "{text}");

    let results = Results::new(&evaluator, &evaluation, None, 1);
    let named = Evaluated::Clouds { name: "guesses" };
    let page = evaluation_page(&named, &data, &evaluator, &evaluation, &results);
    let page = page.unwrap().to_html();
    assert_eq!(
        page.matches("<th scope=\"row\">Fixed guess</th>").count(),
        2
    );
    assert!(page.contains(">Fixed guess</text>"));
}

#[test]
fn a_predictor_of_too_few_points_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let data = collected(folder.path());
    let few = Fixed {
        key: "few",
        points: vec![[0.0; 3]; 299],
    };
    let evaluator = Evaluator::new(Arc::new(few), &data, SETTINGS).unwrap();
    let refused = evaluator.run(None, &Silent).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "fixed guess: 299 points in a predicted cloud, expected at least 300"
    );
}

/// Asks to stop at once.
struct Stop;

impl Monitor for Stop {
    fn begin(&self, _: &str, _: u64, _: u64) {}
    fn advance(&self, _: u64) {}
    fn note(&self, _: &str) {}
    fn status(&self, _: &str) {}
    fn end(&self) {}
    fn interrupted(&self) -> bool {
        true
    }
}

#[test]
fn an_interruption_says_that_the_command_goes_on_only_where_a_journal_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let data = collected(folder.path());
    let journal = folder.path().join("journal");
    let said = |evaluator: &Evaluator, journal| {
        let stopped = evaluator.run(journal, &Stop).unwrap_err();
        with_hint(&stopped.into())
    };
    let evaluator = Evaluator::new(fixed("first", &data), &data, SETTINGS).unwrap();
    assert_eq!(said(&evaluator, None), "interrupted");
    let resumes = "interrupted; run the same command again to go on";
    assert_eq!(said(&evaluator, Some(&journal)), resumes);
    // Given clouds are kept in no journal.
    let clouds = PredictedClouds {
        points: evaluator
            .test()
            .iter()
            .map(|test| test.cloud.points.clone())
            .collect(),
        ..PredictedClouds::default()
    };
    let given = Evaluator::of_clouds(clouds, &data, SETTINGS).unwrap();
    assert_eq!(said(&given, Some(&journal)), "interrupted");
}
