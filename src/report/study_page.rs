//! The page on a study.

use super::frame::PageFrame;
use super::html::escape;
use super::sections;
use super::surface::{self, Surface};

/// All that the page shows.
#[derive(Clone, Debug, Default)]
pub struct StudyPage {
    /// What the study is about.
    pub title: String,
    /// What was computed, in a sentence.
    pub headline: String,
    /// The figures, in order.
    pub figures: Vec<StudyFigure>,
    /// Surfaces that one can turn; without any, the page has no such section.
    pub surfaces: Vec<Surface>,
    /// What is drawn of them, a sentence.
    pub surfaces_note: String,
    /// What was run, as `(name, value)`.
    pub summary: Vec<(String, String)>,
}

/// A figure of a study.
#[derive(Clone, Debug, Default)]
pub struct StudyFigure {
    /// Name of its file, without an extension.
    pub name: String,
    /// The picture, self-contained.
    pub svg: String,
}

impl StudyPage {
    /// The page as one self-contained HTML text, the same for the same data.
    pub fn to_html(&self) -> String {
        let figures: String = (self.figures.iter())
            .map(|figure| {
                format!(
                    "<figure id=\"{}\">{}</figure>",
                    escape(&figure.name),
                    figure.svg
                )
            })
            .collect();
        let frame = PageFrame {
            title: &self.title,
            lead: &self.headline,
            style: include_str!("study_page.css"),
        };
        frame.fill(
            include_str!("study_page.html"),
            &[
                ("figures", &figures),
                (
                    "surfaces",
                    &surface::section(&self.surfaces, &self.surfaces_note),
                ),
                ("settings", &sections::settings(&self.summary)),
            ],
        )
    }
}
