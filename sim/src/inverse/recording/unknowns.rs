//! The unknowns of a fit, from the rows of the table.

use super::facts::Facts;
use super::numbers::Numbers;
use super::places::At;
use super::table::{Row, TABLE};
use super::{Group, RecordingError};
use crate::inverse::coordinate::Coordinate;
use crate::robot::Values;

/// An unknown, and what is known of it before: in its coordinate `x` it has a normal distribution of mean 0 and standard deviation
/// 1. Numbers above 0 are sought by their logarithm.
pub(super) struct Unknown {
    pub name: String,
    pub unit: &'static str,
    pub row: &'static Row,
    at: At,
    coordinate: Coordinate,
    /// Smallest and largest value.
    bounds: [f64; 2],
}

/// Coordinates are sought within so many standard deviations.
const WIDEST: f64 = 20.0;

/// The unknowns of a fit.
///
/// # Errors
/// [`RecordingError::Group`] for a group that the robot has not.
pub(super) fn unknowns(facts: &Facts) -> Result<Vec<Unknown>, RecordingError> {
    let mut all = Vec::new();
    for (place, &group) in facts.groups.iter().enumerate() {
        if facts.groups[..place].contains(&group) {
            continue;
        }
        if let Some(reason) = group.missing(facts.spec(), facts.recording.order) {
            return Err(RecordingError::Group { group, reason });
        }
        for row in TABLE.iter().filter(|row| row.group == group) {
            let unknown = |at| Unknown::new(row, at, facts);
            all.extend(facts.places(row.each).into_iter().map(unknown));
        }
    }
    Ok(all)
}

impl Unknown {
    fn new(row: &'static Row, at: At, facts: &Facts) -> Self {
        let values = row.quantity.values;
        let mut unknown = Self {
            name: row.name(at),
            unit: facts.unit(row.quantity.unit, row.spread, at),
            row,
            at,
            coordinate: Coordinate::SAME,
            bounds: match values {
                // A logarithm keeps to its side of 0 by itself.
                Values::Positive => [f64::NEG_INFINITY, f64::INFINITY],
                Values::Any | Values::NotNegative => [values.least(), f64::INFINITY],
            },
        };
        unknown.believe(facts, None, None);
        unknown
    }

    /// Gives it the prior of the table, with another mean or standard deviation where one is given.
    pub fn believe(&mut self, facts: &Facts, mean: Option<f64>, spread: Option<f64>) {
        let (row, at) = (self.row, self.at);
        let spread = spread.unwrap_or_else(|| facts.spread(row.spread, at));
        let first = mean.unwrap_or_else(|| {
            let first = (row.first)(facts, at);
            match row.quantity.values {
                Values::NotNegative => first.max(0.5 * spread),
                Values::Any | Values::Positive => first,
            }
        });
        self.coordinate = match row.quantity.values {
            Values::Positive => Coordinate::Logarithmic { first, spread },
            Values::Any | Values::NotNegative => Coordinate::Linear { first, spread },
        };
    }

    /// Keeps it within bounds.
    pub fn confine(&mut self, bounds: [f64; 2]) {
        self.bounds = bounds;
    }

    /// The value at a coordinate.
    pub fn value(&self, x: f64) -> f64 {
        let [low, high] = self.bounds;
        self.coordinate.value(x).max(low).min(high)
    }

    /// Smallest and largest coordinate.
    pub fn range(&self) -> [f64; 2] {
        let [low, high] = self.bounds.map(|value| self.coordinate.of(value));
        [low.max(-WIDEST), high.min(WIDEST)]
    }

    /// Whether it changes the robot, and not only what lies between it and the recording.
    pub fn is_of_robot(&self) -> bool {
        self.row.is_of_robot()
    }

    pub fn group(&self) -> Group {
        self.row.group
    }

    /// Gives the robot, or the transmission, this unknown's value at `x`.
    pub fn set(&self, x: f64, numbers: &mut Numbers) {
        (self.row.set)(numbers, self.at, self.value(x));
    }
}
