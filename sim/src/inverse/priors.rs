//! What is known of unknowns before a fit, where it is not what the robot says.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::sought::Sought;
use crate::robot::Values;

/// Where this share of a prior's standard deviation is left, the measurements say little of the unknown.
pub(super) const LITTLE: f64 = 0.7;

/// Priors and bounds, by the names of unknowns; in a fit of a recording also by those of groups, where an unknown's own entry
/// goes before its group's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Priors(pub BTreeMap<String, Prior>);

/// What is known of an unknown.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prior {
    /// Mean of the prior, where the fit starts (in the unknown's unit).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Standard deviation of the prior (in the unknown's unit; of a recording's factors and gains a share of the value).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spread: Option<f64>,
    /// Smallest and largest value (in the unknown's unit).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<[f64; 2]>,
    /// The unit that these are in, which is only compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// A prior of no unknown, or one that its unknown cannot have.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{key}: {reason}")]
pub struct PriorError {
    /// The name of its entry, and the field.
    pub key: String,
    /// What is wrong with it, and what would be right.
    pub reason: String,
}

/// What the entries of an unknown say.
pub(super) struct Given<'a> {
    pub value: Option<f64>,
    pub spread: Option<f64>,
    /// With the name of their entry.
    bounds: Option<(&'a str, [f64; 2])>,
}

impl Priors {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Refuses entries that are of none of the unknowns, and those of a group whose unknowns have not one unit.
    pub(super) fn check_names(&self, unknowns: &[&Sought]) -> Result<(), PriorError> {
        self.0
            .keys()
            .try_for_each(|name| check_name(name, unknowns))
    }

    /// What is said of an unknown.
    ///
    /// # Errors
    /// [`PriorError`] for a unit, spread or value that it cannot have.
    pub(super) fn of(&self, unknown: &Sought) -> Result<Given<'_>, PriorError> {
        let (values, own) = (unknown.values, unknown.unit);
        if let Some((entry, unit)) = self.find(unknown, |prior| prior.unit.as_deref())
            && unit != own
        {
            let reason = format!("{unit:?} is not its unit, which is {own:?}");
            return Err(PriorError::of(entry, "unit", reason));
        }
        let spread = self.find(unknown, |prior| prior.spread);
        if let Some((entry, spread)) = spread
            && !Values::Positive.contain(spread)
        {
            let reason = format!("{spread} is no spread; expected {}", Values::Positive);
            return Err(PriorError::of(entry, "spread", reason));
        }
        let value = self.find(unknown, |prior| prior.value);
        if let Some((entry, value)) = value
            && !values.contain(value)
        {
            let reason = format!("{value} cannot be its value; expected {values}");
            return Err(PriorError::of(entry, "value", reason));
        }
        Ok(Given {
            value: value.map(|found| found.1),
            spread: spread.map(|found| found.1),
            bounds: self.find(unknown, |prior| prior.bounds),
        })
    }

    /// What an unknown's own entry, or else its group's, has of a field, with the name of the entry.
    fn find<'a, T>(
        &'a self,
        unknown: &Sought,
        field: impl Fn(&'a Prior) -> Option<T>,
    ) -> Option<(&'a str, T)> {
        let entries = [Some(unknown.name.as_str()), unknown.group];
        (entries.into_iter().flatten()).find_map(|entry| {
            let (entry, prior) = self.0.get_key_value(entry)?;
            Some((entry.as_str(), field(prior)?))
        })
    }
}

impl Given<'_> {
    /// Keeps an unknown within the bounds given, in which its first value must be.
    ///
    /// # Errors
    /// [`PriorError`] for bounds that it cannot have.
    pub fn confine(&self, unknown: &mut Sought) -> Result<(), PriorError> {
        let Some((entry, bounds)) = self.bounds else {
            return Ok(());
        };
        match out_of_bounds(unknown, bounds) {
            Some(reason) => Err(PriorError::of(entry, "bounds", reason)),
            None => {
                unknown.bounds = bounds;
                Ok(())
            }
        }
    }
}

impl PriorError {
    /// Of a field of an entry.
    pub(super) fn of(entry: &str, field: &str, reason: impl Into<String>) -> Self {
        Self {
            key: format!("{}.{field}", quoted(entry)),
            reason: reason.into(),
        }
    }

    fn of_entry(entry: &str, reason: String) -> Self {
        Self {
            key: quoted(entry),
            reason,
        }
    }
}

/// What is wrong with bounds of an unknown.
fn out_of_bounds(unknown: &Sought, [low, high]: [f64; 2]) -> Option<String> {
    let (values, first) = (unknown.values, unknown.first);
    if !(values.contain(low) && values.contain(high) && low < high) {
        return Some(format!(
            "[{low}, {high}] are no bounds; expected the lower and the higher one, each {values}"
        ));
    }
    (!(low..=high).contains(&first)).then(|| {
        format!(
            "{first}, where the fit of `{}` starts, is not within [{low}, {high}]",
            unknown.name
        )
    })
}

fn check_name(name: &str, unknowns: &[&Sought]) -> Result<(), PriorError> {
    if unknowns.iter().any(|unknown| unknown.name == name) {
        return Ok(());
    }
    let own: Vec<&Sought> = (unknowns.iter().copied())
        .filter(|unknown| unknown.group == Some(name))
        .collect();
    let Some(first) = own.first() else {
        return Err(PriorError::of_entry(name, not_fitted(unknowns)));
    };
    match own.iter().find(|other| other.unit != first.unit) {
        None => Ok(()),
        Some(other) => {
            let reason = format!(
                "its unknowns have no common unit ({:?} of `{}`, {:?} of `{}`); expected them by name",
                first.unit, first.name, other.unit, other.name
            );
            Err(PriorError::of_entry(name, reason))
        }
    }
}

fn not_fitted(unknowns: &[&Sought]) -> String {
    let mut names: Vec<&str> = Vec::new();
    let groups = unknowns.iter().filter_map(|unknown| unknown.group);
    for name in groups.chain(unknowns.iter().map(|unknown| unknown.name.as_str())) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    match names.is_empty() {
        true => "nothing is fitted".to_owned(),
        false => format!(
            "nothing of this name is fitted; expected one of {}",
            names.join(", ")
        ),
    }
}

/// A name as a TOML file has it.
fn quoted(name: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
    match name.chars().all(plain) {
        true => name.to_owned(),
        false => format!("{name:?}"),
    }
}
