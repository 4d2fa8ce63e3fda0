//! The page on data sets: what is in them, drawn.

use super::count::counted;
use super::figure::{Aspect, Figure, Ink, Mark, Panel, Scale, Shape, Spacing};
use super::frame::PageFrame;
use super::html::{base64, escape};
use super::motors::MotorGroup;
use super::sections;
use super::sheet::cloud_sheet;
use tdcr_sim::cloud::PointCloud;

/// Bins of a histogram.
const BINS: usize = 20;
/// Dots of a workspace; the outline is of all tips.
const MAX_DOTS: usize = 2000;
/// Tips from which on a workspace shows them as specks.
const SPECKS: usize = 200;
/// Tips from which on their outline tells of the robot, and not of the few commands.
const OUTLINED: usize = 50;
/// Histograms side by side, at most.
const PANELS: usize = 4;
const SHEET_COLUMNS: usize = 4;
const SHEET_PANEL_WIDTH: usize = 220;

/// All that the page shows.
#[derive(Clone, Debug, Default)]
pub struct DataPage {
    /// The data sets, in the order of the page.
    pub sets: Vec<SetSummary>,
}

/// One data set, as plain data.
#[derive(Clone, Debug, Default)]
pub struct SetSummary {
    /// Name of the set.
    pub name: String,
    /// What it was made with, as `(name, value)`.
    pub facts: Vec<(String, String)>,
    /// Values of each motor over all samples.
    pub motors: Vec<Vec<f64>>,
    /// Which motors belong together.
    pub groups: Vec<MotorGroup>,
    /// Payloads (kg), where there are any.
    pub payloads: Vec<f64>,
    /// Tip positions, world frame (m).
    pub tips: Vec<[f64; 3]>,
    /// How the tips were found, a sentence.
    pub tips_note: String,
    /// Some of the clouds.
    pub clouds: Vec<PointCloud>,
}

impl DataPage {
    /// The page as one self-contained HTML text, the same for the same data.
    pub fn to_html(&self) -> String {
        let names: Vec<&str> = self.sets.iter().map(|set| set.name.as_str()).collect();
        let title = format!("Data sets: {}", names.join(", "));
        let sets: String = self.sets.iter().map(SetSummary::section).collect();
        let frame = PageFrame {
            title: &title,
            lead: "",
            style: "",
        };
        frame.fill(
            include_str!("data_page.html"),
            &[("workspace", &self.workspace().to_svg()), ("sets", &sets)],
        )
    }

    /// Tip positions in the y-z plane, the sets side by side: those seen, and the convex outline of all where these are enough to
    /// say what the robot reaches.
    pub fn workspace(&self) -> Figure {
        let mut notes: Vec<&str> = Vec::new();
        for note in self.sets.iter().map(|set| set.tips_note.as_str()) {
            if !notes.contains(&note) {
                notes.push(note);
            }
        }
        let outlined = self.sets.iter().any(|set| set.tips.len() >= OUTLINED);
        let (title, outline) = match outlined {
            true => (
                "Reachable workspace",
                format!(
                    "; the line is the convex outline of all of them, where there are {OUTLINED} or more"
                ),
            ),
            false => (
                "Positions of the tip",
                format!(": fewer than {OUTLINED} do not say what the robot reaches"),
            ),
        };
        Figure {
            title: title.to_owned(),
            caption: format!(
                "Positions of the tip, seen along x, both axes of one scale{outline}. {}",
                notes.join(" ")
            ),
            panels: self.sets.iter().map(SetSummary::workspace).collect(),
        }
    }
}

impl SetSummary {
    /// The first clouds as PNG, and the length of their scale bar (m).
    pub fn sheet(&self) -> (Vec<u8>, f64) {
        cloud_sheet(&self.clouds, SHEET_COLUMNS, SHEET_PANEL_WIDTH)
    }

    /// Histograms of the motors, a row or more for each group of them, and of the payloads if there are any.
    pub fn histograms(&self) -> Vec<Figure> {
        let figure = |title: &str, panels: &[Panel]| Figure {
            title: title.to_owned(),
            caption: String::new(),
            panels: panels.to_vec(),
        };
        let mut figures = Vec::new();
        for group in &self.groups {
            let axis = format!("command ({})", group.unit_name());
            let motor = |k: usize| {
                let values: Vec<f64> = self.motors[k].iter().map(|&x| group.shown(x)).collect();
                histogram(&format!("motor {}", k + 1), &axis, &values)
            };
            let panels: Vec<Panel> = group.motors.clone().map(motor).collect();
            // Rows of about the same length.
            let rows = panels.len().div_ceil(PANELS).max(1);
            let row = panels.len().div_ceil(rows).max(1);
            figures.extend(panels.chunks(row).map(|panels| figure(&group.name, panels)));
        }
        if !self.payloads.is_empty() {
            let payloads = histogram("payload", "payload (kg)", &self.payloads);
            figures.push(figure("", &[payloads]));
        }
        figures
    }

    fn workspace(&self) -> Panel {
        let seen: Vec<[f64; 2]> = self.tips.iter().map(|&[_, y, z]| [y, z]).collect();
        let stride = seen.len().div_ceil(MAX_DOTS).max(1);
        let mark = |shape, ink, points| Mark {
            name: String::new(),
            shape,
            ink,
            points,
        };
        let mut outline = match seen.len() {
            ..OUTLINED => Vec::new(),
            _ => convex_hull(&seen),
        };
        outline.extend(outline.first().copied());
        Panel {
            title: format!("{}, {}", self.name, counted(seen.len(), "tip")),
            x: Scale::linear("y (m)"),
            y: Scale::linear("z (m)"),
            aspect: Aspect::Equal,
            marks: vec![
                mark(
                    match seen.len() {
                        // Specks of a few tips are not seen.
                        ..SPECKS => Shape::Dots,
                        _ => Shape::Specks,
                    },
                    Ink::Blue,
                    seen.iter().copied().step_by(stride).collect(),
                ),
                mark(Shape::Line, Ink::Vermilion, outline),
                mark(Shape::Unseen, Ink::Black, square(&seen)),
            ],
        }
    }

    fn section(&self) -> String {
        let histograms: String = self.histograms().iter().map(Figure::to_svg).collect();
        let (png, bar) = self.sheet();
        let image = format!(
            "<img src=\"data:image/png;base64,{}\" alt=\"clouds of {}\">",
            base64(&png),
            escape(&self.name)
        );
        let caption = format!(
            "{}, each across its plane of bending; the bars are {:.0}\u{a0}cm long.",
            counted(self.clouds.len(), "cloud"),
            100.0 * bar
        );
        format!(
            "<section><h2>{}</h2>{}{}<h3>Commands</h3><div class=\"figures\">{histograms}</div></section>",
            escape(&self.name),
            sections::settings(&self.facts),
            sections::figure("", &image, &caption),
        )
    }
}

/// Corners of the square around points, so that axes of one scale have ticks of one step.
fn square(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let range = |axis: usize| {
        let values = points.iter().map(|p| p[axis]);
        let low = values.clone().fold(f64::INFINITY, f64::min);
        [low, values.fold(f64::NEG_INFINITY, f64::max)]
    };
    let ranges = [range(0), range(1)];
    let half = ranges.map(|[low, high]| 0.5 * (high - low));
    let half = half[0].max(half[1]);
    match half > 0.0 && half.is_finite() {
        true => {
            let middle = ranges.map(|[low, high]| 0.5 * (low + high));
            [-half, half].map(|by| middle.map(|x| x + by)).into()
        }
        false => Vec::new(),
    }
}

/// How often values fall into equal bins of their range.
fn histogram(title: &str, axis: &str, values: &[f64]) -> Panel {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let width = (high - low) / BINS as f64;
    let mut counts = [0; BINS];
    for value in values {
        // A cast saturates: of values that are all alike, each is in the first bin.
        counts[(((value - low) / width) as usize).min(BINS - 1)] += 1;
    }
    let steps = counts.iter().enumerate().flat_map(|(bin, &count)| {
        let (left, count) = (low + width * bin as f64, f64::from(count));
        [[left, count], [left + width, count]]
    });
    let foot = [[low, 0.0]].into_iter().chain(steps).chain([[high, 0.0]]);
    Panel {
        title: title.to_owned(),
        x: Scale::Numbers {
            title: axis.to_owned(),
            spacing: Spacing::Linear,
        },
        y: Scale::linear("samples"),
        aspect: Aspect::Free,
        marks: vec![Mark {
            name: String::new(),
            shape: Shape::Line,
            ink: Ink::Blue,
            points: foot.collect(),
        }],
    }
}

/// Corners of the convex hull, counter-clockwise (Andrew's monotone chain, 1979).
fn convex_hull(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted: Vec<[f64; 2]> = points.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let mut hull = half_hull(sorted.iter());
    hull.pop();
    hull.extend(half_hull(sorted.iter().rev()));
    hull.pop();
    hull
}

fn half_hull<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> Vec<[f64; 2]> {
    let mut hull: Vec<[f64; 2]> = Vec::new();
    for &[x, y] in points {
        while let [.., a, b] = hull[..]
            && (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) <= 0.0
        {
            hull.pop();
        }
        hull.push([x, y]);
    }
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hull_of_a_square_with_points_inside_is_its_corners() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let inside = [[0.5, 0.5], [0.2, 0.9], [0.5, 0.0], [1.0, 1.0]];
        assert_eq!(convex_hull(&[&square[..], &inside].concat()), square);
        assert_eq!(convex_hull(&[]), Vec::<[f64; 2]>::new());
        assert_eq!(convex_hull(&[[1.0, 2.0]; 3]), [[1.0, 2.0]]);
    }

    #[test]
    fn the_square_around_points_holds_them_and_has_sides_alike() {
        let corners = square(&[[0.0, 5.0], [4.0, 6.0], [1.0, 5.5]]);
        assert_eq!(corners, [[0.0, 3.5], [4.0, 7.5]]);
        assert!(square(&[]).is_empty() && square(&[[1.0, 2.0]]).is_empty());
    }

    #[test]
    fn a_histogram_counts_every_value_once() {
        let values: Vec<f64> = (0..1000).map(|k| f64::from(k) / 999.0).collect();
        let panel = histogram("", "", &values);
        let tops = panel.marks[0].points.chunks(2).skip(1);
        let counts: Vec<f64> = tops.map(|step| step[0][1]).collect();
        assert_eq!(panel.marks[0].points.len(), 2 * BINS + 2);
        assert_eq!(counts.len(), BINS);
        let first = panel.marks[0].points.iter().skip(1).step_by(2);
        let total: f64 = first.take(BINS).map(|p| p[1]).sum();
        assert_eq!(total, 1000.0);
        let alike = histogram("", "", &[0.5; 7]);
        assert_eq!(alike.marks[0].points[1][1], 7.0);
    }
}
