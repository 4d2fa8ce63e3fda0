//! XML whose nesting and size are bounded before it is parsed.

use roxmltree::{Document, ParsingOptions};

/// Most attributes of one element: parsers compare each with all others. MuJoCo knows about 60.
const MOST_ATTRIBUTES: usize = 256;
/// Most elements and texts between them: that of 1000 discs with all their holes is a tenth of it.
const MOST_NODES: u32 = 2_000_000;

/// Parses a text in which elements nest at most `deepest` deep.
///
/// # Errors
/// What is wrong, and where.
pub(crate) fn parse(text: &str, deepest: usize) -> Result<Document<'_>, String> {
    check_bounds(text, deepest)?;
    let options = ParsingOptions {
        nodes_limit: MOST_NODES,
        ..ParsingOptions::default()
    };
    Document::parse_with_options(text, options).map_err(|e| e.to_string())
}

/// Refuses texts on which a parser would take long, or overflow its stack. A text that is not
/// well-formed may pass: that is for the parser to say.
fn check_bounds(text: &str, deepest: usize) -> Result<(), String> {
    let (mut at, mut depth) = (0, 0_usize);
    let line = |at: usize| 1 + text[..at].matches('\n').count();
    while let Some(begin) = text[at..].find('<') {
        at += begin;
        let rest = &text[at..];
        if let Some(length) = length_without_elements(rest) {
            at += length;
            continue;
        }
        let tag = Tag::at(rest);
        if tag.attributes > MOST_ATTRIBUTES {
            let (line, found) = (line(at), tag.attributes);
            return Err(format!(
                "line {line}: an element of {found} attributes; expected at most {MOST_ATTRIBUTES}"
            ));
        }
        if tag.closes {
            depth = depth.saturating_sub(1);
        } else if !tag.is_empty {
            depth += 1;
        }
        if depth > deepest {
            let line = line(at);
            return Err(format!(
                "line {line}: elements nest more than {deepest} deep; expected less"
            ));
        }
        at += tag.length;
    }
    Ok(())
}

/// Length of the comment, CDATA section or processing instruction that `text` begins with, if any.
fn length_without_elements(text: &str) -> Option<usize> {
    let [_, end] = [["<!--", "-->"], ["<![CDATA[", "]]>"], ["<?", "?>"]]
        .into_iter()
        .find(|[begin, _]| text.starts_with(begin))?;
    Some(text.find(end).map_or(text.len(), |at| at + end.len()))
}

/// What stands between `<` and `>`.
struct Tag {
    length: usize,
    attributes: usize,
    /// Whether it ends an element.
    closes: bool,
    /// Whether it is an element by itself.
    is_empty: bool,
}

impl Tag {
    /// The tag that `text` begins with.
    fn at(text: &str) -> Self {
        let bytes = text.as_bytes();
        let (mut quote, mut attributes, mut end) = (None, 0, bytes.len());
        for (index, &byte) in bytes.iter().enumerate() {
            match (quote, byte) {
                (Some(open), _) if byte == open => quote = None,
                (Some(_), _) => {}
                (None, b'"' | b'\'') => quote = Some(byte),
                (None, b'=') => attributes += 1,
                (None, b'>') => {
                    end = index + 1;
                    break;
                }
                (None, _) => {}
            }
        }
        Self {
            length: end,
            attributes,
            closes: text.starts_with("</"),
            is_empty: text[..end].ends_with("/>"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nesting_and_attributes_are_counted_where_they_are_and_nowhere_else() {
        let text = "<?pi <a><a>?><a x='>' y=\"/>='\"><!-- <a><a> --><b/><c>\
                    <![CDATA[<a><a>]]></c></a>";
        assert!(check_bounds(text, 2).is_ok());
        assert!(check_bounds(text, 1).is_err());
        let many = |count: usize| {
            let attributes = (0..count).map(|i| format!(" a{i}='='"));
            format!("<x>\n<y{}/></x>", attributes.collect::<String>())
        };
        assert!(check_bounds(&many(MOST_ATTRIBUTES), 2).is_ok());
        let said = check_bounds(&many(MOST_ATTRIBUTES + 1), 2).expect_err("too many");
        assert!(said.starts_with("line 2: an element of 257 attributes"));
    }
}
