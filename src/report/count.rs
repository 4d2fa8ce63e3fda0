//! Numbers of things, in words.

/// A number and what it counts: `1 tip`, `2 tips`. For things whose plural ends in s.
pub fn counted(count: usize, thing: &str) -> String {
    match count {
        1 => format!("1 {thing}"),
        _ => format!("{count} {thing}s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_thing_is_no_plural() {
        let tips = [0, 1, 2].map(|count| counted(count, "tip"));
        assert_eq!(tips, ["0 tips", "1 tip", "2 tips"]);
    }
}
