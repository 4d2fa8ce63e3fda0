//! The scores of an evaluation as text.

use std::fmt::Write;

use tdcr::pipeline::{DistanceQuantiles, Evaluation, MethodScores, ScoredTest};

/// The table of mean scores.
pub fn scores(evaluation: &Evaluation) -> String {
    let mut text = String::from(
        "                           CD (1e-4 m²)   EMD (mm)   sq. EMD (1e-4 m²)   CD / floor\n",
    );
    let mean = evaluation.mean();
    let floor = mean.get("floor").map(|floor| floor.distances.cd);
    let rows = || {
        let names = evaluation.rows.iter().map(|row| row.about.name.as_str());
        names.zip(&mean.rows)
    };
    for (name, row) in rows() {
        let d = row.distances;
        let ratio = floor.map_or("-".to_owned(), |floor| format!("{:.1}", d.cd / floor));
        let (cd, emd, emd_squared) = (d.cd * 1e4, d.emd * 1e3, d.emd_squared * 1e4);
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{name:26} {cd:12.4} {emd:10.3} {emd_squared:19.4} {ratio:>12}"
        );
    }
    text + &other_scores(evaluation)
}

/// Mean errors of tips and colours, where they are known.
pub fn other_scores(evaluation: &Evaluation) -> String {
    let mut text = String::new();
    let mean = evaluation.mean();
    let rows = || {
        let names = evaluation.rows.iter().map(|row| row.about.name.as_str());
        names.zip(&mean.rows)
    };
    let tips = rows().filter_map(|(name, row)| Some(format!("{name} {:.2}", 1e3 * row.tip?)));
    let tips: Vec<String> = tips.collect();
    if !tips.is_empty() {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "tip off by (mm): {}", tips.join(", "));
    }
    for (name, row) in rows() {
        if let Some(color) = row.color {
            let _ = writeln!(text, "colour error of the {name}, of 1: {color:.4}");
        }
    }
    text
}

/// The table of several methods, what they are compared with below. The perfect predictors, which are where the floor is, are left
/// out.
pub fn methods(methods: &[MethodScores]) -> String {
    let rows = || methods.iter().filter(|row| !row.key.starts_with("perfect"));
    let width = rows().map(|row| row.name.chars().count()).max();
    let width = width.unwrap_or(0).max(26);
    let mut text = format!(
        "{:width$} CD (1e-4 m²)   CD / floor   EMD (mm)   sq. EMD (1e-4 m²)   training (CPU s)   prediction (ms)\n",
        ""
    );
    let known = |value: Option<f64>, scale: f64, decimals: usize| {
        value.map_or("-".to_owned(), |value| {
            format!("{:.decimals$}", scale * value)
        })
    };
    for row in rows() {
        let _ = writeln!(
            text,
            "{:width$} {:12.4} {:>12} {:10.3} {:19.4} {:>18} {:>17}",
            row.name,
            row.cd * 1e4,
            known(row.cd_over_floor, 1.0, 1),
            row.emd * 1e3,
            row.emd_squared * 1e4,
            known(row.training_seconds, 1.0, 0),
            known(row.prediction_seconds, 1e3, 1),
        );
    }
    text
}

/// The best and the worst predictions of each method.
pub fn best_and_worst(methods: &[MethodScores]) -> String {
    let mut text = String::new();
    for row in methods {
        if let Some(best) = &row.best {
            let _ = writeln!(text, "{}:", row.name);
            text.push_str(&listed("best", std::slice::from_ref(best)));
            text.push_str(&listed("worst", &row.worst));
        }
    }
    text
}

/// The table of the network's quantiles.
pub fn quantiles(quantiles: &DistanceQuantiles) -> String {
    let mut text = format!("{:26}", "network, over the tests");
    let mut body = String::new();
    for (name, _) in quantiles.cd.named() {
        let _ = write!(text, "{name:>10}");
    }
    for (name, scale, of) in [
        ("CD (1e-4 m²)", 1e4, &quantiles.cd),
        ("EMD (mm)", 1e3, &quantiles.emd),
        ("sq. EMD (1e-4 m²)", 1e4, &quantiles.emd_squared),
    ] {
        let _ = write!(body, "\n{name:26}");
        for (_, value) in of.named() {
            let _ = write!(body, "{:10.4}", value * scale);
        }
    }
    text + &body + "\n"
}

/// The list of the worst predictions.
pub fn worst(worst: &[ScoredTest]) -> String {
    listed("worst", worst)
}

/// A line for each test command, the first under a name.
fn listed(name: &str, tests: &[ScoredTest]) -> String {
    let mut text = String::new();
    let first = format!("{name}: test");
    for (rank, test) in tests.iter().enumerate() {
        let name = if rank == 0 { first.as_str() } else { "test" };
        let command: Vec<String> = test.command.iter().map(f32::to_string).collect();
        let payload = test
            .payload
            .map_or(String::new(), |kg| format!(" --payload {kg}"));
        let _ = writeln!(
            text,
            "{name:>11} {:<6} CD {:.4}e-4 m², EMD {:.3} mm   --command {}{payload}",
            test.test,
            test.cd * 1e4,
            test.emd * 1e3,
            command.join(","),
        );
    }
    text
}
