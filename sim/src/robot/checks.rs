//! What numbers of a robot file must be.

use std::f64::consts::TAU;

use super::spec_error::{SpecError, refuse};

/// No quantity of a robot in SI units comes near, and products of several such do not overflow.
pub(super) const LARGEST: f64 = 1e15;

/// Refuses values whose magnitude is above `limit`.
pub(super) fn at_most(
    limit: f64,
    field: &str,
    values: &[f64],
    expected: &'static str,
) -> Result<(), SpecError> {
    match values.iter().find(|value| value.abs() > limit) {
        Some(value) => Err(refuse(field, format!("{value:e}"), expected)),
        None => Ok(()),
    }
}

pub(super) fn finite(field: &str, values: &[f64]) -> Result<(), SpecError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(value) => Err(refuse(field, value, "finite numbers")),
        None => at_most(LARGEST, field, values, "numbers of at most 1e15"),
    }
}

/// Angles within a turn either way: what is more was meant in degrees, which the field `degrees`
/// would take.
pub(super) fn radians(field: &str, values: &[f64], degrees: &'static str) -> Result<(), SpecError> {
    finite(field, values)?;
    // A turn may have been rounded.
    let within = |angle: &&f64| angle.abs() > TAU + 1e-3;
    let Some(angle) = values.iter().find(within) else {
        return Ok(());
    };
    Err(SpecError::Degrees {
        field: field.to_owned(),
        value: *angle,
        degrees,
    })
}

pub(super) fn positive(field: &str, value: f64) -> Result<(), SpecError> {
    if value.is_finite() && value > 0.0 {
        at_most(LARGEST, field, &[value], "a number above 0 of at most 1e15")
    } else {
        Err(refuse(field, value, "a finite number above 0"))
    }
}

pub(super) fn not_negative(field: &str, value: f64) -> Result<(), SpecError> {
    if value.is_finite() && value >= 0.0 {
        at_most(LARGEST, field, &[value], "a number from 0 to 1e15")
    } else {
        Err(refuse(field, value, "a finite number, 0 or above"))
    }
}
