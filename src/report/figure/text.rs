//! Text in a picture.

use super::super::html::escape;

/// Distance of lines (CSS pixels).
pub(super) const LINE: f64 = 19.0;
/// Width of a letter of the caption's text.
pub(super) const LETTER: f64 = 6.7;

/// Style sheet of a picture.
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

/// The title of an axis that reads from below, about its middle.
pub(super) fn upright([x, y]: [f64; 2], content: &str) -> String {
    let title = text("axis", x, y, "middle", content);
    format!("<g transform=\"rotate(-90 {x:.1} {y:.1})\">{title}</g>")
}
