//! The page's charts: all test commands, training, time.

use super::figure::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape, Spacing};
use super::html::{duration, escape};
use super::sections::{CD_TITLE, CD_UNIT, figure, missing};
use super::{MethodDistances, PerTest, Role, Stage, Training};

/// Points of a drawn curve at most.
const CURVE_POINTS: usize = 300;
/// Curves of at most so many points show each as a dot.
const DOTTED: usize = 40;

/// A plot with its caption (HTML), or what stands for it where there is nothing to draw.
fn plot(title: &str, x: Scale, y: Scale, marks: Option<Vec<Mark>>, caption: &str) -> String {
    let Some(marks) = marks else {
        return missing();
    };
    let plot = Figure {
        title: title.to_owned(),
        caption: String::new(),
        panels: vec![Panel {
            title: String::new(),
            x,
            y,
            aspect: Aspect::Free,
            marks,
        }],
    };
    figure("figures", &plot.to_svg(), caption)
}

/// How a method's curve is drawn.
fn style(role: Role) -> (Shape, Ink) {
    match role {
        Role::Network => (Shape::Line, Ink::Vermilion),
        Role::Nearest => (Shape::Line, Ink::Purple),
        Role::Other(place) => {
            let ink = [Ink::Green, Ink::Blue, Ink::Black][place % 3];
            // Solid first; from the fourth on dashed, so that six can be told apart.
            match place / 3 % 2 {
                0 => (Shape::Line, ink),
                _ => (Shape::Dashes, ink),
            }
        }
        Role::Floor => (Shape::Dashes, Ink::Grey),
    }
}

/// A named curve, with a dot at each point of a short one; the floor, a reference, has none.
fn curve(name: &str, role: Role, points: Vec<[f64; 2]>) -> Vec<Mark> {
    let (shape, ink) = style(role);
    let mark = |name: &str, shape, points| Mark {
        name: name.to_owned(),
        shape,
        ink,
        points,
    };
    let mut marks = Vec::new();
    if role != Role::Floor && points.len() <= DOTTED {
        marks.push(mark("", Shape::Dots, points.clone()));
    }
    marks.push(mark(name, shape, points));
    marks
}

/// Whether a point has a place where both axes have this spacing.
fn shows(x: Spacing, y: Spacing) -> impl Fn(&[f64; 2]) -> bool {
    move |point| x.shows(point[0]) && y.shows(point[1])
}

/// The share of test commands below each Chamfer distance.
pub(crate) fn distribution(per_test: Option<&PerTest>) -> String {
    let Some(per_test) = per_test else {
        return missing();
    };
    let curves: Vec<(Role, &str, Vec<[f64; 2]>)> = (per_test.methods.iter())
        .map(|MethodDistances { name, role, values }| {
            (*role, name.as_str(), cumulative_share(values))
        })
        .collect();
    let drawable = shows(Spacing::Log, Spacing::Linear);
    // A floor alone says nothing.
    let measured = curves.iter().filter(|(role, ..)| *role != Role::Floor);
    let any = measured.flat_map(|(_, _, points)| points).any(drawable);
    let marks = any.then(|| {
        let curves = curves.into_iter();
        curves
            .flat_map(|(role, name, points)| curve(name, role, points))
            .collect()
    });
    plot(
        "Share of test commands below each Chamfer distance",
        Scale::log(CD_TITLE),
        Scale::linear("Test commands below (%)"),
        marks,
        "Cumulative distribution over the test commands: the height of a curve is the share of \
         commands with a Chamfer distance of at most the value below it. The further left, the \
         better; a long run to the right shows commands that are predicted badly. No prediction can \
         be expected to run left of the sampling floor.",
    )
}

/// Points `[CD in the table's unit, share of values up to it in %]`, ascending.
fn cumulative_share(values: &[f64]) -> Vec<[f64; 2]> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let count = sorted.len();
    let stride = count.div_ceil(CURVE_POINTS).max(1);
    // Counted from the end, so that the curve reaches 100 % at the largest value.
    let mut points: Vec<[f64; 2]> = (0..count)
        .rev()
        .step_by(stride)
        .map(|k| [sorted[k] / CD_UNIT, 100.0 * (k + 1) as f64 / count as f64])
        .collect();
    points.reverse();
    points
}

/// The section of training loss and validation error.
pub(crate) fn training(training: &Training) -> String {
    let stride = training.loss_curve.len().div_ceil(CURVE_POINTS).max(1);
    let mut loss_caption =
        "Mean squared error of the predicted velocity on training clouds.".to_owned();
    if stride > 1 {
        loss_caption += &format!(" Each point is the mean of up to {stride} recorded values.");
    }
    let over_steps = |title, y, name, points: Vec<[f64; 2]>, caption: &str| {
        let any = points.iter().any(shows(Spacing::Linear, Spacing::Log));
        let marks = any.then(|| curve(name, Role::Network, points));
        plot(
            title,
            Scale::linear("Training step"),
            Scale::log(y),
            marks,
            caption,
        )
    };
    let loss = over_steps(
        "Training loss",
        "Flow-matching loss (normalised units)",
        "Training",
        binned(&training.loss_curve, stride),
        &loss_caption,
    );
    let validation = training.validation_curve.iter();
    let cd = over_steps(
        "Chamfer distance on validation commands",
        CD_TITLE,
        "Network",
        validation
            .map(|&(step, cd)| [step as f64, cd / CD_UNIT])
            .collect(),
        &format!(
            "Chamfer distance between predicted and true clouds of validation commands, which \
             are not trained on. {}",
            escape(&training.validation_note)
        ),
    );
    format!("<section><h2>Training</h2><div class=\"pair\">{loss}{cd}</div></section>")
}

/// Means of every `stride` points of a curve; a value that is not finite makes its mean a gap.
fn binned(curve: &[(u64, f64)], stride: usize) -> Vec<[f64; 2]> {
    let mean = |bin: &[(u64, f64)]| {
        let count = bin.len() as f64;
        [
            bin.iter().map(|&(step, _)| step as f64).sum::<f64>() / count,
            bin.iter().map(|&(_, loss)| loss).sum::<f64>() / count,
        ]
    };
    curve.chunks(stride).map(mean).collect()
}

/// The section of the time that each stage took; nothing without stages.
pub(crate) fn stages(stages: &[Stage]) -> String {
    if stages.is_empty() {
        return String::new();
    }
    let known = || stages.iter().map(|s| s.seconds).filter(|s| s.is_finite());
    let caption = format!(
        "Wall-clock time of each stage; {} in all.",
        duration(known().sum())
    );
    // The first name of an axis is at its foot, the first stage on top.
    let upwards = || stages.iter().rev();
    let names = upwards().map(|stage| format!("{}, {}", stage.name, duration(stage.seconds)));
    let bars = upwards().enumerate();
    let bars = Mark {
        name: String::new(),
        shape: Shape::Bars,
        ink: Ink::Blue,
        points: bars
            .flat_map(|(row, stage)| [0.0, stage.seconds].map(|end| [end, row as f64]))
            .collect(),
    };
    let chart = plot(
        "Time per stage",
        Scale::linear("time (s)"),
        Scale::Names(names.collect()),
        known().any(|seconds| seconds > 0.0).then(|| vec![bars]),
        &caption,
    );
    format!("<section><h2>Time per stage</h2>{chart}</section>")
}
