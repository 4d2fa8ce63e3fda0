//! Why a robot specification is refused.

use thiserror::Error;

/// Why a robot specification is not valid.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum SpecError {
    /// An angle of more than a turn, likely meant in degrees.
    #[error(
        "robot field `{field}` is {value}; expected radians, -2 pi to 2 pi (degrees go into \
         `{degrees}` in its place)"
    )]
    Degrees {
        /// The field's path, e.g. `base.holes.angles`.
        field: String,
        /// The angle found.
        value: f64,
        /// The field that takes degrees in its place.
        degrees: &'static str,
    },
    /// A field has a value that no robot can have.
    #[error("robot field `{field}` is {value}; expected {expected}")]
    Field {
        /// The field's path, e.g. `modules[1].radius`.
        field: String,
        /// The value found.
        value: String,
        /// What would be right.
        expected: &'static str,
    },
}

pub(super) fn refuse(field: &str, value: impl ToString, expected: &'static str) -> SpecError {
    SpecError::Field {
        field: field.to_owned(),
        value: value.to_string(),
        expected,
    }
}
