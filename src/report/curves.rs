//! The page's charts: all test commands, training, time.

use super::chart::{AxisStyle, Series, duration_bars, line_chart};
use super::figure::Spacing;
use super::html::{duration, escape};
use super::sections::{CD_TITLE, CD_UNIT, figure, missing};
use super::{MethodDistances, PerTest, Role, Stage, Training};

/// Points of a drawn curve at most.
const CURVE_POINTS: usize = 300;

/// A chart with its caption, or what stands for it where there is nothing to draw.
fn chart_figure(class: &str, chart: Option<String>, caption: &str) -> String {
    chart.map_or_else(missing, |chart| figure(class, &chart, caption))
}

/// The share of test commands below each Chamfer distance.
pub(crate) fn distribution(per_test: Option<&PerTest>) -> String {
    let Some(per_test) = per_test else {
        return missing();
    };
    let series = |method| {
        let MethodDistances { name, role, values }: &MethodDistances = method;
        Series {
            name,
            role: *role,
            points: cumulative_share(values),
        }
    };
    let series: Vec<Series> = per_test.methods.iter().map(series).collect();
    let chart = line_chart(
        "Share of test commands below each Chamfer distance",
        &AxisStyle {
            title: CD_TITLE,
            spacing: Spacing::Log,
        },
        &AxisStyle {
            title: "Test commands below (%)",
            spacing: Spacing::Linear,
        },
        &series,
    );
    chart_figure(
        "single",
        chart,
        "Cumulative distribution over the test commands: the height of a curve is the share of \
         commands with a Chamfer distance of at most the value below it. The further left, the \
         better; a long run to the right shows commands that are predicted badly. No prediction can \
         be expected to run left of the sampling floor.",
    )
}

/// Points `(CD in the table's unit, share of values up to it in %)`, ascending.
fn cumulative_share(values: &[f64]) -> Vec<(f64, f64)> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let count = sorted.len();
    let stride = count.div_ceil(CURVE_POINTS).max(1);
    // Counted from the end, so that the curve reaches 100 % at the largest value.
    let mut points: Vec<(f64, f64)> = (0..count)
        .rev()
        .step_by(stride)
        .map(|k| (sorted[k] / CD_UNIT, 100.0 * (k + 1) as f64 / count as f64))
        .collect();
    points.reverse();
    points
}

/// The section of training loss and validation error.
pub(crate) fn training(training: &Training) -> String {
    let step_axis = AxisStyle {
        title: "Training step",
        spacing: Spacing::Linear,
    };
    let log_axis = |title| AxisStyle {
        title,
        spacing: Spacing::Log,
    };
    let stride = training.loss_curve.len().div_ceil(CURVE_POINTS).max(1);
    let loss = line_chart(
        "Training loss",
        &step_axis,
        &log_axis("Flow-matching loss (normalised units)"),
        &[Series {
            name: "Training",
            role: Role::Network,
            points: binned(&training.loss_curve, stride),
        }],
    );
    let mut loss_caption =
        "Mean squared error of the predicted velocity on training clouds.".to_owned();
    if stride > 1 {
        loss_caption += &format!(" Each point is the mean of up to {stride} recorded values.");
    }
    let validation: Vec<(f64, f64)> = training
        .validation_curve
        .iter()
        .map(|&(step, cd)| (step as f64, cd / CD_UNIT))
        .collect();
    let cd = line_chart(
        "Chamfer distance on validation commands",
        &step_axis,
        &log_axis(CD_TITLE),
        &[Series {
            name: "Network",
            role: Role::Network,
            points: validation,
        }],
    );
    format!(
        "<section><h2>Training</h2><div class=\"pair\">{}{}</div></section>",
        chart_figure("", loss, &loss_caption),
        chart_figure(
            "",
            cd,
            &format!(
                "Chamfer distance between predicted and true clouds of validation commands, which \
                 are not trained on. {}",
                escape(&training.validation_note)
            ),
        ),
    )
}

/// Means of every `stride` points of a curve; a value that is not finite makes its mean a gap.
fn binned(curve: &[(u64, f64)], stride: usize) -> Vec<(f64, f64)> {
    let mean = |bin: &[(u64, f64)]| {
        let count = bin.len() as f64;
        (
            bin.iter().map(|&(step, _)| step as f64).sum::<f64>() / count,
            bin.iter().map(|&(_, loss)| loss).sum::<f64>() / count,
        )
    };
    curve.chunks(stride).map(mean).collect()
}

/// The section of the time that each stage took; nothing without stages.
pub(crate) fn stages(stages: &[Stage]) -> String {
    if stages.is_empty() {
        return String::new();
    }
    let bars: Vec<(&str, f64)> = stages
        .iter()
        .map(|s| (s.name.as_str(), s.seconds))
        .collect();
    let total: f64 = bars.iter().map(|bar| bar.1).filter(|s| s.is_finite()).sum();
    let caption = format!("Wall-clock time of each stage; {} in all.", duration(total));
    let chart = chart_figure("", duration_bars("Time per stage", &bars), &caption);
    format!("<section><h2>Time per stage</h2>{chart}</section>")
}
