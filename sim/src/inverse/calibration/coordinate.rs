//! The coordinate in which an unknown is sought.

use super::Unknown;

/// Maps an unknown's value to the number that the minimisation moves, and back.
///
/// Sizes range over orders of magnitude, and their effects with them: far from its first value `v0` a
/// stiffness acts by its logarithm, or by its inverse. They are sought as `u = asinh(v / v0)`, which is a
/// logarithm far above `v0` and linear below, so that zero can be reached. Places of holes are
/// sought as they are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coordinate {
    /// `v0`; `None` for a value that is its own coordinate.
    unit: Option<f64>,
    /// The first value, of places too.
    pub first: f64,
}

impl Coordinate {
    /// The coordinate of `unknown`, for a first value.
    pub fn new(unknown: &Unknown, first: f64) -> Self {
        Self {
            first,
            unit: (unknown.is_size() && first > 0.0).then_some(first),
        }
    }

    /// The coordinate of a value.
    pub fn of(&self, value: f64) -> f64 {
        self.unit.map_or(value, |unit| (value / unit).asinh())
    }

    /// The value at a coordinate.
    pub fn value(&self, u: f64) -> f64 {
        self.unit.map_or(u, |unit| unit * u.sinh())
    }

    /// The value's derivative by its coordinate.
    pub fn slope(&self, u: f64) -> f64 {
        self.unit.map_or(1.0, |unit| unit * u.cosh())
    }

    /// How far one step of the minimisation may move the coordinate: a size by about its own.
    pub fn reach(&self) -> f64 {
        self.unit.map_or(f64::INFINITY, |_| 1.0)
    }
}
