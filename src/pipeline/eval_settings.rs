//! How predictors are scored.

use serde::{Deserialize, Serialize};

use super::PipelineError;

/// How clouds are compared.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EvalSettings {
    /// Points of each cloud that the Chamfer distance is computed on.
    pub points: usize,
    /// Points of each cloud that the earth mover's distances are computed on, no more than `points`.
    pub emd_points: usize,
    /// Test commands that are scored, the first of their split; `None`: all.
    pub tests: Option<usize>,
    /// Seed of noise and subsets.
    pub seed: u64,
}

/// Those of the command line.
impl Default for EvalSettings {
    fn default() -> Self {
        Self {
            points: 10_000,
            emd_points: 2000,
            tests: None,
            seed: 0,
        }
    }
}

/// Refuses to compare more points than there are.
pub(super) fn require_points(wanted: usize, available: usize) -> Result<(), PipelineError> {
    match (1..=available).contains(&wanted) {
        true => Ok(()),
        false => Err(PipelineError::ComparedPoints {
            found: wanted,
            most: available,
        }),
    }
}
