//! Numbers over two variables, by colour, as one self-contained SVG picture.

use super::axis::{Spacing, tick_label};
use super::color_scale::color_at;
use super::html::escape;

/// Maps side by side that share a scale of colours.
#[derive(Clone, Debug, PartialEq)]
pub struct HeatMap {
    /// What is shown.
    pub title: String,
    /// How to read it.
    pub caption: String,
    /// The horizontal variable, with its unit, and its values.
    pub x: (String, Vec<f64>),
    /// The vertical variable, with its unit, and its values, from the bottom up.
    pub y: (String, Vec<f64>),
    /// What the colours mean, with its unit.
    pub value: String,
    /// How the numbers are spaced along the scale of colours.
    pub spacing: Spacing,
    /// The maps, from left to right.
    pub panels: Vec<HeatPanel>,
}

/// One map.
#[derive(Clone, Debug, PartialEq)]
pub struct HeatPanel {
    /// What it shows; may be empty.
    pub title: String,
    /// A row for each value of the vertical variable, of a number for each of the horizontal one; not finite where there is none.
    pub values: Vec<Vec<f64>>,
}

/// Size of a map, and room around it (CSS pixels).
const PLOT: f64 = 330.0;
const HEIGHT: f64 = 280.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 26.0;
const TOP: f64 = 72.0;
/// Width of the scale of colours, and steps in which it is drawn.
const BAR: f64 = 16.0;
const STEPS: usize = 10;
/// Labels along an axis, at most.
const LABELS: usize = 6;

impl HeatMap {
    /// The picture, the same text for the same data.
    pub fn to_svg(&self) -> String {
        let all = || {
            self.panels
                .iter()
                .flat_map(|panel| panel.values.iter().flatten().copied())
        };
        let finite = || all().filter(|value| self.spacing.shows(*value));
        let low = finite().fold(f64::INFINITY, f64::min);
        let high = finite().fold(f64::NEG_INFINITY, f64::max);
        let share = |value: f64| match self.spacing {
            _ if high <= low => 0.0,
            Spacing::Linear => (value - low) / (high - low),
            Spacing::Log => (value / low).ln() / (high / low).ln(),
        };
        let mut body = String::new();
        for (place, panel) in self.panels.iter().enumerate() {
            let left = LEFT + place as f64 * (LEFT + PLOT + RIGHT);
            body += &label("name", left, TOP - 12.0, "start", &panel.title);
            let width = PLOT / self.x.1.len().max(1) as f64;
            let height = HEIGHT / self.y.1.len().max(1) as f64;
            for (row, values) in panel.values.iter().enumerate() {
                for (column, value) in values
                    .iter()
                    .enumerate()
                    .filter(|(_, v)| self.spacing.shows(**v))
                {
                    let [r, g, b] = color_at(share(*value));
                    let (x, y) = (
                        left + column as f64 * width,
                        TOP + HEIGHT - (row + 1) as f64 * height,
                    );
                    body += &format!(
                        "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"#{r:02x}{g:02x}{b:02x}\"/>",
                        width + 0.3,
                        height + 0.3
                    );
                }
            }
            body += &format!(
                "<rect class=\"frame\" x=\"{left:.1}\" y=\"{TOP:.1}\" width=\"{PLOT:.1}\" height=\"{HEIGHT:.1}\"/>"
            );
            for (index, text) in labels(&self.x.1) {
                let x = left + (index as f64 + 0.5) * width;
                body += &label("", x, TOP + HEIGHT + 17.0, "middle", &text);
            }
            for (index, text) in labels(&self.y.1) {
                let y = TOP + HEIGHT - (index as f64 + 0.5) * height;
                body += &label("", left - 8.0, y + 4.0, "end", &text);
            }
            body += &label(
                "axis",
                left + PLOT / 2.0,
                TOP + HEIGHT + 38.0,
                "middle",
                &self.x.0,
            );
            let (x, y) = (left - LEFT + 14.0, TOP + HEIGHT / 2.0);
            body += &format!(
                "<g transform=\"rotate(-90 {x:.1} {y:.1})\">{}</g>",
                label("axis", x, y, "middle", &self.y.0)
            );
        }
        let right = 24.0 + self.panels.len() as f64 * (LEFT + PLOT + RIGHT);
        if low.is_finite() {
            body += &scale(right, self.spacing, low, high);
        }
        body += &label("axis", right - 8.0, TOP - 12.0, "start", &self.value);
        let width = right + 110.0;
        let (mut y, mut lines) = (TOP + HEIGHT + 66.0, String::new());
        for line in super::figure::wrap(&self.caption, ((width - 32.0) / 6.7) as usize) {
            lines += &label("caption", 16.0, y, "start", &line);
            y += 19.0;
        }
        let title = escape(&self.title);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {y:.0}\" width=\"{width:.0}\" \
             height=\"{y:.0}\" role=\"img\" aria-label=\"{title}\"><style>{}.frame{{fill:none;stroke:#8a929c}}</style>\
             <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/><text class=\"title\" x=\"16\" y=\"30\">{title}</text>\
             {body}{lines}</svg>\n",
            super::figure::STYLE
        )
    }
}

/// The scale of colours, with its upper left corner below the title.
fn scale(x: f64, spacing: Spacing, low: f64, high: f64) -> String {
    let step = HEIGHT / STEPS as f64;
    let mut svg = String::new();
    for k in 0..STEPS {
        let [r, g, b] = color_at((k as f64 + 0.5) / STEPS as f64);
        let y = TOP + HEIGHT - (k + 1) as f64 * step;
        svg += &format!(
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{BAR}\" height=\"{:.1}\" fill=\"#{r:02x}{g:02x}{b:02x}\"/>",
            step + 0.3
        );
    }
    for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let y = TOP + HEIGHT * (1.0 - share) + 4.0;
        let value = match spacing {
            Spacing::Linear => low + (high - low) * share,
            Spacing::Log => low * (high / low).powf(share),
        };
        svg += &label("", x + BAR + 6.0, y, "start", &short(value));
    }
    svg
}

/// A number in three significant digits.
fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    tick_label(rounded)
}

/// Some of the values with their places, evenly chosen.
fn labels(values: &[f64]) -> Vec<(usize, String)> {
    let stride = values.len().div_ceil(LABELS).max(1);
    values
        .iter()
        .enumerate()
        .step_by(stride)
        .map(|(k, value)| (k, short(*value)))
        .collect()
}

fn label(class: &str, x: f64, y: f64, anchor: &str, content: &str) -> String {
    super::figure::text(class, x, y, anchor, content)
}
