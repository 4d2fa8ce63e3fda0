//! What is scored: a predictor, or clouds that were given.

use std::sync::Arc;

use tdcr_learn::data::{Normalisation, PredictedClouds, Sample};
use tdcr_learn::predict::{About, Predictor};

use super::measure::Extent;
use super::{EvalError, PipelineError};

/// How far a command beside a predicted cloud may be from the test command, as a part of the motor's range: what is lost
/// where commands are printed with a few digits, and far less than what tells commands apart.
const COMMAND_TOLERANCE: f32 = 1e-3;

/// What is scored.
pub(super) struct Method {
    pub about: About,
    pub clouds: Clouds,
    pub extent: Extent,
}

/// Where the clouds come from.
pub(super) enum Clouds {
    /// From the conditions.
    Predicted(Arc<dyn Predictor>),
    /// Given, one for each test command in the order of the test split. A predictor could not find them: two test commands may
    /// be the same.
    Given(PredictedClouds),
}

impl Method {
    pub fn predictor(predictor: Arc<dyn Predictor>, extent: Extent) -> Self {
        Self {
            about: predictor.about(),
            clouds: Clouds::Predicted(predictor),
            extent,
        }
    }

    pub fn given(clouds: PredictedClouds) -> Self {
        Self {
            about: About {
                key: "predictions".to_owned(),
                name: "predictions".to_owned(),
                method: "clouds of another program".to_owned(),
                colors: clouds.colors.is_some(),
                ..About::default()
            },
            clouds: Clouds::Given(clouds),
            extent: Extent::All,
        }
    }
}

/// Refuses clouds that are not of the test commands.
pub(super) fn require_commands(
    clouds: &PredictedClouds,
    test: &[Sample],
    normalisation: &Normalisation,
) -> Result<(), PipelineError> {
    if clouds.points.len() != test.len() {
        return Err(EvalError::OtherClouds {
            found: clouds.points.len(),
            expected: test.len(),
        }
        .into());
    }
    let commands = clouds.commands.iter().flatten();
    for (index, (command, sample)) in commands.zip(test).enumerate() {
        let truth = sample.condition.to_vec();
        let expected = normalisation.condition(&truth)?;
        let given: Vec<f64> = command.iter().map(|&value| value.into()).collect();
        let found = normalisation.condition(&given)?;
        let near = |(a, b): (&f32, &f32)| (a - b).abs() <= COMMAND_TOLERANCE;
        if !found.iter().zip(&expected).all(near) {
            return Err(EvalError::OtherCommand {
                index,
                found: given,
                expected: truth,
            }
            .into());
        }
    }
    Ok(())
}
