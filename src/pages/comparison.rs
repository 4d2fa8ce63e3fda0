//! The page on two data sets beside each other.

use std::path::Path;

use tdcr_learn::metrics::nearest_distances;

use super::set_name;
use crate::pipeline::{
    Comparer, Comparison, Configuration, Distances, PipelineError, Place, Spread, TipSource,
};
use crate::report::{ComparisonPage, Example, Measure, MotorGroup};

/// What the simulator is called where it takes the place of a data set.
const SIMULATOR: &str = "the simulator";

/// The page on a comparison of the data set in the folder `a` with that in `b`, or with the simulator; it shows the worst
/// configurations that the comparison lists, the median one and the best.
///
/// # Errors
/// [`PipelineError`] where the clouds that the page shows cannot be read or simulated again.
pub fn comparison_page(
    a: &Path,
    b: Option<&Path>,
    comparer: &Comparer,
    comparison: &Comparison,
) -> Result<ComparisonPage, PipelineError> {
    let names = names(a, b);
    let configurations = &comparison.configurations;
    let label = |configuration: &Configuration| label(configuration, &names);
    let count = configurations.first().map_or(0, |c| c.command.len());
    let named = |c: &Configuration| (label(c), c.command.iter().map(|&x| x.into()).collect());
    let entry = |name: &str, value: String| (name.to_owned(), value);
    let whole =
        |path: Option<&Path>| path.map_or(SIMULATOR.to_owned(), |path| path.display().to_string());
    let examples = shown(comparison).into_iter().map(|(k, rank)| {
        let label = format!("{}, {rank}", label(&configurations[k]));
        example(comparer, &configurations[k], k, label)
    });
    Ok(ComparisonPage {
        headline: headline(comparison, &names),
        measures: measures(comparison),
        notes: notes(comparison, &names),
        motors: MotorGroup::of(comparer.robot(), count),
        configurations: configurations.iter().map(named).collect(),
        examples: examples.collect::<Result<_, _>>()?,
        summary: vec![
            entry("First data set", whole(Some(a))),
            entry("Beside it", whole(b)),
            entry("Configurations in common", comparison.pairs.to_string()),
            entry("Points compared", comparison.points.to_string()),
            entry("Of them by EMD", comparison.emd_points.to_string()),
            entry("tdcr", env!("CARGO_PKG_VERSION").to_owned()),
        ],
        names,
    })
}

/// What the sets are called: their folders' names, or where these are alike their paths.
fn names(a: &Path, b: Option<&Path>) -> [String; 2] {
    match b {
        None => [set_name(a), SIMULATOR.to_owned()],
        Some(b) if set_name(a) != set_name(b) => [a, b].map(set_name),
        Some(b) => [a, b].map(|path| path.display().to_string()),
    }
}

/// A configuration by its places.
fn label(configuration: &Configuration, [first, second]: &[String; 2]) -> String {
    let place = |Place { split, index }: Place| format!("{} {index}", split.folder());
    match configuration.b {
        Some(b) if b != configuration.a => {
            format!(
                "{} of {first}, {} of {second}",
                place(configuration.a),
                place(b)
            )
        }
        _ => place(configuration.a),
    }
}

/// The configurations that are shown, with their ranks: the worst, the median one, the best.
fn shown(comparison: &Comparison) -> Vec<(usize, String)> {
    let mut order: Vec<usize> = (0..comparison.configurations.len()).collect();
    let cd = |&k: &usize| comparison.configurations[k].distances.cd;
    order.sort_by(|a, b| cd(b).total_cmp(&cd(a)));
    let mut shown: Vec<(usize, String)> = Vec::new();
    for (rank, &k) in comparison.worst.iter().enumerate() {
        shown.push(match rank {
            0 => (k, "the worst".to_owned()),
            rank => (k, format!("number {} of the worst", rank + 1)),
        });
    }
    for (place, name) in [
        (order.len() / 2, "the median"),
        (order.len() - 1, "the best"),
    ] {
        if shown.iter().all(|(k, _)| *k != order[place]) {
            shown.push((order[place], name.to_owned()));
        }
    }
    shown
}

fn example(
    comparer: &Comparer,
    configuration: &Configuration,
    index: usize,
    label: String,
) -> Result<Example, PipelineError> {
    let [truth, other] = comparer.clouds(index)?;
    Ok(Example {
        label,
        command: configuration.command.iter().map(|&x| x.into()).collect(),
        payload: configuration.payload.map(f64::from),
        cd: configuration.distances.cd,
        emd: configuration.distances.emd,
        error: nearest_distances(&other.points, &truth.points)?,
        tip: configuration.tip,
        truth,
        prediction: other,
        ..Example::default()
    })
}

/// The distances in the units that they are shown in.
fn measures(comparison: &Comparison) -> Vec<Measure> {
    let over =
        |name: &str, unit: &str, per_unit: f64, spread: &Spread, pick: fn(&Distances) -> f64| {
            let values = comparison.configurations.iter();
            measure(
                [name, unit],
                per_unit,
                spread,
                values.map(|c| pick(&c.distances)).collect(),
            )
        };
    let area = "10⁻⁴\u{a0}m²";
    let mut measures = vec![
        over("CD", area, 1e4, &comparison.cd, |d| d.cd),
        over("EMD", "mm", 1e3, &comparison.emd, |d| d.emd),
        over("Squared EMD", area, 1e4, &comparison.emd_squared, |d| {
            d.emd_squared
        }),
    ];
    if let Some(tip) = &comparison.tip {
        let values = comparison.configurations.iter();
        let values = values.map(|c| c.tip.unwrap_or(f64::NAN)).collect();
        measures.push(measure(["Tip", "mm"], 1e3, tip, values));
    }
    measures
}

fn measure([name, unit]: [&str; 2], per_unit: f64, spread: &Spread, values: Vec<f64>) -> Measure {
    Measure {
        name: name.to_owned(),
        unit: unit.to_owned(),
        mean: per_unit * spread.mean,
        median: per_unit * spread.quantiles.median,
        p95: per_unit * spread.quantiles.p95,
        worst: per_unit * spread.quantiles.max,
        values: values.into_iter().map(|value| per_unit * value).collect(),
    }
}

/// How far the clouds are from each other: a root mean square distance of nearest points, as CD is the sum of the mean squares
/// both ways.
fn headline(comparison: &Comparison, [a, b]: &[String; 2]) -> String {
    let apart = 1e3 * (comparison.cd.mean / 2.0).sqrt();
    let tip = comparison.tip.map_or(String::new(), |tip| {
        format!(
            " The tips are {:.2} mm apart on average, {:.2} mm at the worst.",
            1e3 * tip.mean,
            1e3 * tip.quantiles.max
        )
    });
    format!(
        "Over {} configurations, points of {a} and of {b} are {apart:.2} mm from the nearest point of the other (root mean \
         square, {} points a cloud).{tip}",
        comparison.pairs, comparison.points
    )
}

/// How the distances were computed.
fn notes(comparison: &Comparison, [a, b]: &[String; 2]) -> Vec<String> {
    let [of_a, of_b] = comparison.unpaired;
    let mut notes = vec![
        format!("Over {} configurations in common.", comparison.pairs),
        format!(
            "CD, the squared Chamfer distance: the mean squared distance from each point of one cloud to the nearest point of \
             the other, both ways added, on {} points of each.",
            comparison.points
        ),
        format!(
            "EMD, the earth mover's distance: the mean distance between the points of both clouds when they are matched one to \
             one at the least total distance, on {} points of each; squared EMD is the mean squared distance at the least total \
             squared distance. Two samples of the same surface are apart too.",
            comparison.emd_points
        ),
    ];
    notes.extend(comparison.tip_source.map(|source| match source {
        TipSource::Settled => {
            "Tip: the distance between the origins of the last discs, of both robots settled under their conditions.".to_owned()
        }
        TipSource::Laid => {
            "Tip: how far the last disc of the simulated robot moves when the points on it are laid onto the other cloud as a \
             rigid body. Of distances up to half the robot's length nine in ten are told within 10 %; larger ones may be told \
             too small."
                .to_owned()
        }
    }));
    if of_a + of_b > 0 {
        notes.push(format!(
            "{of_a} samples of {a} and {of_b} of {b} have no counterpart and are left out."
        ));
    }
    notes
}
