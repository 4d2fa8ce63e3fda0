//! What all pages have: head, title, style.

use super::html::{escape, fill};
use super::sections;

/// A page without its sections.
pub(crate) struct PageFrame<'a> {
    /// Its title.
    pub title: &'a str,
    /// A sentence below; none where it is empty.
    pub lead: &'a str,
    /// Style sheet beside the one of all pages; may be empty.
    pub style: &'a str,
}

impl PageFrame<'_> {
    /// The page as one self-contained HTML text: sections are those of a template, with its values.
    pub fn fill(&self, sections: &str, values: &[(&str, &str)]) -> String {
        let lead = match self.lead {
            "" => String::new(),
            lead => format!("<p class=\"lead\">{}</p>\n", escape(lead)),
        };
        fill(
            include_str!("frame.html"),
            &[
                ("title", &escape(self.title)),
                ("style", &(sections::style() + self.style)),
                ("lead", &lead),
                ("body", &fill(sections, values)),
            ],
        )
    }
}
