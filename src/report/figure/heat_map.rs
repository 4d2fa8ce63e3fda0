//! Maps: numbers over two variables, by colour.

use super::super::color_scale::color_at;
use super::axis::{Spacing, tick_label};
use super::panel::{BELOW, HEIGHT, PLOT, RIGHT};
use super::picture;
use super::text::{text, upright};

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

/// Room around a map (CSS pixels).
const LEFT: f64 = 84.0;
const TOP: f64 = 28.0;
/// Room for the scale of colours, its width, and steps in which it is drawn.
const BESIDE: f64 = 134.0;
const BAR: f64 = 16.0;
const STEPS: usize = 10;
/// Labels along an axis, at most.
const LABELS: usize = 6;

impl HeatMap {
    /// The picture, the same text for the same data.
    pub fn to_svg(&self) -> String {
        let range = Range::of(self);
        let mut body = String::new();
        for (place, panel) in self.panels.iter().enumerate() {
            let left = LEFT + place as f64 * (LEFT + PLOT + RIGHT);
            body += &text("name", left, TOP - 12.0, "start", &panel.title);
            body += &self.cells(panel, &range, left);
            body += &self.axes(left);
        }
        let width = BESIDE + self.panels.len() as f64 * (LEFT + PLOT + RIGHT);
        let right = width - 110.0;
        if range.low.is_finite() {
            body += &range.scale(right);
        }
        body += &text("axis", right - 8.0, TOP - 12.0, "start", &self.value);
        let size = [width, TOP + HEIGHT + BELOW];
        picture(&self.title, &self.caption, size, &body)
    }

    /// Width and height of a cell.
    fn cell(&self) -> [f64; 2] {
        let part = |length: f64, values: &[f64]| length / values.len().max(1) as f64;
        [part(PLOT, &self.x.1), part(HEIGHT, &self.y.1)]
    }

    /// The numbers of a map as cells in colour.
    fn cells(&self, panel: &HeatPanel, range: &Range, left: f64) -> String {
        let [width, height] = self.cell();
        let mut svg = String::new();
        for (row, values) in panel.values.iter().enumerate() {
            let y = TOP + HEIGHT - (row + 1) as f64 * height;
            let shown = values.iter().enumerate();
            for (column, value) in shown.filter(|(_, value)| self.spacing.shows(**value)) {
                let x = left + column as f64 * width;
                svg += &cell([x, y], [width, height], range.share(*value));
            }
        }
        svg
    }

    /// The frame of a map, the labels along it, and the titles of its axes.
    fn axes(&self, left: f64) -> String {
        let [width, height] = self.cell();
        let bottom = TOP + HEIGHT;
        let mut svg = format!(
            "<rect x=\"{left:.1}\" y=\"{TOP:.1}\" width=\"{PLOT:.1}\" height=\"{HEIGHT:.1}\" \
             fill=\"none\" stroke=\"#8a929c\"/>"
        );
        for (index, label) in labels(&self.x.1) {
            let x = left + (index as f64 + 0.5) * width;
            svg += &text("", x, bottom + 17.0, "middle", &label);
        }
        for (index, label) in labels(&self.y.1) {
            let y = bottom - (index as f64 + 0.5) * height;
            svg += &text("", left - 8.0, y + 4.0, "end", &label);
        }
        svg += &text(
            "axis",
            left + PLOT / 2.0,
            bottom + 38.0,
            "middle",
            &self.x.0,
        );
        let place = [left - LEFT + 14.0, TOP + HEIGHT / 2.0];
        svg + &upright(place, &self.y.0)
    }
}

/// What the colours reach over.
struct Range {
    spacing: Spacing,
    low: f64,
    high: f64,
}

impl Range {
    /// The range of all numbers of a map; infinite where there is none.
    fn of(map: &HeatMap) -> Self {
        let all = map.panels.iter().flat_map(|panel| &panel.values).flatten();
        let shown = || all.clone().copied().filter(|x| map.spacing.shows(*x));
        Self {
            spacing: map.spacing,
            low: shown().fold(f64::INFINITY, f64::min),
            high: shown().fold(f64::NEG_INFINITY, f64::max),
        }
    }

    /// How far along the scale a number is.
    fn share(&self, value: f64) -> f64 {
        let Self { spacing, low, high } = *self;
        match spacing {
            _ if high <= low => 0.0,
            Spacing::Linear => (value - low) / (high - low),
            Spacing::Log => (value / low).ln() / (high / low).ln(),
        }
    }

    /// The number so far along the scale.
    fn value(&self, share: f64) -> f64 {
        match self.spacing {
            Spacing::Linear => self.low + (self.high - self.low) * share,
            Spacing::Log => self.low * (self.high / self.low).powf(share),
        }
    }

    /// The scale of colours, beside the maps.
    fn scale(&self, x: f64) -> String {
        let step = HEIGHT / STEPS as f64;
        let mut svg = String::new();
        for k in 0..STEPS {
            let y = TOP + HEIGHT - (k + 1) as f64 * step;
            svg += &cell([x, y], [BAR, step], (k as f64 + 0.5) / STEPS as f64);
        }
        for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
            let y = TOP + HEIGHT * (1.0 - share) + 4.0;
            let label = short(self.value(share));
            svg += &text("", x + BAR + 6.0, y, "start", &label);
        }
        svg
    }
}

/// A place in the colour of a share, a little larger, so that no line shows between neighbours.
fn cell([x, y]: [f64; 2], [width, height]: [f64; 2], share: f64) -> String {
    let [width, height] = [width + 0.3, height + 0.3];
    let [r, g, b] = color_at(share);
    format!(
        "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" \
         fill=\"#{r:02x}{g:02x}{b:02x}\"/>"
    )
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
