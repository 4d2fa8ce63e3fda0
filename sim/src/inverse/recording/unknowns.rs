//! The unknowns of a fit, from the rows of the table.

use super::facts::Facts;
use super::numbers::Numbers;
use super::places::At;
use super::table::{Row, TABLE};
use super::{Group, RecordingError};
use crate::inverse::coordinate::Coordinate;
use crate::inverse::least_squares::Limit;
use crate::inverse::priors::{PriorError, Priors};
use crate::inverse::sought::Sought;
use crate::robot::Values;

/// An unknown, and what is known of it before: in its coordinate `x` it has a normal distribution of mean 0 and standard deviation
/// 1. Numbers above 0 are sought by their logarithm.
pub(super) struct Unknown {
    pub sought: Sought,
    pub row: &'static Row,
    at: At,
}

/// Coordinates are sought within so many standard deviations of their priors, in steps of at most so many.
const WIDEST: Limit = Limit {
    range: [-20.0, 20.0],
    reach: 3.0,
};

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

/// Gives the unknowns the priors and bounds of a user; what those do not say is as in the table.
///
/// # Errors
/// [`PriorError`] for an entry that is of none of them, or that its unknown cannot have.
pub(super) fn believe(
    priors: &Priors,
    unknowns: &mut [Unknown],
    facts: &Facts,
) -> Result<(), PriorError> {
    let all: Vec<&Sought> = unknowns.iter().map(|unknown| &unknown.sought).collect();
    priors.check_names(&all)?;
    for Unknown { sought, row, at } in unknowns {
        let given = priors.of(sought)?;
        (sought.first, sought.coordinate) = prior(row, *at, facts, given.value, given.spread);
        given.confine(sought)?;
    }
    Ok(())
}

/// Where an unknown starts and is sought by the prior of the table, with another mean or standard deviation where one is given.
fn prior(
    row: &Row,
    at: At,
    facts: &Facts,
    mean: Option<f64>,
    spread: Option<f64>,
) -> (f64, Coordinate) {
    let values = row.quantity.values;
    let spread = spread.unwrap_or_else(|| facts.spread(row.spread, at));
    let first = mean.unwrap_or_else(|| {
        let first = (row.first)(facts, at);
        match values {
            Values::NotNegative => first.max(0.5 * spread),
            Values::Any | Values::Positive => first,
        }
    });
    let coordinate = match values {
        Values::Positive => Coordinate::Logarithmic { first, spread },
        Values::Any | Values::NotNegative => Coordinate::Linear { first, spread },
    };
    (first, coordinate)
}

impl Unknown {
    fn new(row: &'static Row, at: At, facts: &Facts) -> Self {
        let values = row.quantity.values;
        let (first, coordinate) = prior(row, at, facts, None, None);
        let sought = Sought {
            name: row.name(at),
            group: Some(row.group.name()),
            unit: facts.unit(row.quantity.unit, row.spread, at),
            values,
            first,
            coordinate,
            widest: WIDEST,
            bounds: [values.least(), f64::INFINITY],
        };
        Self { sought, row, at }
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
        (self.row.set)(numbers, self.at, self.sought.value(x));
    }
}
