//! How data sets are compared.

use clap::{Args, ValueEnum};
use serde::{Deserialize, Deserializer};
use tdcr_learn::data::Split;

use super::collect_settings::value_named;
use super::pairing::Pairing;

/// How clouds of two data sets are compared. The one list of these options: the command line (`tdcr compare`) and Python
/// (`tdcr.compare`) take their names and types from it, and the former its documentation. In JSON a field has the name of its
/// option.
#[derive(Clone, Copy, Debug, PartialEq, Args, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CompareSettings {
    /// How samples are paired
    #[arg(long = "match", value_enum, default_value_t = Self::default().matched, value_name = "HOW")]
    #[serde(rename = "match", deserialize_with = "matched")]
    pub matched: Match,
    /// Largest difference of a number of two conditions that count as equal, as a part of its range in both data sets
    #[arg(long, default_value_t = Self::default().tolerance, value_name = "PART", value_parser = part_of_range, allow_hyphen_values = true)]
    pub tolerance: f64,
    /// Which samples to compare
    #[arg(long, value_enum, default_value_t = Self::default().split)]
    #[serde(deserialize_with = "split")]
    pub split: Which,
    /// Points of each cloud that the Chamfer distance is computed on [default: as many as the smaller clouds have, at most
    /// 10000]
    #[arg(long, value_name = "N")]
    pub points: Option<usize>,
    /// Points of each cloud that the exact earth mover's distances are computed on [default: as many, at most 2000]
    #[arg(long, value_name = "N")]
    pub emd_points: Option<usize>,
    // What the simulator's cameras see has this seed too.
    /// Seed of the points that are compared
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}

/// All samples, paired by their conditions.
impl Default for CompareSettings {
    fn default() -> Self {
        Self {
            matched: Match::Condition,
            tolerance: Pairing::TOLERANCE,
            split: Which::All,
            points: None,
            emd_points: None,
            seed: 0,
        }
    }
}

impl CompareSettings {
    pub(super) fn pairing(&self) -> Pairing {
        match self.matched {
            Match::Condition => Pairing::Condition {
                tolerance: self.tolerance,
            },
            Match::Index => Pairing::Index,
        }
    }

    /// The split whose samples are compared; `None` for all.
    pub(super) fn split(&self) -> Option<Split> {
        match self.split {
            Which::All => None,
            Which::Train => Some(Split::Train),
            Which::Val => Some(Split::Val),
            Which::Test => Some(Split::Test),
        }
    }
}

/// Which samples are of one configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Match {
    /// Those of equal commands and payloads
    Condition,
    /// Those of one index in one split
    Index,
}

/// Samples of one split, or of all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(
    missing_docs,
    reason = "a comment would be the value's help: the names say it"
)]
pub enum Which {
    All,
    Train,
    Val,
    Test,
}

/// Parses a part of a range.
fn part_of_range(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(part) if (0.0..=1.0).contains(&part) => Ok(part),
        _ => Err("expected a number from 0 to 1".to_owned()),
    }
}

fn matched<'de, D: Deserializer<'de>>(value: D) -> Result<Match, D::Error> {
    value_named("match", value)
}

fn split<'de, D: Deserializer<'de>>(value: D) -> Result<Which, D::Error> {
    value_named("split", value)
}
