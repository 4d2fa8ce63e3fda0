//! Entries `[[vary]]` of a study's file.

use serde::Deserialize;
use serde_json::Value;

use super::Sampled;
use super::variable::{Target, Variable};
use crate::report::Spacing;
use crate::study::error::Refusal;

/// Most values of one variable.
const MOST_VALUES: usize = 1_000_000;

/// A variable with its values, as the file has them.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::study) struct Vary {
    pub what: String,
    values: Option<Vec<Value>>,
    range: Option<[f64; 2]>,
    steps: Option<usize>,
    spacing: Option<SpacingInFile>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum SpacingInFile {
    Linear,
    Log,
}

impl Vary {
    /// The levels of the variable; `None` for one that is sampled.
    pub fn values(&self, key: &str, what: &Variable) -> Result<Option<Vec<Value>>, Refusal> {
        match (&self.values, self.range, self.steps) {
            (Some(values), None, None) => {
                if !(1..=MOST_VALUES).contains(&values.len()) {
                    let expected = format!("1 to {MOST_VALUES} values");
                    return Err(Refusal::value(
                        format!("{key}.values"),
                        values.len(),
                        expected,
                    ));
                }
                for (place, value) in values.iter().enumerate() {
                    let whole = value.as_u64().is_some();
                    if what.is_whole() && !whole {
                        let key = format!("{key}.values[{place}]");
                        return Err(Refusal::value(key, value, "a whole number"));
                    }
                }
                Ok(Some(values.clone()))
            }
            (None, Some(range), Some(steps)) => {
                if !(2..=MOST_VALUES).contains(&steps) {
                    let expected = format!("2 to {MOST_VALUES}, the two ends included");
                    return Err(Refusal::value(format!("{key}.steps"), steps, expected));
                }
                let spacing = self.checked_range(key, range)?;
                let level = |step: usize| {
                    let value = rounded(place_in(range, spacing, step as f64 / (steps - 1) as f64));
                    match what.is_whole() && value.fract() == 0.0 && value >= 0.0 {
                        true => Value::from(value as u64),
                        false => Value::from(value),
                    }
                };
                let values: Vec<Value> = (0..steps).map(level).collect();
                if let Some(value) = values.iter().find(|v| what.is_whole() && !v.is_u64()) {
                    let expected = format!(
                        "as many as make all values of `{what}` whole, which {value} is not"
                    );
                    return Err(Refusal::value(format!("{key}.steps"), steps, expected));
                }
                Ok(Some(values))
            }
            (None, Some(_), None) => Ok(None),
            (None, None, None) if what.target == Target::Command => Ok(None),
            _ => {
                let expected = "either `values = [...]`, or `range = [LOW, HIGH]` with `steps = N`, or `range` alone for \
                     a variable that is sampled (`command` needs none)";
                Err(Refusal::value(key, "neither", expected))
            }
        }
    }

    fn checked_range(&self, key: &str, range: [f64; 2]) -> Result<Spacing, Refusal> {
        let [low, high] = range;
        let spacing = match self.spacing {
            None | Some(SpacingInFile::Linear) => Spacing::Linear,
            Some(SpacingInFile::Log) => Spacing::Log,
        };
        let ordered = low.is_finite() && high.is_finite() && low < high;
        if !ordered || spacing == Spacing::Log && low <= 0.0 {
            let expected = match spacing {
                Spacing::Linear => "[LOW, HIGH], finite, LOW below HIGH",
                Spacing::Log => "[LOW, HIGH], finite, LOW below HIGH and above 0",
            };
            return Err(Refusal::value(
                format!("{key}.range"),
                format!("[{low}, {high}]"),
                expected,
            ));
        }
        Ok(spacing)
    }

    pub fn sampled(self, key: &str, what: Variable) -> Result<Sampled, Refusal> {
        if what.is_whole() || matches!(what.target, Target::Robot | Target::Scene) {
            let expected = "`values`, or `range` with `steps`: it is not sampled";
            return Err(Refusal::value(
                key,
                format!("`{what}` without them"),
                expected,
            ));
        }
        let Some(range) = self.range else {
            return Ok(Sampled::new(what, None));
        };
        let spacing = self.checked_range(key, range)?;
        Ok(Sampled::new(what, Some((range, spacing))))
    }
}

/// A value without the last digits of floating-point noise, so that tables are short.
fn rounded(value: f64) -> f64 {
    format!("{value:.12e}").parse().unwrap_or(value)
}

/// The value at a share of the way from one end of a range to the other.
pub(in crate::study) fn place_in([low, high]: [f64; 2], spacing: Spacing, share: f64) -> f64 {
    match spacing {
        _ if share == 1.0 => high,
        Spacing::Linear => low + (high - low) * share,
        Spacing::Log => low * (high / low).powf(share),
    }
}
