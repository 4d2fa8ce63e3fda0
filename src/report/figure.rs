//! Plots side by side, as one self-contained SVG picture.

use super::axis::{Axis, Spacing, tick_label};
use super::html::escape;

/// A row of plots under a title and above a caption.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// What is shown.
    pub title: String,
    /// How to read it, broken into lines as needed.
    pub caption: String,
    /// The plots, from left to right.
    pub panels: Vec<Panel>,
}

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

/// Points drawn alike. A point without a place on an axis is left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Name in the legend; none where it is empty.
    pub name: String,
    /// How they are drawn.
    pub shape: Shape,
    /// Their colour.
    pub ink: Ink,
    /// Horizontal and vertical coordinates.
    pub points: Vec<[f64; 2]>,
}

/// How points are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Shape {
    /// Joined by a line.
    Line,
    /// Joined by a thin dashed line.
    Dashes,
    /// Each by a dot.
    Dots,
    /// Each by a small dot that lets others shine through: for thousands.
    Specks,
    /// Each by a pale disc, around the dots that lie over it: for what is compared with them.
    Halos,
    /// Corners of an area that lets others shine through.
    Area,
    /// Each two joined by a line.
    Segments,
    /// Not at all: the axes reach so far. For axes that plots share.
    Unseen,
}

/// Colours that the colour-blind tell apart (Okabe and Ito).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Ink {
    /// Black.
    Black,
    /// Grey.
    Grey,
    /// Blue.
    Blue,
    /// Vermilion.
    Vermilion,
    /// Green.
    Green,
    /// Purple.
    Purple,
}

/// Width of a plot and the room around it (CSS pixels).
const PLOT: f64 = 330.0;
/// Height of a plot with a free aspect, and the most of one with equal scales.
const HEIGHT: f64 = 280.0;
const TALLEST: f64 = 420.0;
const LEFT: f64 = 60.0;
const RIGHT: f64 = 26.0;
const BELOW: f64 = 48.0;
const LINE: f64 = 19.0;
/// Distance of the lines of an upright title.
const UPRIGHT_LINE: f64 = 15.0;
/// Width of a letter of the caption's text, and of the title's.
const LETTER: f64 = 6.7;
const TITLE_LETTER: f64 = 9.8;
/// Distance of the title's lines.
const TITLE_LINE: f64 = 23.0;

impl Ink {
    fn hex(self) -> &'static str {
        match self {
            Self::Black => "#1c2128",
            Self::Grey => "#8a929c",
            Self::Blue => "#0072b2",
            Self::Vermilion => "#d55e00",
            Self::Green => "#009e73",
            Self::Purple => "#a0558a",
        }
    }
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
                let ends = [-0.5, names.len() as f64 - 0.5];
                let named = names.iter().enumerate();
                let ticks = named.map(|(k, name)| (k as f64, name.clone())).collect();
                (Axis::covering(Spacing::Linear, ends), ticks)
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

impl Figure {
    /// The picture, the same text for the same data.
    pub fn to_svg(&self) -> String {
        let mut x = 0.0;
        let mut tallest: f64 = 0.0;
        let mut body = String::new();
        for panel in &self.panels {
            let (svg, width, height) = panel.draw();
            body += &format!("<g transform=\"translate({x:.1} 0)\">{svg}</g>");
            x += width;
            tallest = tallest.max(height);
        }
        let width = x.max(PLOT);
        let titles = wrap(&self.title, ((width - 32.0) / TITLE_LETTER) as usize);
        let above = 44.0 + TITLE_LINE * titles.len().saturating_sub(1) as f64;
        let mut body = format!("<g transform=\"translate(0 {above:.0})\">{body}</g>");
        for (k, line) in titles.iter().enumerate() {
            let y = 30.0 + TITLE_LINE * k as f64;
            body += &text("title", 16.0, y, "start", line);
        }
        let lines = wrap(&self.caption, ((width - 32.0) / LETTER) as usize);
        let top = above + tallest + 26.0;
        for (k, line) in lines.iter().enumerate() {
            let y = top + LINE * k as f64;
            body += &text("caption", 16.0, y, "start", line);
        }
        let height = top + LINE * lines.len() as f64;
        let title = escape(&self.title);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
             width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" aria-label=\"{title}\">\
             <style>{STYLE}</style><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>{body}</svg>\n"
        )
    }
}

pub(super) const STYLE: &str = "text{font:12px system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,\
     sans-serif;fill:#5a6370}.title{font-size:18px;font-weight:650;fill:#1c2128}.name{font-size:14px;\
     font-weight:600;fill:#1c2128}.axis{fill:#1c2128}.caption{font-size:13px}\
     line{stroke:#dfe3e8}path{fill:none;stroke-linejoin:round}";

pub(super) fn text(class: &str, x: f64, y: f64, anchor: &str, content: &str) -> String {
    let content = escape(content);
    format!(
        "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{content}</text>"
    )
}

/// Breaks a text between words into lines of at most so many letters.
pub(super) fn wrap(text: &str, letters: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= letters => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

impl Panel {
    /// The plot from its upper left corner, and its width and height.
    fn draw(&self) -> (String, f64, f64) {
        let named: Vec<&Mark> = self.marks.iter().filter(|m| !m.name.is_empty()).collect();
        let upright = wrap(self.y.title(), (HEIGHT / LETTER) as usize);
        let more = UPRIGHT_LINE * upright.len().saturating_sub(1) as f64;
        let points = || self.marks.iter().flat_map(|mark| &mark.points);
        let (x_axis, x_ticks) = self.x.axis(points().map(|p| p[0]));
        let (y_axis, y_ticks) = self.y.axis(points().map(|p| p[1]));
        let left = self.y.room(&y_ticks) + more;
        let top = 40.0 + LINE * named.len() as f64;
        let mut svg = text("name", left, 16.0, "start", &self.title);
        for (k, mark) in named.iter().enumerate() {
            let y = 36.0 + LINE * k as f64;
            svg += &mark.sample(left, y - 4.0);
            svg += &text("", left + 32.0, y, "start", &mark.name);
        }
        let (Some(x_axis), Some(y_axis)) = (x_axis, y_axis) else {
            svg += &text("", left, top + 20.0, "start", "nothing to show");
            return (svg, left + PLOT + RIGHT, top + HEIGHT + BELOW);
        };
        let (width, height) = match self.aspect {
            Aspect::Free => (PLOT, HEIGHT),
            Aspect::Equal => {
                let height = PLOT * y_axis.span() / x_axis.span();
                let shrink = (TALLEST / height).min(1.0);
                (PLOT * shrink, height * shrink)
            }
        };
        let place = |[x, y]: [f64; 2]| {
            let (x, y) = (x_axis.fraction(x)?, y_axis.fraction(y)?);
            Some([left + x * width, top + height - y * height])
        };
        for (tick, label) in &x_ticks {
            let Some(x) = x_axis.fraction(*tick).map(|x| left + x * width) else {
                continue;
            };
            let bottom = top + height;
            svg +=
                &format!("<line x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{top:.1}\" y2=\"{bottom:.1}\"/>");
            svg += &text("", x, bottom + 17.0, "middle", label);
        }
        for (tick, label) in &y_ticks {
            let Some(y) = y_axis.fraction(*tick).map(|y| top + height - y * height) else {
                continue;
            };
            let right = left + width;
            svg +=
                &format!("<line x1=\"{left:.1}\" x2=\"{right:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>");
            svg += &text("", left - 8.0, y + 4.0, "end", label);
        }
        for mark in &self.marks {
            let places: Vec<[f64; 2]> = mark.points.iter().copied().filter_map(place).collect();
            svg += &mark.draw(&places);
        }
        let (middle, bottom) = (left + width / 2.0, top + height + 38.0);
        svg += &text("axis", middle, bottom, "middle", self.x.title());
        let centre = top + height / 2.0;
        for (line, title) in upright.iter().enumerate() {
            let x = 14.0 + UPRIGHT_LINE * line as f64;
            let turn = format!("<g transform=\"rotate(-90 {x} {centre:.1})\">");
            svg += &(turn + &text("axis", x, centre, "middle", title) + "</g>");
        }
        (svg, left + width + RIGHT, top + height + BELOW)
    }
}

impl Mark {
    /// What stands for it in a legend.
    fn sample(&self, x: f64, y: f64) -> String {
        match self.shape {
            Shape::Dots | Shape::Specks | Shape::Halos => self.draw(&[[x + 12.0, y]]),
            Shape::Area => {
                let (right, top, bottom) = (x + 24.0, y - 5.0, y + 5.0);
                self.draw(&[[x, top], [right, top], [right, bottom], [x, bottom]])
            }
            Shape::Line | Shape::Dashes | Shape::Segments => self.draw(&[[x, y], [x + 24.0, y]]),
            Shape::Unseen => String::new(),
        }
    }

    fn draw(&self, places: &[[f64; 2]]) -> String {
        let ink = self.ink.hex();
        let stroke = match self.shape {
            Shape::Dots => {
                let dot = |[x, y]: &[f64; 2]| {
                    format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{ink}\"/>")
                };
                return places.iter().map(dot).collect();
            }
            Shape::Specks | Shape::Halos => {
                let (radius, opacity) = match self.shape {
                    Shape::Specks => (1.2, 0.5),
                    _ => (3.4, 0.3),
                };
                let disc = |[x, y]: &[f64; 2]| {
                    format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\"/>")
                };
                let discs: String = places.iter().map(disc).collect();
                return format!("<g fill=\"{ink}\" fill-opacity=\"{opacity}\">{discs}</g>");
            }
            Shape::Area => {
                let corners: Vec<String> = places
                    .iter()
                    .map(|[x, y]| format!("{x:.1},{y:.1}"))
                    .collect();
                let corners = corners.join(" ");
                return format!(
                    "<polygon points=\"{corners}\" fill=\"{ink}\" fill-opacity=\"0.16\"/>"
                );
            }
            Shape::Segments => {
                let segment = |ends: &[[f64; 2]]| match ends {
                    [[a, b], [c, d]] => format!("M{a:.1} {b:.1}L{c:.1} {d:.1}"),
                    _ => String::new(),
                };
                let path: String = places.chunks(2).map(segment).collect();
                return format!("<path d=\"{path}\" stroke=\"{ink}\" stroke-width=\"1.4\"/>");
            }
            Shape::Unseen => return String::new(),
            Shape::Line => "stroke-width=\"1.8\"",
            Shape::Dashes => "stroke-width=\"1.2\" stroke-dasharray=\"5 4\"",
        };
        let points = places.iter().map(|[x, y]| format!("{x:.1} {y:.1}"));
        let path = points.collect::<Vec<_>>().join("L");
        match path.is_empty() {
            true => String::new(),
            false => format!("<path d=\"M{path}\" stroke=\"{ink}\" {stroke}/>"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(title: &str) -> Figure {
        let mark = |shape, ink| Mark {
            name: String::new(),
            shape,
            ink,
            points: vec![[0.0, 0.0], [1.0, 1.0]],
        };
        Figure {
            title: title.to_owned(),
            caption: String::new(),
            panels: vec![Panel {
                title: String::new(),
                x: Scale::linear("x"),
                y: Scale::linear("y"),
                aspect: Aspect::Free,
                marks: vec![
                    mark(Shape::Halos, Ink::Vermilion),
                    mark(Shape::Specks, Ink::Black),
                ],
            }],
        }
    }

    #[test]
    fn a_title_wider_than_its_figure_is_broken_and_moves_the_plots_down() {
        let long = "Training: the motions with the largest errors of them all";
        let (short, long) = (figure("Training").to_svg(), figure(long).to_svg());
        assert_eq!(short.matches("class=\"title\"").count(), 1);
        assert_eq!(long.matches("class=\"title\"").count(), 2);
        assert!(short.contains("translate(0 44)") && long.contains("translate(0 67)"));
    }

    #[test]
    fn what_is_measured_lies_above_wider_and_paler_discs() {
        let svg = figure("").to_svg();
        let place = |part: &str| svg.find(part).expect("drawn");
        assert!(place("r=\"3.4\"") < place("r=\"1.2\""));
        assert!(place("fill-opacity=\"0.3\"") < place("fill-opacity=\"0.5\""));
    }
}
