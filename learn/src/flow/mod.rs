//! Flow matching: the straight path from prior to data and how they are coupled, random streams, and the sampler that
//! integrates a learned flow.

mod coupling;
mod multistep;
mod path;
mod random;
mod sampler;
mod time_grid;

pub use coupling::Coupling;
pub use path::FlowPath;
pub use random::{Stream, rng};
pub use sampler::{Method, Sampler, VelocityField};
pub use time_grid::TimeGrid;

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

/// Refuses `found` unless it is `accepted`.
fn require(
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
