//! Text without control characters, safe to show on a terminal.

use std::io::Write;

/// The text with control characters as escapes (`\u001b`, as JSON has them), all but line breaks and tabs; also those
/// that turn the direction of writing. Names, notes and paths come from files, and may hold such.
pub(super) fn printable(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '\n' | '\t' => shown.push(character),
            '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => escape(character, &mut shown),
            _ if character.is_control() => escape(character, &mut shown),
            _ => shown.push(character),
        }
    }
    shown
}

fn escape(character: char, shown: &mut String) {
    shown.push_str(&format!("\\u{:04x}", u32::from(character)));
}

/// Writes a line to stderr. One that cannot be written is dropped: there is nowhere to say so, and the work goes on.
pub(super) fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{}", printable(line));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_would_obey_is_shown_as_an_escape() {
        assert_eq!(
            printable("a\x1b[31mred\u{9b}2J\u{7f}\r\u{202e}b"),
            "a\\u001b[31mred\\u009b2J\\u007f\\u000d\\u202eb"
        );
        assert_eq!(printable("m², µs\n\t1"), "m², µs\n\t1");
    }
}
