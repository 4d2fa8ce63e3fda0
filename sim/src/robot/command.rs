//! What is asked of a robot: tendon commands and loads.

use rand::{Rng, RngExt};
use thiserror::Error;

use super::Robot;

/// One rest length per tendon (m), each finite and within its tendon's range.
#[derive(Clone, Debug, PartialEq)]
pub struct Command(Vec<f64>);

/// Loads on a robot besides its own weight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Loads {
    payload: f64,
}

/// Why a command was refused.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CommandError {
    /// The wrong number of entries.
    #[error("the command has {found} entries; robot `{robot}` has {expected} tendons")]
    Length {
        /// Name of the robot.
        robot: String,
        /// Number of tendons.
        expected: usize,
        /// Number of entries.
        found: usize,
    },
    /// An entry that is not a number, or out of the tendon's range.
    #[error("command entry {index} is {value} m; tendon {index} takes {low} to {high} m")]
    Range {
        /// The entry, from 0.
        index: usize,
        /// Its value (m).
        value: f64,
        /// Smallest command accepted (m).
        low: f64,
        /// Largest command accepted (m).
        high: f64,
    },
}

/// Why a payload was refused.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("the payload is {0} kg; expected a finite mass, 0 or above")]
pub struct PayloadError(pub f64);

impl Command {
    /// The rest lengths (m), one per tendon.
    pub fn as_slice(&self) -> &[f64] {
        &self.0
    }
}

impl Loads {
    /// A payload (kg) at the origin of the distal disc: a force `p g` along gravity.
    ///
    /// # Errors
    /// [`PayloadError`] for a negative or non-finite mass.
    pub fn payload(mass: f64) -> Result<Self, PayloadError> {
        if mass.is_finite() && mass >= 0.0 {
            Ok(Self { payload: mass })
        } else {
            Err(PayloadError(mass))
        }
    }

    /// Mass of the payload (kg).
    pub fn payload_mass(&self) -> f64 {
        self.payload
    }
}

impl Robot {
    /// A command for this robot from one rest length per tendon (m).
    ///
    /// # Errors
    /// [`CommandError`] for a wrong number of entries, or an entry that is not within its tendon's
    /// range.
    pub fn command(&self, lengths: &[f64]) -> Result<Command, CommandError> {
        if lengths.len() != self.tendons.len() {
            return Err(CommandError::Length {
                robot: self.spec.name.clone(),
                expected: self.tendons.len(),
                found: lengths.len(),
            });
        }
        for (index, (&value, tendon)) in lengths.iter().zip(&self.tendons).enumerate() {
            let [low, high] = tendon.command_range;
            if !(low..=high).contains(&value) {
                return Err(CommandError::Range {
                    index,
                    value,
                    low,
                    high,
                });
            }
        }
        Ok(Command(lengths.to_vec()))
    }

    /// A command drawn uniformly from the box of the tendons' ranges.
    pub fn random_command(&self, rng: &mut impl Rng) -> Command {
        let draw = |[low, high]: [f64; 2]| low + (high - low) * rng.random::<f64>();
        Command(
            self.tendons
                .iter()
                .map(|t| t.command_range)
                .map(draw)
                .collect(),
        )
    }

    /// The command in the middle of every tendon's range.
    pub fn mean_command(&self) -> Command {
        let middle = |tendon: &super::Tendon| tendon.command_range.iter().sum::<f64>() / 2.0;
        Command(self.tendons.iter().map(middle).collect())
    }
}
