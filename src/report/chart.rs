//! Line and bar charts as inline SVG, drawn in the page's own colours and font.

use super::Role;
use super::figure::axis::{Axis, Spacing, tick_label};
use super::html::{duration, escape};
use std::fmt::Write;

/// Size of a line chart and its margins around the plot, in SVG user units (CSS pixels).
const WIDTH: f64 = 480.0;
const HEIGHT: f64 = 290.0;
const LEFT: f64 = 52.0;
const RIGHT: f64 = 30.0;
const TOP: f64 = 30.0;
const BOTTOM: f64 = 44.0;

/// Series of at most this many points show each point as a dot.
const DOTTED: usize = 40;

/// Bar chart: full width, height of a row, room for the value, width of a letter.
const BARS_WIDTH: f64 = 760.0;
const ROW: f64 = 28.0;
const VALUE: f64 = 90.0;
const LETTER: f64 = 7.2;
/// Longest bar label shown (letters); a longer one is cut, and whole in the tooltip.
const LABEL_LETTERS: usize = 34;

impl Role {
    fn class(self) -> &'static str {
        match self {
            Self::Network => "network",
            Self::Nearest => "nearest",
            // As many strokes as can be told apart.
            Self::Other(place) => ["other solid", "other dashed", "other dotted"][place % 3],
            Self::Floor => "floor",
        }
    }
}

/// A named line through points `(x, y)`.
pub(crate) struct Series<'a> {
    pub name: &'a str,
    pub role: Role,
    pub points: Vec<(f64, f64)>,
}

/// Title and spacing of a chart's axis; the title names the unit.
pub(crate) struct AxisStyle<'a> {
    pub title: &'a str,
    pub spacing: Spacing,
}

/// A legend and a line chart; `None` if there is no point to draw but reference lines.
///
/// Points off an axis (not finite, or not positive on a log axis) leave a gap in their line.
pub(crate) fn line_chart(
    title: &str,
    x: &AxisStyle,
    y: &AxisStyle,
    series: &[Series],
) -> Option<String> {
    let drawable = |p: &&(f64, f64)| x.spacing.shows(p.0) && y.spacing.shows(p.1);
    let points = || series.iter().flat_map(|s| &s.points).filter(drawable);
    let mut measured = series.iter().filter(|s| s.role != Role::Floor);
    if !measured.any(|s| s.points.iter().any(|p| drawable(&p))) {
        return None;
    }
    let plot = Plot {
        x: Axis::covering(x.spacing, points().map(|p| p.0))?,
        y: Axis::covering(y.spacing, points().map(|p| p.1))?,
    };
    let grid = plot.grid(x.title, y.title);
    let lines: String = series.iter().map(|line| plot.line(line)).collect();
    Some(format!(
        "{}<svg class=\"chart\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" \
         aria-label=\"{}\">{grid}{lines}</svg>",
        legend(series),
        escape(title),
    ))
}

fn legend(series: &[Series]) -> String {
    let entries: String = series
        .iter()
        .map(|line| {
            let (class, name) = (line.role.class(), escape(line.name));
            format!("<li><i class=\"stroke {class}\"></i>{name}</li>")
        })
        .collect();
    format!("<ul class=\"legend\">{entries}</ul>")
}

/// The axes of a line chart.
struct Plot {
    x: Axis,
    y: Axis,
}

impl Plot {
    fn place(&self, (x, y): (f64, f64)) -> Option<(f64, f64)> {
        let (x, y) = (self.x.fraction(x)?, self.y.fraction(y)?);
        Some((
            LEFT + x * (WIDTH - LEFT - RIGHT),
            HEIGHT - BOTTOM - y * (HEIGHT - TOP - BOTTOM),
        ))
    }

    fn grid(&self, x_title: &str, y_title: &str) -> String {
        let mut svg = String::new();
        let (bottom, right) = (HEIGHT - BOTTOM, WIDTH - RIGHT);
        let positions = |axis: &Axis, span: f64, start: f64| -> Vec<(f64, String)> {
            let place = |&tick: &f64| Some((start + axis.fraction(tick)? * span, tick_label(tick)));
            axis.ticks().iter().filter_map(place).collect()
        };
        for (y, label) in positions(&self.y, TOP - bottom, bottom) {
            svg += &format!(
                "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{right}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
                LEFT - 7.0,
                y + 4.0,
            );
        }
        for (x, label) in positions(&self.x, right - LEFT, LEFT) {
            svg += &format!(
                "<line class=\"tick\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{bottom}\" y2=\"{:.1}\"/>\
                 <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{label}</text>",
                bottom + 5.0,
                bottom + 19.0,
            );
        }
        svg + &format!(
            "<line class=\"axis\" x1=\"{LEFT}\" x2=\"{right}\" y1=\"{bottom}\" y2=\"{bottom}\"/>\
             <text class=\"title\" x=\"0\" y=\"14\">{}</text>\
             <text class=\"title\" x=\"{right}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            escape(y_title),
            HEIGHT - 5.0,
            escape(x_title),
        )
    }

    fn line(&self, series: &Series) -> String {
        let class = series.role.class();
        let mut path = String::new();
        let mut dots = String::new();
        let mut pen = 'M';
        for &point in &series.points {
            let Some((x, y)) = self.place(point) else {
                pen = 'M';
                continue;
            };
            // Writing to a String cannot fail.
            let _ = write!(path, "{pen}{x:.1} {y:.1}");
            pen = 'L';
            if series.role != Role::Floor && series.points.len() <= DOTTED {
                let _ = write!(
                    dots,
                    "<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\"/>"
                );
            }
        }
        format!("<path class=\"line {class}\" d=\"{path}\"/>{dots}")
    }
}

/// A dot of a chart: its place on both axes and its colour.
pub(crate) struct Dot {
    pub place: (f64, f64),
    pub color: [u8; 3],
}

/// A chart of dots, the last on top; `None` if there is none to draw.
pub(crate) fn dot_chart(title: &str, x: &AxisStyle, y: &AxisStyle, dots: &[Dot]) -> Option<String> {
    let places = || {
        let places = dots.iter().map(|dot| dot.place);
        places.filter(|place| x.spacing.shows(place.0) && y.spacing.shows(place.1))
    };
    let plot = Plot {
        x: Axis::covering(x.spacing, places().map(|place| place.0))?,
        y: Axis::covering(y.spacing, places().map(|place| place.1))?,
    };
    let grid = plot.grid(x.title, y.title);
    let circles = dots.iter().filter_map(|dot| {
        let (x, y) = plot.place(dot.place)?;
        let [r, g, b] = dot.color;
        Some(format!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"#{r:02x}{g:02x}{b:02x}\"/>"
        ))
    });
    let circles: String = circles.collect();
    Some(format!(
        "<svg class=\"chart\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">\
         {grid}<g class=\"dots\">{circles}</g></svg>",
        escape(title),
    ))
}

/// Horizontal bars from zero for durations (s); `None` if none is above zero.
pub(crate) fn duration_bars(title: &str, bars: &[(&str, f64)]) -> Option<String> {
    let longest = bars
        .iter()
        .map(|b| b.1)
        .filter(|s| s.is_finite())
        .fold(0.0, f64::max);
    if longest <= 0.0 {
        return None;
    }
    let letters = bars
        .iter()
        .map(|b| b.0.chars().count().min(LABEL_LETTERS))
        .max();
    let start = LETTER * letters.unwrap_or(0) as f64 + 12.0;
    let height = ROW * bars.len() as f64;
    let mut body = String::new();
    for (row, (name, seconds)) in bars.iter().enumerate() {
        let middle = ROW * (row as f64 + 0.5);
        let length = (seconds / longest).max(0.0) * (BARS_WIDTH - start - VALUE);
        let shown: String = if name.chars().count() > LABEL_LETTERS {
            name.chars().take(LABEL_LETTERS - 1).chain(['…']).collect()
        } else {
            (*name).to_owned()
        };
        body += &format!(
            "<g><title>{}</title>\
             <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>\
             <rect class=\"bar\" x=\"{start:.1}\" y=\"{:.1}\" width=\"{length:.1}\" height=\"16\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\">{}</text></g>",
            escape(name),
            start - 10.0,
            middle + 4.5,
            escape(&shown),
            middle - 8.0,
            start + length + 8.0,
            middle + 4.5,
            duration(*seconds),
        );
    }
    Some(format!(
        "<svg class=\"chart bars\" viewBox=\"0 0 {BARS_WIDTH} {height}\" role=\"img\" \
         aria-label=\"{}\">{body}</svg>",
        escape(title),
    ))
}
