//! An unknown as a fit seeks it.

use super::coordinate::Coordinate;
use super::least_squares::Limit;
use crate::robot::Values;

/// What an unknown is called, and where its value is sought.
pub(super) struct Sought {
    pub name: String,
    /// The name of the unknowns that it is one of, if they have one.
    pub group: Option<&'static str>,
    pub unit: &'static str,
    /// The values that it can have.
    pub values: Values,
    /// Where the fit starts.
    pub first: f64,
    /// The number that the minimisation moves in its place.
    pub coordinate: Coordinate,
    /// How far that number may go, wherever the bounds are.
    pub widest: Limit,
    /// Smallest and largest value.
    pub bounds: [f64; 2],
}

impl Sought {
    /// The value at a coordinate.
    pub fn value(&self, x: f64) -> f64 {
        let [low, high] = self.bounds;
        self.coordinate.value(x).max(low).min(high)
    }

    /// How far its coordinate may go.
    pub fn limit(&self) -> Limit {
        let [low, high] = self.bounds.map(|value| self.coordinate.of(value));
        let Limit { range, reach } = self.widest;
        Limit {
            range: [low.max(range[0]), high.min(range[1])],
            reach,
        }
    }
}
