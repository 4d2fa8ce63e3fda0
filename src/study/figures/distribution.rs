//! Figures of a study in which nothing runs along an axis: distributions.

use tdcr_base::stats::quantile;

use super::axes::{ACROSS, readable, spacing_between, titled};
use crate::report::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape, Spacing, StudyFigure};
use crate::study::outputs::thinned::Thinned;
use crate::study::spec::{Column, Output, Study};

/// Points of a distribution's curve.
const CURVE: usize = 200;

/// The share of configurations below each value of an output, where nothing runs along an axis.
pub(super) fn distributions(
    study: &Study,
    drawn: &[Column],
    all: &[Thinned<f64>],
    note: &str,
) -> Vec<StudyFigure> {
    let panel = |column: &Column, values: &Thinned<f64>| {
        let sorted = values.sorted();
        let (factor, unit) = readable(&column.unit, values.largest());
        let points = (0..=CURVE).map(|k| {
            let share = k as f64 / CURVE as f64;
            [factor * quantile(&sorted, share), 100.0 * share]
        });
        let title = Output::title(&column.name).unwrap_or(&column.name);
        let ends = sorted.first().map(|least| [*least, values.largest()]);
        Panel {
            title: String::new(),
            x: Scale::Numbers {
                title: titled(title, &unit),
                spacing: ends.map_or(Spacing::Linear, spacing_between),
            },
            y: Scale::linear("Configurations below (%)"),
            aspect: Aspect::Free,
            marks: vec![Mark {
                name: String::new(),
                shape: Shape::Line,
                ink: Ink::Blue,
                points: points.collect(),
            }],
        }
    };
    let limited = study.tension_limit.is_some();
    let mut figures = Vec::new();
    for want in Output::ALL {
        let columns = want.columns(limited);
        let of_want = drawn
            .iter()
            .zip(all)
            .filter(|(column, _)| columns.contains(column) && !Output::is_reference(&column.name));
        let panels: Vec<Panel> = of_want
            .map(|(column, values)| panel(column, values))
            .collect();
        for (part, panels) in panels.chunks(ACROSS).enumerate() {
            let figure = Figure {
                title: want.heading().to_owned(),
                caption: format!(
                    "The height of a curve is the share of configurations up to the value below it. {note}"
                ),
                panels: panels.to_vec(),
            };
            figures.push(StudyFigure {
                name: match part {
                    0 => want.name().to_owned(),
                    part => format!("{}-{}", want.name(), part + 1),
                },
                svg: figure.to_svg(),
            });
        }
    }
    figures
}
