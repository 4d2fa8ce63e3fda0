//! Why there is no predicted cloud.

use std::error::Error;

use crate::data::{DataError, SimulateError};
use crate::prior::SurfaceError;

/// Why a predictor has no cloud for a condition.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PredictError {
    /// Another number of values than the predictor was made for.
    #[error(transparent)]
    Length(#[from] DataError),
    /// The robot does not settle under the condition, or is not seen.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// There is no surface to start from.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// There is nothing to predict from.
    #[error("the training set has no clouds, expected at least one")]
    NoTraining,
    /// A value is NaN or infinite.
    #[error("value {index} of the command is {found}, expected a finite number")]
    NotFinite {
        /// Where in the command.
        index: usize,
        /// What stands there.
        found: f64,
    },
    /// The predicted cloud is not one.
    #[error(
        "the network's cloud for the command {command:?} is not finite: {channel} of point {point} is {found}; the \
         model's largest weight is {weight:e}, in tensor `{tensor}`, and its scale is {scale:e} m"
    )]
    NoCloud {
        /// The command (m).
        command: Vec<f64>,
        /// The first point that is not finite.
        point: usize,
        /// Which of its numbers.
        channel: &'static str,
        /// What it is.
        found: f32,
        /// The tensor that holds the largest weight.
        tensor: String,
        /// The magnitude of that weight.
        weight: f32,
        /// The data's scale (m), by which the network's positions are multiplied.
        scale: f64,
    },
    /// Whatever else a predictor may fail of.
    #[error("{predictor}: {source}")]
    Other {
        /// Its name.
        predictor: String,
        /// What happened.
        source: Box<dyn Error + Send + Sync>,
    },
}
