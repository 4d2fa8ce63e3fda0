//! What differs between two values that should be the same.

use serde::Serialize;
use serde_json::Value;

/// The first field in which two values differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Difference {
    /// Its path.
    pub what: String,
    pub found: String,
    pub expected: String,
}

/// Compares plain values, field by field; `what` is their name.
pub(super) fn require_same<T: Serialize>(
    what: &str,
    found: &T,
    expected: &T,
) -> Result<(), Difference> {
    // Through text, in which an f32 has as many digits as distinguish it from others.
    let [found, expected] = [found, expected].map(|value| {
        let text = serde_json::to_string(value).expect("plain values serialise");
        serde_json::from_str(&text).expect("what was written is read")
    });
    require_same_values(what, &found, &expected)
}

fn require_same_values(what: &str, found: &Value, expected: &Value) -> Result<(), Difference> {
    if let (Value::Object(found), Value::Object(expected)) = (found, expected) {
        return expected.iter().try_for_each(|(field, expected)| {
            let found = found.get(field).unwrap_or(&Value::Null);
            require_same_values(&format!("{what}.{field}"), found, expected)
        });
    }
    if found == expected {
        return Ok(());
    }
    Err(Difference {
        what: what.to_owned(),
        found: found.to_string(),
        expected: expected.to_string(),
    })
}
