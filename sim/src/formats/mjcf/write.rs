//! Writing XML.

use std::fmt::Write;

use nalgebra::{UnitQuaternion, Vector3};

/// An indented XML text that grows element by element.
#[derive(Default)]
pub(crate) struct XmlWriter {
    text: String,
    open: Vec<&'static str>,
    /// What names in a MuJoCo model begin with.
    prefix: String,
}

/// Attributes of MuJoCo's elements that give an element its name, or refer to one by it.
const NAMES: [&str; 8] = [
    "name",
    "class",
    "childclass",
    "site",
    "tendon",
    "mesh",
    "body1",
    "body2",
];

/// An attribute's name and value.
pub(crate) type Attribute<'a> = (&'a str, String);

impl XmlWriter {
    /// One whose elements have names that begin with `prefix`.
    pub fn with_prefix(prefix: &str) -> Self {
        Self {
            prefix: prefix.to_owned(),
            ..Self::default()
        }
    }

    /// An element that holds no other.
    pub fn leaf(&mut self, tag: &str, attributes: &[Attribute<'_>]) {
        self.start(tag, attributes);
        self.text.push_str("/>\n");
    }

    /// An element that holds those up to its [`close`](Self::close).
    pub fn open(&mut self, tag: &'static str, attributes: &[Attribute<'_>]) {
        self.start(tag, attributes);
        self.text.push_str(">\n");
        self.open.push(tag);
    }

    /// A comment, which must not hold two hyphens in a row.
    pub fn comment(&mut self, text: &str) {
        self.indent();
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "<!-- {text} -->");
    }

    /// Ends the element opened last.
    pub fn close(&mut self) {
        if let Some(tag) = self.open.pop() {
            self.indent();
            // Writing to a string cannot fail.
            let _ = writeln!(self.text, "</{tag}>");
        }
    }

    /// The text, every element ended.
    pub fn finish(mut self) -> String {
        while !self.open.is_empty() {
            self.close();
        }
        self.text
    }

    fn start(&mut self, tag: &str, attributes: &[Attribute<'_>]) {
        self.indent();
        self.text.push('<');
        self.text.push_str(tag);
        for (name, value) in attributes {
            let prefix = match NAMES.contains(name) {
                true => escape(&self.prefix),
                false => String::new(),
            };
            let _ = write!(self.text, " {name}=\"{prefix}{}\"", escape(value));
        }
    }

    fn indent(&mut self) {
        let spaces = 2 * self.open.len();
        self.text.extend(std::iter::repeat_n(' ', spaces));
    }
}

/// Text as it may stand in an attribute or between tags.
pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\t' | '\n' | '\r' => {
                let _ = write!(out, "&#{};", u32::from(character));
            }
            other => out.push(other),
        }
    }
    out
}

/// Whether XML 1.0 can hold the character (section 2.2).
pub(crate) fn is_xml_char(character: char) -> bool {
    !matches!(character, '\0'..='\u{8}' | '\u{b}' | '\u{c}' | '\u{e}'..='\u{1f}' | '\u{fffe}' | '\u{ffff}')
}

/// The shortest decimal text that reads back as the same number.
pub(crate) fn number(value: f64) -> String {
    let text = format!("{value:?}");
    match text.strip_suffix(".0") {
        Some(whole) => whole.to_owned(),
        None => text,
    }
}

/// Numbers separated by spaces.
pub(crate) fn numbers(values: &[f64]) -> String {
    let texts: Vec<String> = values.iter().copied().map(number).collect();
    texts.join(" ")
}

/// The components of a vector.
pub(super) fn vector(v: &Vector3<f64>) -> String {
    numbers(v.as_slice())
}

/// A quaternion (w, x, y, z).
pub(super) fn quaternion(q: &UnitQuaternion<f64>) -> String {
    numbers(&[q.w, q.i, q.j, q.k])
}

/// A colour to a thousandth: closer than a step of 1/255.
pub(super) fn rgba(color: [u8; 3]) -> String {
    let [r, g, b] = color.map(|channel| (f64::from(channel) / 0.255).round() / 1000.0);
    numbers(&[r, g, b, 1.0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_back_as_they_were() {
        for value in [0.0, 1.0, -0.1, 1e-300, 1e300, 0.1 + 0.2, 24.166666666667] {
            assert_eq!(number(value).parse(), Ok(value));
        }
        assert_eq!(numbers(&[0.0, 500.0, 1e-7]), "0 500 1e-7");
    }

    #[test]
    fn names_with_signs_of_xml_stay_names() {
        let mut xml = XmlWriter::default();
        let name = "a<b> & \"c\"\n'd'";
        xml.leaf("x", &[("name", name.to_owned())]);
        let text = xml.finish();
        let document = roxmltree::Document::parse(&text).expect("well-formed");
        assert_eq!(document.root_element().attribute("name"), Some(name));
    }
}
