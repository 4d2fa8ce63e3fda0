//! What is wrong with a setting of the flow.

/// A flow setting out of bounds.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field} is {found}, expected {expected}")]
pub struct FlowError {
    /// The setting.
    pub field: &'static str,
    /// Its value.
    pub found: String,
    /// What would be right.
    pub expected: &'static str,
}

/// Returns an error unless `found` is `accepted`.
pub(super) fn require(
    accepted: bool,
    field: &'static str,
    found: impl ToString,
    expected: &'static str,
) -> Result<(), FlowError> {
    if accepted {
        Ok(())
    } else {
        Err(FlowError {
            field,
            found: found.to_string(),
            expected,
        })
    }
}
