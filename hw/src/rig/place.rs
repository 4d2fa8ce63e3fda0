//! Where a field stands in a TOML file.

use toml::de::{DeTable, DeValue};

/// Line, from 1, of the field at a path such as `cameras[1].link`, or of the innermost table on the way there that the text
/// has; `None` where not even the first step is there.
pub(super) fn line_of(text: &str, field: &str) -> Option<usize> {
    let table = DeTable::parse(text).ok()?;
    let mut found = None;
    let mut value: Option<&DeValue> = None;
    for step in steps(field) {
        let next = match (step, value) {
            (Step::Key(key), None) => table.get_ref().get(key),
            (Step::Key(key), Some(DeValue::Table(table))) => table.get(key),
            (Step::Index(index), Some(DeValue::Array(list))) => list.get(index),
            _ => None,
        };
        let Some(next) = next else { break };
        found = Some(next.span().start);
        value = Some(next.get_ref());
    }
    found.map(|start| 1 + text[..start].matches('\n').count())
}

enum Step<'a> {
    Key(&'a str),
    Index(usize),
}

fn steps(field: &str) -> impl Iterator<Item = Step<'_>> {
    field.split('.').flat_map(|part| {
        let mut pieces = part.split('[');
        let key = pieces.next().map(Step::Key);
        let indices = pieces.filter_map(|piece| piece.trim_end_matches(']').parse().ok());
        key.into_iter().chain(indices.map(Step::Index))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_have_the_lines_at_which_they_stand() {
        let text = "name = \"a\"\n\n[servos]\nids = [\n  1,\n  2,\n]\n\n[[cameras]]\n\n[[cameras]]\nlink = \"x\"\n";
        for (field, line) in [
            ("name", Some(1)),
            ("servos", Some(3)),
            ("servos.ids", Some(4)),
            ("servos.ids[1]", Some(6)),
            ("servos.radius", Some(3)),
            ("cameras[1].link", Some(12)),
            ("cameras[1].serial", Some(11)),
            ("masks.box", None),
        ] {
            assert_eq!(line_of(text, field), line, "{field}");
        }
    }
}
