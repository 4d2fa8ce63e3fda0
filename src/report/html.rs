//! Text for HTML: escaping, templates, numbers, base64.

/// What the page says where a value is missing or not finite.
pub(crate) const NOT_AVAILABLE: &str = "not available";

/// Text as HTML content or as a quoted attribute's value.
pub(crate) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            other => escaped.push(other),
        }
    }
    escaped
}

/// Replaces each `{{name}}` of a template by the value of that name, in one pass: values are not
/// searched for names. A name without a value is replaced by nothing.
pub(crate) fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut page = String::new();
    let mut rest = template;
    while let Some((before, (name, after))) = rest
        .split_once("{{")
        .and_then(|(before, tail)| Some((before, tail.split_once("}}")?)))
    {
        page += before;
        if let Some((_, value)) = values.iter().find(|(key, _)| *key == name) {
            page += value;
        }
        rest = after;
    }
    page + rest
}

/// A number with that many digits after the point.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    if value.is_finite() {
        format!("{value:.decimals$}")
    } else {
        NOT_AVAILABLE.to_owned()
    }
}

/// Digits after the point with which a column's smallest magnitude has two significant digits, at
/// most six.
pub(crate) fn column_decimals(column: impl IntoIterator<Item = f64>) -> usize {
    column
        .into_iter()
        .map(f64::abs)
        .filter(|&x| x.is_finite() && x > 0.0)
        .map(|x| (1.0 - x.log10().floor()).clamp(0.0, 6.0) as usize)
        .max()
        .unwrap_or(1)
}

/// A duration (s) in the units in which one would say it.
pub(crate) fn duration(seconds: f64) -> String {
    let whole = seconds.round();
    if !seconds.is_finite() {
        NOT_AVAILABLE.to_owned()
    } else if seconds < 9.95 {
        format!("{seconds:.1} s")
    } else if whole < 60.0 {
        format!("{whole} s")
    } else if whole < 3600.0 {
        format!("{} min {:02} s", (whole / 60.0).floor(), whole % 60.0)
    } else {
        let minutes = (seconds / 60.0).round();
        format!("{} h {:02} min", (minutes / 60.0).floor(), minutes % 60.0)
    }
}

/// Base64 of RFC 4648, with padding. By hand: no other part of the build needs a crate for it, and it is a loop with known answers
/// in the test below.
pub(crate) fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let byte = |k: usize| u32::from(chunk.get(k).copied().unwrap_or(0));
        let group = byte(0) << 16 | byte(1) << 8 | byte(2);
        for digit in 0..4 {
            text.push(if digit <= chunk.len() {
                char::from(ALPHABET[(group >> (18 - 6 * digit)) as usize & 63])
            } else {
                '='
            });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_agrees_with_the_vectors_of_rfc_4648() {
        let texts = ["", "f", "fo", "foo", "foob", "fooba", "foobar"];
        let codes = [
            "", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy",
        ];
        assert_eq!(texts.map(|text| base64(text.as_bytes())), codes);
    }

    #[test]
    fn values_of_a_template_are_not_searched_for_names() {
        let page = fill("<{{a}}|{{b}}|{{c}}>", &[("a", "{{b}}"), ("b", "x")]);
        assert_eq!(page, "<{{b}}|x|>");
    }

    #[test]
    fn columns_keep_two_significant_digits_of_their_smallest_number() {
        assert_eq!(column_decimals([0.027, 0.33, 30.12]), 3);
        assert_eq!(column_decimals([2.4, 46.1]), 1);
        assert_eq!(column_decimals([120.0, f64::NAN, 0.0]), 0);
    }

    #[test]
    fn durations_are_said_in_fitting_units() {
        let said = [0.04, 12.3, 59.7, 754.0, 3599.7, 7260.0].map(duration);
        let expected = [
            "0.0 s",
            "12 s",
            "1 min 00 s",
            "12 min 34 s",
            "1 h 00 min",
            "2 h 01 min",
        ];
        assert_eq!(said, expected);
    }
}
