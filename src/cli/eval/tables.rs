//! The scores of an evaluation as text.

use std::fmt::Write;

use tdcr::pipeline::{DistanceQuantiles, Evaluation, WorstTest};

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
    let tips = rows().filter_map(|(name, row)| Some(format!("{name} {:.2}", 1e3 * row.tip?)));
    let tips: Vec<String> = tips.collect();
    if !tips.is_empty() {
        let _ = writeln!(text, "tip off by (mm): {}", tips.join(", "));
    }
    for (name, row) in rows() {
        if let Some(color) = row.color {
            let _ = writeln!(text, "colour error of the {name}, of 1: {color:.4}");
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
pub fn worst(worst: &[WorstTest]) -> String {
    let mut text = String::new();
    for (rank, test) in worst.iter().enumerate() {
        let name = if rank == 0 { "worst: test" } else { "test" };
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
