//! Why a predictor was not scored.

use tdcr_learn::data::{ObstacleVariation, PayloadRange};
use tdcr_sim::render::BaseVisibility;
use thiserror::Error;

use super::PipelineError;

/// Why a predictor cannot be scored on a data set.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EvalError {
    /// The model and the data set are of different robots.
    #[error("the model is of robot `{model}`, the data set of a different robot, `{data}`")]
    OtherRobot {
        /// Name of the model's robot.
        model: String,
        /// Name of the data set's robot.
        data: String,
    },
    /// The model was trained with the base in view and the data set shows none, or the reverse.
    #[error("the model was trained on clouds {}, the data set shows clouds {}", with_base(.model), with_base(.data))]
    OtherBase {
        /// Whether the model's data showed it.
        model: BaseVisibility,
        /// Whether the data set shows it.
        data: BaseVisibility,
    },
    /// The model was trained among other obstacles than the data set has.
    #[error(
        "the model was trained in a scene of {model} obstacles, the data set was made in another one, of {data}; expected the same \
         scene"
    )]
    OtherScene {
        /// Number of obstacles around the model's robot.
        model: usize,
        /// Number of those around the data set's.
        data: usize,
    },
    /// Obstacles are moved for each sample, of the model and the data set by other amounts, or of one alone.
    #[error("the model was trained {}, the data set was made {}", with_obstacles(.model), with_obstacles(.data))]
    OtherObstacles {
        /// How far the model's obstacles are moved.
        model: Option<ObstacleVariation>,
        /// How far the data set's are.
        data: Option<ObstacleVariation>,
    },
    /// The model was trained with payloads and the data set has none, or the reverse, or heavier or lighter ones.
    #[error("the model was trained {}, the data set was made {}", with_payload(.model), with_payload(.data))]
    OtherPayload {
        /// The model's payloads.
        model: Option<PayloadRange>,
        /// The data set's payloads.
        data: Option<PayloadRange>,
    },
    /// There is not one predicted cloud for each test command that is scored, or more than there are test commands.
    #[error(
        "{found} predicted clouds, expected {}, one for each test command in the order of the test split",
        if scored == whole { whole.to_string() } else { format!("{scored} (those that are scored) to {whole}") }
    )]
    OtherClouds {
        /// Clouds.
        found: usize,
        /// Test commands that are scored.
        scored: usize,
        /// Test commands.
        whole: usize,
    },
    /// A predicted cloud is of another command than the test command of its place.
    #[error(
        "predicted cloud {index} is of the command {found:?}, test command {index} is {expected:?}: expected the commands \
         of the test split, in its order"
    )]
    OtherCommand {
        /// Place of the cloud.
        index: usize,
        /// Its command.
        found: Vec<f64>,
        /// The test command.
        expected: Vec<f64>,
    },
    /// Two predictors that are compared have one key.
    #[error(
        "two predictors have the key `{key}`, expected keys that differ, and none that is `perfect` or `floor`"
    )]
    SameKey {
        /// The key.
        key: String,
    },
    /// One of several methods that are scored beside each other was refused.
    #[error("{name}: {source}")]
    OfMethod {
        /// The file of the method, or its name.
        name: String,
        /// Why.
        source: Box<PipelineError>,
    },
    /// Nothing is to be scored.
    #[error("no method is to be scored, expected one or more")]
    NoMethod,
    /// A predictor gave fewer points than are to be compared.
    #[error("{predictor}: {found} points in a predicted cloud, expected at least {expected}")]
    FewPredicted {
        /// Name of the predictor.
        predictor: String,
        /// Points of its cloud.
        found: usize,
        /// Points that are to be compared.
        expected: usize,
    },
    /// More commands are to be scored than there are.
    #[error("{found} test commands are to be scored; expected 1 to {most}, as many as there are")]
    ScoredTests {
        /// Commands asked for.
        found: usize,
        /// Commands there are.
        most: usize,
    },
}

fn with_base(base: &BaseVisibility) -> &'static str {
    match base {
        BaseVisibility::Shown => "with the base",
        BaseVisibility::Hidden => "without the base",
    }
}

fn with_obstacles(obstacles: &Option<ObstacleVariation>) -> String {
    obstacles.map_or("with obstacles that stand".to_owned(), |variation| {
        format!("with obstacles that are moved by up to {variation}")
    })
}

fn with_payload(payload: &Option<PayloadRange>) -> String {
    payload.map_or("without payloads".to_owned(), |range| {
        format!("with payloads of {range} kg")
    })
}
