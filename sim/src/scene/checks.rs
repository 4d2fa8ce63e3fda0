//! What numbers of a scene must be.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::SceneError;
use super::error::refuse;

/// Largest length and coordinate (m).
pub(crate) const LARGEST_LENGTH: f64 = 1e6;
/// Largest component of a velocity (m/s or rad/s).
pub(crate) const LARGEST_SPEED: f64 = 1e4;
/// Largest mass (kg): rapier's contacts hold no heavier ones.
const LARGEST_MASS: f64 = 1e9;
/// Largest of all other quantities, in SI units: products of several such do not overflow.
const LARGEST: f64 = 1e15;

/// A length (m).
pub(super) fn length(obstacle: &str, field: &str, value: f64) -> Result<(), SceneError> {
    match value > 0.0 && value <= LARGEST_LENGTH {
        true => Ok(()),
        false => Err(refuse(
            obstacle,
            field,
            value,
            "a length above 0, at most 1e6 m",
        )),
    }
}

/// A point (m).
pub(super) fn point(obstacle: &str, field: &str, value: &[f64; 3]) -> Result<(), SceneError> {
    let expected = "finite coordinates of at most 1e6 m";
    within(obstacle, field, value, LARGEST_LENGTH, expected)
}

/// Three numbers that are `largest` at most.
fn within(
    obstacle: &str,
    field: &str,
    value: &[f64; 3],
    largest: f64,
    expected: &'static str,
) -> Result<(), SceneError> {
    match value.iter().all(|x| x.abs() <= largest) {
        true => Ok(()),
        false => Err(refuse(obstacle, field, format!("{value:?}"), expected)),
    }
}

/// A quantity that may be 0.
pub(super) fn not_negative(obstacle: &str, field: &str, value: f64) -> Result<(), SceneError> {
    match is_compliance(value) {
        true => Ok(()),
        false => Err(refuse(obstacle, field, value, "a number from 0 to 1e15")),
    }
}

/// Whether a surface may give way so far for each newton (m/N).
pub(super) fn is_compliance(value: f64) -> bool {
    (0.0..=LARGEST).contains(&value)
}

/// A quantity above 0.
pub(super) fn positive(obstacle: &str, field: &str, value: f64) -> Result<(), SceneError> {
    match value > 0.0 && value <= LARGEST {
        true => Ok(()),
        false => Err(refuse(
            obstacle,
            field,
            value,
            "a number above 0, at most 1e15",
        )),
    }
}

/// The mass of an object (kg).
pub(super) fn mass(obstacle: &str, value: f64) -> Result<(), SceneError> {
    match value > 0.0 && value <= LARGEST_MASS {
        true => Ok(()),
        false => Err(refuse(
            obstacle,
            "mass",
            value,
            "a mass above 0, at most 1e9 kg",
        )),
    }
}

/// A quaternion (w, x, y, z), normalised.
pub(super) fn orientation(
    obstacle: &str,
    [w, x, y, z]: [f64; 4],
) -> Result<UnitQuaternion<f64>, SceneError> {
    let numbers = [w, x, y, z];
    let finite = numbers.iter().all(|x| x.abs() <= LARGEST);
    match finite && numbers.iter().any(|x| x.abs() >= 1e-6) {
        true => Ok(normalised(Quaternion::new(w, x, y, z))),
        false => {
            let value = format!("{numbers:?}");
            let expected = "a quaternion (w, x, y, z), not all 0";
            Err(refuse(obstacle, "orientation", value, expected))
        }
    }
}

/// A quaternion of length 1. One that has it to rounding stays what it is, so that a scene that is written and read again
/// is the same to the last bit.
fn normalised(quaternion: Quaternion<f64>) -> UnitQuaternion<f64> {
    match (quaternion.norm() - 1.0).abs() <= 4.0 * f64::EPSILON {
        true => UnitQuaternion::new_unchecked(quaternion),
        false => UnitQuaternion::from_quaternion(quaternion),
    }
}

/// Whether three numbers are a direction: finite, of usual size, and not all next to 0.
pub(super) fn is_direction(axis: &[f64; 3]) -> bool {
    axis.iter().all(|x| x.abs() <= LARGEST) && axis.iter().any(|x| x.abs() >= 1e-6)
}

/// Components of a velocity (m/s or rad/s).
pub(super) fn velocity(obstacle: &str, field: &str, value: &[f64; 3]) -> Result<(), SceneError> {
    let expected = "finite components of at most 1e4";
    within(obstacle, field, value, LARGEST_SPEED, expected)
}

/// A pose by a position (m) and a quaternion (w, x, y, z).
pub(super) fn pose(
    obstacle: &str,
    position: [f64; 3],
    quaternion: [f64; 4],
) -> Result<Isometry3<f64>, SceneError> {
    point(obstacle, "position", &position)?;
    let rotation = orientation(obstacle, quaternion)?;
    Ok(Isometry3::from_parts(
        Translation3::from(position),
        rotation,
    ))
}
