//! Why a network was not trained.

use std::path::PathBuf;

use tdcr_learn::flow::FlowError;
use tdcr_learn::options::OptionsError;
use tdcr_learn::prior::SurfaceError;
use tdcr_learn::train::{Target, TrainError};
use thiserror::Error;

/// Why a run of training, or the sampler of a trained network, was refused or came to an end.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TrainRunError {
    /// The prior's robot cannot be simulated under the data set's conditions.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Training cannot start.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// The options describe no run.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// The values of a sampler describe none.
    #[error(transparent)]
    Sampler(#[from] FlowError),
    /// Another sampler than the one that a network was distilled for.
    #[error("the network was distilled for {evaluations} evaluations by its own sampler")]
    OwnSampler {
        /// Evaluations by its own sampler.
        evaluations: usize,
    },
    /// Training diverged, and left its last good state.
    #[error(transparent)]
    Diverged(Box<Divergence>),
    /// The folder holds a run with other settings or data.
    #[error("{} cannot be resumed: {source}", path.display())]
    OtherRun {
        /// The state's file.
        path: PathBuf,
        /// What differs.
        source: TrainError,
    },
    /// The folder holds a model, and no state of a run that it could be of.
    #[error("{} is a model without the state of its run beside it, and would be overwritten", path.display())]
    ModelInTheWay {
        /// The model's file.
        path: PathBuf,
    },
}

/// A run that diverged, and what it left.
#[derive(Debug, Error)]
#[error(
    "{source}; {}; {}. The same settings would come to the same end",
    kept("last good state", state),
    kept("best network", model)
)]
pub struct Divergence {
    /// What happened, and at which step.
    pub source: TrainError,
    /// File and step of the last good state; none where there is none yet.
    pub state: Option<(PathBuf, u64)>,
    /// File and step of the best network; none where none was validated yet.
    pub model: Option<(PathBuf, u64)>,
    /// What the network was to learn.
    pub target: Target,
    /// The run's learning rate after warm-up.
    pub learning_rate: f64,
}

impl Divergence {
    /// The learning rate to try next, where a lower one may help: students are taught at a rate that does not make them diverge.
    pub fn lower_rate(&self) -> Option<f64> {
        (self.target != Target::Steps).then_some(self.learning_rate / 3.0)
    }
}

fn kept(what: &str, kept: &Option<(PathBuf, u64)>) -> String {
    match kept {
        Some((path, step)) => format!("the {what} is of step {step}, in {}", path.display()),
        None => format!("there is no {what} yet"),
    }
}
