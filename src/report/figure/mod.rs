//! The plots of all pages and studies: plots side by side, or maps, as one self-contained SVG picture.

pub(crate) mod axis;
mod heat_map;
mod mark;
mod panel;
mod text;

pub use axis::Spacing;
pub use heat_map::{HeatMap, HeatPanel};
pub use mark::{Ink, Mark, Shape};
pub use panel::{Aspect, Panel, Scale};

use super::html::escape;
use panel::PLOT;
use text::{LETTER, LINE, STYLE, text, wrap};

/// Width of a letter of the title, in the widest of the fonts that it may have, and the distance of its lines (CSS pixels).
const TITLE_LETTER: f64 = 10.8;
const TITLE_LINE: f64 = 23.0;

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
        picture(&self.title, &self.caption, [x.max(PLOT), tallest], &body)
    }
}

/// Plots of a width and height under their title and above their caption.
fn picture(title: &str, caption: &str, [width, height]: [f64; 2], plots: &str) -> String {
    let titles = wrap(title, ((width - 32.0) / TITLE_LETTER) as usize);
    let above = match titles.len() {
        0 => 8.0,
        lines => 44.0 + TITLE_LINE * (lines - 1) as f64,
    };
    let mut body = format!("<g transform=\"translate(0 {above:.0})\">{plots}</g>");
    for (k, line) in titles.iter().enumerate() {
        let y = 30.0 + TITLE_LINE * k as f64;
        body += &text("title", 16.0, y, "start", line);
    }
    let lines = wrap(caption, ((width - 32.0) / LETTER) as usize);
    let top = above + height + 26.0;
    for (k, line) in lines.iter().enumerate() {
        let y = top + LINE * k as f64;
        body += &text("caption", 16.0, y, "start", line);
    }
    let height = match lines.len() {
        0 => above + height,
        lines => top + LINE * lines as f64,
    };
    let title = escape(title);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
         width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" aria-label=\"{title}\">\
         <style>{STYLE}</style><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>{body}</svg>\n"
    )
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

    #[test]
    fn a_line_has_a_gap_where_a_point_has_no_place() {
        let mut figure = figure("");
        let mark = &mut figure.panels[0].marks[0];
        mark.shape = Shape::Line;
        let heights = [0.0, 1.0, f64::NAN, 0.0, 1.0];
        mark.points = (0..)
            .map(f64::from)
            .zip(heights)
            .map(<[f64; 2]>::from)
            .collect();
        let svg = figure.to_svg();
        let (_, path) = svg.split_once("<path d=\"").expect("drawn");
        let (path, _) = path.split_once('"').expect("ends");
        assert_eq!(
            [path.matches('M').count(), path.matches('L').count()],
            [2, 2]
        );
    }
}
