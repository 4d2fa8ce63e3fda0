//! What is asked of a robot's tendons.

use rand::{Rng, RngExt};
use thiserror::Error;

use super::{CommandUnit, Robot, Tendon};

/// One value per tendon, each finite and within its tendon's range: a rest length or a length (m), or
/// a tension (N), by the tendon's [`Drive`](super::Drive).
#[derive(Clone, Debug, PartialEq)]
pub struct Command(Vec<f64>);

/// Why a command was refused.
#[non_exhaustive]
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
    #[error("command entry {0} is {value} {unit}; tendon {0} takes {low} to {high} {unit}", index + 1)]
    Range {
        /// The entry, from 0; people read it from 1.
        index: usize,
        /// Its value.
        value: f64,
        /// Smallest command accepted.
        low: f64,
        /// Largest command accepted.
        high: f64,
        /// Unit of the tendon's commands.
        unit: CommandUnit,
    },
}

impl Command {
    /// The values, one per tendon (m, or N for a tension drive).
    pub fn as_slice(&self) -> &[f64] {
        &self.0
    }

    /// `part` of the way from this command to another of the robot.
    pub(crate) fn towards(&self, goal: &Self, part: f64) -> Self {
        if part == 1.0 {
            return goal.clone();
        }
        let pairs = self.0.iter().zip(&goal.0);
        Self(pairs.map(|(from, to)| from + part * (to - from)).collect())
    }

    /// The values, to be changed within what the robot they act on takes.
    pub(crate) fn as_mut_slice(&mut self) -> &mut [f64] {
        &mut self.0
    }
}

impl Robot {
    /// A command for this robot from one value per tendon (m, or N for a tension drive).
    ///
    /// # Errors
    /// [`CommandError`] for a wrong number of entries, or an entry that is not within its tendon's
    /// range.
    pub fn command(&self, values: &[f64]) -> Result<Command, CommandError> {
        self.check_command(values)?;
        Ok(Command(values.to_vec()))
    }

    /// Whether values are a command for this robot.
    pub(crate) fn check_command(&self, values: &[f64]) -> Result<(), CommandError> {
        if values.len() != self.tendons().len() {
            return Err(CommandError::Length {
                robot: self.spec().name.clone(),
                expected: self.tendons().len(),
                found: values.len(),
            });
        }
        for (index, (&value, tendon)) in values.iter().zip(self.tendons()).enumerate() {
            let [low, high] = tendon.range;
            if !(low..=high).contains(&value) {
                return Err(CommandError::Range {
                    index,
                    value,
                    low,
                    high,
                    unit: tendon.unit(),
                });
            }
        }
        Ok(())
    }

    /// A command drawn uniformly from the box of the tendons' ranges.
    pub fn random_command(&self, rng: &mut impl Rng) -> Command {
        let draw = |[low, high]: [f64; 2]| low + (high - low) * rng.random::<f64>();
        Command(self.tendons().iter().map(|t| t.range).map(draw).collect())
    }

    /// The command in the middle of every tendon's range.
    pub fn mean_command(&self) -> Command {
        let middle = |tendon: &Tendon| tendon.range.iter().sum::<f64>() / 2.0;
        Command(self.tendons().iter().map(middle).collect())
    }
}
