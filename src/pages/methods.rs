//! The page on several methods beside each other.

use std::path::Path;

use crate::pipeline::{Evaluation, Evaluator, MethodScores, PipelineError, Results, RowKind};
use crate::report::{Cost, Example, MethodsReport, Report};

use super::evaluation::{
    Evaluated, comparison_notes, example, floor, motors, per_test, scores, settings,
};

/// The page on methods that were evaluated together on the data set in the folder `data`: what each is, in the order in which the
/// evaluator has them, their `results` with the best and the worst test commands of each. Its examples are those of each method
/// in turn, the best first.
///
/// # Errors
/// [`PipelineError`] where the clouds that the page shows cannot be predicted again.
pub fn methods_page(
    evaluated: &[Evaluated<'_>],
    data: &Path,
    evaluator: &Evaluator,
    evaluation: &Evaluation,
    results: &Results,
) -> Result<MethodsReport, PipelineError> {
    let methods: Vec<&MethodScores> = (results.methods.iter())
        .filter(|row| row.kind == RowKind::Method)
        .collect();
    let facts = methods.iter().zip(evaluated).flat_map(|(row, evaluated)| {
        let facts = evaluated.facts().into_iter();
        facts.map(move |(name, value)| (format!("{}: {}", row.name, name.to_lowercase()), value))
    });
    let mut summary: Vec<(String, String)> = facts.collect();
    summary.extend(settings(data, evaluator, &results.metrics));
    let mut notes = comparison_notes(&results.metrics);
    notes.push(
        "Training: the time of all processors, where the method says it. Prediction: the time of a cloud; of clouds that were \
         given, what their file says of the machine that predicted them."
            .to_owned(),
    );
    notes.extend(tip_note(results));
    let mut examples = Vec::new();
    for (place, row) in evaluation.methods().zip(&methods) {
        examples.extend(examples_of(evaluator, evaluation, place, row)?);
    }
    let report = Report {
        title: "Methods beside each other".to_owned(),
        headline: headline(results, &methods),
        summary,
        scores: scores(evaluation),
        floor: floor(evaluation),
        score_notes: notes,
        per_test: Some(per_test(evaluator, evaluation)?),
        training: None,
        stages: Vec::new(),
        motors: motors(evaluator),
        examples,
    };
    let cost = |row: &&MethodScores| Cost {
        training: row.training_seconds,
        prediction: row.prediction_seconds,
    };
    Ok(MethodsReport {
        report,
        costs: methods.iter().map(cost).collect(),
    })
}

/// The clouds of the best test command of the method at `place`, and of its worst.
fn examples_of(
    evaluator: &Evaluator,
    evaluation: &Evaluation,
    place: usize,
    row: &MethodScores,
) -> Result<Vec<Example>, PipelineError> {
    let best = row.best.iter().map(|test| (test.test, "best".to_owned()));
    let worst = row.worst.iter().enumerate().map(|(rank, test)| {
        let said = match rank {
            0 => "worst".to_owned(),
            rank => format!("worst but {rank}"),
        };
        (test.test, said)
    });
    best.chain(worst)
        .map(|(test, said)| {
            let label = format!("{}, {said}: test {test}", row.name);
            example(evaluator, evaluation, place, test, label)
        })
        .collect()
}

/// Which method is the nearest to the true clouds, beside the nearest training command.
fn headline(results: &Results, methods: &[&MethodScores]) -> String {
    let Some(best) = methods.iter().min_by(|a, b| a.cd.total_cmp(&b.cd)) else {
        return String::new();
    };
    let distance = |cd: f64| 1e3 * (cd / 2.0).sqrt();
    format!(
        "Of {} methods, {} is the nearest to the true clouds of {} test commands: points of its clouds and of the true ones are \
         {:.2} mm from the nearest point of the other (root mean square, {} points a cloud); with the clouds of the nearest \
         training commands it is {:.2} mm.",
        methods.len(),
        best.name,
        results.metrics.tests,
        distance(best.cd),
        results.metrics.points,
        distance(results.metrics.cd_nearest),
    )
}

/// What is said of the tips.
fn tip_note(results: &Results) -> Option<String> {
    let tips = results.methods.iter();
    let tips = tips.filter_map(|row| Some(format!("{} {:.2} mm", row.name, 1e3 * row.tip?)));
    let tips: Vec<String> = tips.collect();
    (!tips.is_empty()).then(|| format!("The tip is off on average by: {}.", tips.join(", ")))
}
