//! What is known of unknowns before a fit, where it is not what the table says.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::RecordingError;
use super::facts::Facts;
use super::unknowns::Unknown;
use crate::robot::Values;

/// Priors and bounds, by the name of a group or of an unknown as a fit has it ([`FittedUnknown`](super::FittedUnknown)). What an
/// unknown's own entry says goes before what its group's says, and that before the table.
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
    /// Standard deviation of the prior (in the unknown's unit; of factors and gains a share of the value).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spread: Option<f64>,
    /// Smallest and largest value (in the unknown's unit).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<[f64; 2]>,
    /// The unit that these are in, which is only compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

impl Priors {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Gives the unknowns their priors and bounds.
    ///
    /// # Errors
    /// [`RecordingError::Prior`] for an entry that is of none of them, or that its unknown cannot have.
    pub(super) fn apply(
        &self,
        unknowns: &mut [Unknown],
        facts: &Facts,
    ) -> Result<(), RecordingError> {
        for name in self.0.keys() {
            check_name(name, unknowns)?;
        }
        for unknown in unknowns {
            self.give(unknown, facts)?;
        }
        Ok(())
    }

    fn give(&self, unknown: &mut Unknown, facts: &Facts) -> Result<(), RecordingError> {
        let values = unknown.row.quantity.values;
        let own = unknown.unit;
        self.find(
            unknown,
            "unit",
            |prior| prior.unit.as_deref(),
            |unit| {
                let other = *unit != own;
                other.then(|| format!("{unit:?} is not its unit, which is {own:?}"))
            },
        )?;
        let spread = self.find(
            unknown,
            "spread",
            |prior| prior.spread,
            |spread| {
                let none = !Values::Positive.contain(*spread);
                none.then(|| format!("{spread} is no spread; expected {}", Values::Positive))
            },
        )?;
        let value = self.find(
            unknown,
            "value",
            |prior| prior.value,
            |value| {
                let none = !values.contain(*value);
                none.then(|| format!("{value} cannot be its value; expected {values}"))
            },
        )?;
        unknown.believe(facts, value, spread);
        let bounds = self.find(
            unknown,
            "bounds",
            |prior| prior.bounds,
            |bounds| out_of_bounds(unknown, *bounds),
        )?;
        if let Some(bounds) = bounds {
            unknown.confine(bounds);
        }
        Ok(())
    }

    /// What an unknown's own entry, or else its group's, has of a field, unless something is `wrong` with it.
    fn find<'a, T>(
        &'a self,
        unknown: &Unknown,
        field: &str,
        of: impl Fn(&'a Prior) -> Option<T>,
        wrong: impl Fn(&T) -> Option<String>,
    ) -> Result<Option<T>, RecordingError> {
        for entry in [unknown.name.as_str(), unknown.group().name()] {
            if let Some(found) = self.0.get(entry).and_then(&of) {
                return match wrong(&found) {
                    Some(reason) => refuse(format!("{}.{field}", quoted(entry)), reason),
                    None => Ok(Some(found)),
                };
            }
        }
        Ok(None)
    }
}

/// What is wrong with bounds of an unknown that has its prior.
fn out_of_bounds(unknown: &Unknown, [low, high]: [f64; 2]) -> Option<String> {
    let values = unknown.row.quantity.values;
    if !(values.contain(low) && values.contain(high) && low < high) {
        return Some(format!(
            "[{low}, {high}] are no bounds; expected the lower and the higher one, each {values}"
        ));
    }
    let first = unknown.value(0.0);
    (!(low..=high).contains(&first)).then(|| {
        format!(
            "{first}, where the fit of `{}` starts, is not within [{low}, {high}]",
            unknown.name
        )
    })
}

/// Refuses the name of no unknown and no group, and that of a group whose unknowns have not one unit.
fn check_name(name: &str, unknowns: &[Unknown]) -> Result<(), RecordingError> {
    if unknowns.iter().any(|unknown| unknown.name == name) {
        return Ok(());
    }
    let own: Vec<&Unknown> = (unknowns.iter())
        .filter(|unknown| unknown.group().name() == name)
        .collect();
    match own.first() {
        None => refuse(quoted(name), not_fitted(unknowns)),
        Some(first) => match own.iter().find(|other| other.unit != first.unit) {
            None => Ok(()),
            Some(other) => {
                let (a, b) = (first, other);
                refuse(
                    quoted(name),
                    format!(
                        "its unknowns have no common unit ({:?} of `{}`, {:?} of `{}`); expected them by name",
                        a.unit, a.name, b.unit, b.name
                    ),
                )
            }
        },
    }
}

fn not_fitted(unknowns: &[Unknown]) -> String {
    let mut names: Vec<&str> = Vec::new();
    let groups = unknowns.iter().map(|unknown| unknown.group().name());
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

fn refuse<T>(key: impl Into<String>, reason: String) -> Result<T, RecordingError> {
    let key = key.into();
    Err(RecordingError::Prior { key, reason })
}
