//! One plot of a figure: its axes, and the marks between them.

use super::axis::{Axis, Spacing, tick_label};
use super::mark::Mark;
use super::text::{LETTER, LINE, text, upright, wrap};

/// Width of a plot and the room around it (CSS pixels).
pub(super) const PLOT: f64 = 330.0;
/// Height of a plot with a free aspect, and the most of one with equal scales.
pub(super) const HEIGHT: f64 = 280.0;
const TALLEST: f64 = 420.0;
/// Height of a name's row in a plot of few names.
const ROW: f64 = 28.0;
const LEFT: f64 = 60.0;
pub(super) const RIGHT: f64 = 26.0;
pub(super) const BELOW: f64 = 48.0;
/// Distance of the labels of two ticks, one above the other, at the least.
const LEAST_APART: f64 = 13.0;
/// Distance of the lines of an upright title.
const UPRIGHT_LINE: f64 = 15.0;

/// One plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// What it shows.
    pub title: String,
    /// The horizontal axis.
    pub x: Scale,
    /// The vertical axis.
    pub y: Scale,
    /// Whether both axes have the same scale.
    pub aspect: Aspect,
    /// What is drawn, the first at the bottom.
    pub marks: Vec<Mark>,
}

/// What an axis shows.
#[derive(Clone, Debug, PartialEq)]
pub enum Scale {
    /// Numbers.
    Numbers {
        /// Of what, and in which unit.
        title: String,
        /// How they are spaced.
        spacing: Spacing,
    },
    /// Names, the first at 0, the next at 1, and so on.
    Names(Vec<String>),
}

/// Whether both axes of a plot have the same scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aspect {
    /// Each has its own.
    Free,
    /// A unit is as long on one as on the other: for places.
    Equal,
}

impl Scale {
    /// Numbers at even distances, under a title that names the unit.
    pub fn linear(title: &str) -> Self {
        Self::Numbers {
            title: title.to_owned(),
            spacing: Spacing::Linear,
        }
    }

    /// Numbers above 0 on a logarithmic axis, under a title that names the unit.
    pub fn log(title: &str) -> Self {
        Self::Numbers {
            title: title.to_owned(),
            spacing: Spacing::Log,
        }
    }

    fn title(&self) -> &str {
        match self {
            Self::Numbers { title, .. } => title,
            Self::Names(_) => "",
        }
    }

    /// The axis, and its ticks with their labels.
    fn axis(&self, values: impl Iterator<Item = f64>) -> (Option<Axis>, Vec<(f64, String)>) {
        match self {
            Self::Numbers { spacing, .. } => {
                let axis = Axis::covering(*spacing, values);
                let ticks = axis.iter().flat_map(Axis::ticks);
                let ticks = ticks.map(|&tick| (tick, tick_label(tick))).collect();
                (axis, ticks)
            }
            Self::Names(names) => {
                let named = names.iter().enumerate();
                let ticks = named.map(|(k, name)| (k as f64, name.clone())).collect();
                (Axis::of_names(names.len()), ticks)
            }
        }
    }

    /// Room that labels of ticks take to the left of a plot.
    fn room(&self, ticks: &[(f64, String)]) -> f64 {
        let longest = ticks.iter().map(|(_, label)| label.chars().count()).max();
        let labels = LETTER * longest.unwrap_or(0) as f64;
        match self {
            // Between the title and the plot.
            Self::Numbers { .. } => LEFT.max(26.0 + labels),
            Self::Names(_) => 20.0 + labels,
        }
    }
}

impl Panel {
    /// The plot from its upper left corner, and its width and height.
    pub(super) fn draw(&self) -> (String, f64, f64) {
        let lines = wrap(self.y.title(), (HEIGHT / LETTER) as usize);
        let more = UPRIGHT_LINE * lines.len().saturating_sub(1) as f64;
        let points = || self.marks.iter().flat_map(|mark| &mark.points);
        let (x_axis, x_ticks) = self.x.axis(points().map(|p| p[0]));
        let (y_axis, y_ticks) = self.y.axis(points().map(|p| p[1]));
        let left = self.y.room(&y_ticks) + more;
        let (mut svg, top) = self.head(left);
        let (Some(x), Some(y)) = (x_axis, y_axis) else {
            svg += &text("", left, top + 20.0, "start", "nothing to show");
            return (svg, left + PLOT + RIGHT, top + HEIGHT + BELOW);
        };
        let [width, height] = self.size(&x, &y);
        let plot = Plot {
            x,
            y,
            corner: [left, top],
            size: [width, height],
        };
        svg += &plot.grid(&x_ticks, &y_ticks);
        for mark in &self.marks {
            let places: Vec<_> = mark.points.iter().map(|&point| plot.place(point)).collect();
            svg += &mark.draw(&places);
        }
        svg += &plot.titles(self.x.title(), &lines);
        (svg, left + width + RIGHT, top + height + BELOW)
    }

    /// Title and legend, and where the plot begins below them.
    fn head(&self, left: f64) -> (String, f64) {
        let (mut svg, mut y) = match self.title.as_str() {
            "" => (String::new(), 12.0),
            title => (text("name", left, 16.0, "start", title), 36.0),
        };
        for mark in self.marks.iter().filter(|mark| !mark.name.is_empty()) {
            svg += &mark.sample(left, y - 4.0);
            svg += &text("", left + 32.0, y, "start", &mark.name);
            y += LINE;
        }
        (svg, y + 4.0)
    }

    /// Width and height of the plot.
    fn size(&self, x: &Axis, y: &Axis) -> [f64; 2] {
        match (self.aspect, &self.y) {
            (Aspect::Equal, _) => {
                let height = PLOT * y.span() / x.span();
                let shrink = (TALLEST / height).min(1.0);
                [PLOT * shrink, height * shrink]
            }
            (Aspect::Free, Scale::Names(names)) => [PLOT, HEIGHT.min(ROW * names.len() as f64)],
            (Aspect::Free, Scale::Numbers { .. }) => [PLOT, HEIGHT],
        }
    }
}

/// The place between the axes of a panel.
struct Plot {
    x: Axis,
    y: Axis,
    /// Its upper left corner.
    corner: [f64; 2],
    /// Width and height.
    size: [f64; 2],
}

impl Plot {
    fn place(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        Some([self.across(x)?, self.up(y)?])
    }

    fn across(&self, x: f64) -> Option<f64> {
        Some(self.corner[0] + self.x.fraction(x)? * self.size[0])
    }

    fn up(&self, y: f64) -> Option<f64> {
        Some(self.bottom() - self.y.fraction(y)? * self.size[1])
    }

    fn bottom(&self) -> f64 {
        self.corner[1] + self.size[1]
    }

    /// Lines at the ticks, and their labels.
    fn grid(&self, x_ticks: &[(f64, String)], y_ticks: &[(f64, String)]) -> String {
        let [left, top] = self.corner;
        let (right, bottom) = (left + self.size[0], self.bottom());
        let mut svg = String::new();
        for (tick, label) in x_ticks {
            let Some(x) = self.across(*tick) else {
                continue;
            };
            svg +=
                &format!("<line x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{top:.1}\" y2=\"{bottom:.1}\"/>");
            svg += &text("", x, bottom + 17.0, "middle", label);
        }
        let mut last = f64::INFINITY;
        for (tick, label) in y_ticks {
            // A flat plot with equal scales has room for few.
            let Some(y) = self.up(*tick).filter(|y| last - y >= LEAST_APART) else {
                continue;
            };
            last = y;
            svg +=
                &format!("<line x1=\"{left:.1}\" x2=\"{right:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>");
            svg += &text("", left - 8.0, y + 4.0, "end", label);
        }
        svg
    }

    /// The titles of the axes, the upright one in lines.
    fn titles(&self, below: &str, lines: &[String]) -> String {
        let [width, height] = self.size;
        let middle = self.corner[0] + width / 2.0;
        let mut svg = text("axis", middle, self.bottom() + 38.0, "middle", below);
        let centre = self.corner[1] + height / 2.0;
        for (line, title) in lines.iter().enumerate() {
            let x = 14.0 + UPRIGHT_LINE * line as f64;
            svg += &upright([x, centre], title);
        }
        svg
    }
}
