//! How predictors are scored.

use clap::Args;
use serde::{Deserialize, Serialize};

use super::PipelineError;

/// How clouds are compared. The one list of these options: the command line (`tdcr eval`) and Python (`tdcr.evaluate`) take their
/// names and types from it, and the former its documentation. In JSON a field has the name of its option.
#[derive(Clone, Copy, Debug, Default, PartialEq, Args, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvalSettings {
    /// Points of each cloud that the Chamfer distance is computed on [default: 10000, or as many as the clouds have]
    #[arg(long, value_name = "N")]
    pub points: Option<usize>,
    /// Points of each cloud that the exact earth mover's distances are computed on [default: 2000, or as many]
    #[arg(long, value_name = "N")]
    pub emd_points: Option<usize>,
    /// Test commands to score, the first N of their split [default: all]
    #[arg(long, value_name = "N")]
    pub tests: Option<usize>,
    /// Seed of noise and subsets
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}

/// How clouds are compared, in numbers: [`EvalSettings`] on clouds that are there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Scoring {
    /// Points of each cloud that the Chamfer distance is computed on.
    pub points: usize,
    /// Points of each cloud that the earth mover's distances are computed on.
    pub emd_points: usize,
    /// Test commands that are scored, the first of their split; `None`: all.
    pub tests: Option<usize>,
    /// Seed of noise and subsets.
    pub seed: u64,
}

impl Scoring {
    /// Usual points of the Chamfer distance.
    pub const POINTS: usize = 10_000;
    /// Usual points of the earth mover's distances.
    pub const EMD_POINTS: usize = 2000;

    /// How `settings` compare clouds that have `available` points, of which the earth mover's distances get no more than
    /// `available_to_emd` where nothing else is asked for.
    ///
    /// # Errors
    /// [`PipelineError::ComparedPoints`] where more points are asked for than there are.
    pub(super) fn new(
        settings: &EvalSettings,
        available: usize,
        available_to_emd: usize,
    ) -> Result<Self, PipelineError> {
        let EvalSettings { tests, seed, .. } = *settings;
        let points = settings.points.unwrap_or(Self::POINTS.min(available));
        require_points("points", points, available)?;
        let usual = Self::EMD_POINTS.min(points).min(available_to_emd);
        let emd_points = settings.emd_points.unwrap_or(usual);
        require_points("emd_points", emd_points, points)?;
        Ok(Self {
            points,
            emd_points,
            tests,
            seed,
        })
    }
}

/// Refuses to compare more points than there are; `setting` asked for them.
fn require_points(setting: &'static str, found: usize, most: usize) -> Result<(), PipelineError> {
    match (1..=most).contains(&found) {
        true => Ok(()),
        false => Err(PipelineError::ComparedPoints {
            setting,
            found,
            most,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(
        points: Option<usize>,
        emd_points: Option<usize>,
        most: usize,
    ) -> Result<[usize; 2], String> {
        let settings = EvalSettings {
            points,
            emd_points,
            ..EvalSettings::default()
        };
        let scoring = Scoring::new(&settings, most, most.min(1500));
        scoring
            .map(|scoring| [scoring.points, scoring.emd_points])
            .map_err(|error| error.to_string())
    }

    #[test]
    fn usual_counts_are_no_more_than_there_are_and_others_are_refused_by_name() {
        assert_eq!(counts(None, None, 20_000), Ok([10_000, 1500]));
        assert_eq!(counts(None, None, 200), Ok([200, 200]));
        assert_eq!(counts(Some(100), None, 200), Ok([100, 100]));
        assert_eq!(counts(None, Some(50), 200), Ok([200, 50]));
        let said = |points, emd_points| counts(points, emd_points, 200).expect_err("refused");
        assert!(said(Some(201), None).starts_with("points is 201; expected 1 to 200"));
        assert!(said(Some(100), Some(101)).starts_with("emd_points is 101; expected 1 to 100"));
        assert!(said(Some(0), None).starts_with("points is 0"));
        assert!(said(None, Some(0)).starts_with("emd_points is 0"));
    }
}
