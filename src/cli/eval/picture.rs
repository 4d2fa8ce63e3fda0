//! Pictures of an evaluation.

use std::path::Path;

use tdcr::pipeline::{Evaluation, RowKind};
use tdcr::report::{
    Aspect, Example, Figure, Ink, Mark, Panel, Scale, Shape, Spacing, contact_sheet,
};

use crate::cli::output;

/// Width of a panel (pixels).
const WIDTH: usize = 360;
/// Square metres in the unit of the figure, as papers have it.
const AREA: f64 = 1e-4;
const INKS: [Ink; 5] = [
    Ink::Blue,
    Ink::Vermilion,
    Ink::Green,
    Ink::Purple,
    Ink::Grey,
];

/// Draws the worst predictions (PNG) or all distances (SVG); the format was asked before.
pub fn write(path: &Path, evaluation: &Evaluation, worst: &[Example]) -> anyhow::Result<()> {
    match output::format("--picture", path, &["png", "svg"])? {
        "svg" => output::write(path, distances(evaluation).to_svg()),
        _ => output::write(path, contact_sheet(worst, WIDTH)),
    }
}

/// Of the examples of several methods, as many of each, the first two: the best and the worst.
pub fn best_and_worst(examples: Vec<Example>, methods: usize) -> Vec<Example> {
    let each = (examples.len() / methods.max(1)).max(1);
    let numbered = examples.into_iter().enumerate();
    let chosen = numbered.filter(|(place, _)| place % each < 2);
    chosen.map(|(_, example)| example).collect()
}

/// The share of the test commands below each Chamfer distance, a line for each row of the evaluation.
fn distances(evaluation: &Evaluation) -> Figure {
    let line = |(place, ink): (usize, Ink)| {
        let mut values: Vec<f64> = (evaluation.per_test.iter())
            .filter_map(|scores| Some(scores.rows.get(place)?.distances.cd / AREA))
            .collect();
        values.sort_by(f64::total_cmp);
        let count = values.len() as f64;
        let steps = values
            .iter()
            .enumerate()
            .flat_map(|(k, value)| [k, k + 1].map(|below| [*value, 100.0 * below as f64 / count]));
        let row = &evaluation.rows[place];
        Mark {
            name: row.about.name.clone(),
            shape: match row.kind {
                RowKind::Reference => Shape::Dashes,
                _ => Shape::Line,
            },
            ink,
            points: steps.collect(),
        }
    };
    let marks: Vec<Mark> = (0..evaluation.rows.len())
        .zip(INKS.into_iter().cycle())
        .map(line)
        .collect();
    Figure {
        title: "Chamfer distances on test commands".to_owned(),
        caption: format!(
            "Of {} test commands, how many are below each distance. No predictor can be expected to beat the sampling floor.",
            evaluation.per_test.len()
        ),
        panels: vec![Panel {
            title: String::new(),
            x: Scale::Numbers {
                title: "CD (10\u{207b}\u{2074} m\u{b2})".to_owned(),
                spacing: Spacing::Log,
            },
            y: Scale::linear("Test commands below (%)"),
            aspect: Aspect::Free,
            marks,
        }],
    }
}
