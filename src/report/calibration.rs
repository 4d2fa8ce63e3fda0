//! The page on a calibration.

use super::frame::PageFrame;
use super::html::escape;
use super::sections::{self, CloudBox};
use super::{Example, Figure};

/// All that the page shows.
#[derive(Clone, Debug, Default)]
pub struct CalibrationReport {
    /// Title of the page.
    pub title: String,
    /// The result, in a sentence or two.
    pub headline: String,
    /// Plots, from above.
    pub figures: Vec<Figure>,
    /// Clouds to turn: what was measured as the truth, what the robot says as the prediction.
    pub examples: Vec<Example>,
    /// Each unknown's name, value, interval, unit and a note.
    pub unknowns: Vec<[String; 5]>,
    /// Two unknowns' names and their correlation.
    pub correlations: Vec<[String; 3]>,
}

impl CalibrationReport {
    /// The page as one self-contained HTML text, the same for the same data.
    pub fn to_html(&self) -> String {
        let boxes = [
            CloudBox::new("truth", "truth", "Measured"),
            CloudBox::new("prediction", "network", "Calibrated robot"),
        ];
        let figures: String = self.figures.iter().map(Figure::to_svg).collect();
        let unknowns = table(
            ["Unknown", "Value", "95 % interval", "Unit", ""],
            &self.unknowns,
        );
        let correlations = match self.correlations.is_empty() {
            true => "<p class=\"note\">No two unknowns have a correlation of 0.9 or more.</p>"
                .to_owned(),
            false => table(["One", "Other", "Correlation"], &self.correlations),
        };
        let frame = PageFrame {
            title: &self.title,
            lead: &self.headline,
            style: include_str!("calibration_page.css"),
        };
        frame.fill(
            include_str!("calibration_page.html"),
            &[
                ("viewer", &sections::viewer(&self.examples, &boxes)),
                ("figures", &figures),
                ("unknowns", &unknowns),
                ("correlations", &correlations),
            ],
        )
    }
}

fn table<const N: usize>(heads: [&str; N], rows: &[[String; N]]) -> String {
    let head: String = heads
        .iter()
        .map(|head| format!("<th scope=\"col\">{}</th>", escape(head)))
        .collect();
    let row = |row: &[String; N]| {
        let cells: String = row[1..]
            .iter()
            .map(|cell| format!("<td>{}</td>", escape(cell)))
            .collect();
        format!("<tr><th scope=\"row\">{}</th>{cells}</tr>", escape(&row[0]))
    };
    let body: String = rows.iter().map(row).collect();
    format!(
        "<div class=\"scroll\"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )
}
