//! What can go wrong in training and with its files.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::difference::Difference;
use super::spike::SPIKE_STEPS;
use crate::flow::FlowError;
use crate::net::NetworkShapeError;

/// A setting out of bounds.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// A setting of the run itself.
    #[error("{field} is {found}, expected {expected}")]
    Value {
        /// Field of [`TrainSettings`](super::TrainSettings).
        field: &'static str,
        /// Its value.
        found: String,
        /// What would be right.
        expected: String,
    },
    /// A setting of the path or of the sampler.
    #[error(transparent)]
    Flow(#[from] FlowError),
}

impl SettingsError {
    pub(super) fn new(field: &'static str, found: impl ToString, expected: impl ToString) -> Self {
        Self::Value {
            field,
            found: found.to_string(),
            expected: expected.to_string(),
        }
    }

    /// An error where `found` is another value than `expected`, which is `whose`.
    pub(super) fn unless_equal<T: PartialEq + fmt::Debug>(
        field: &'static str,
        found: &T,
        expected: &T,
        whose: impl ToString,
    ) -> Result<(), Self> {
        if found == expected {
            return Ok(());
        }
        Err(Self::new(field, format!("{found:?}"), whose))
    }
}

/// Why a training run cannot start or go on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// A setting is out of bounds, or does not suit the data.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The network's shape is out of bounds.
    #[error(transparent)]
    Shape(#[from] NetworkShapeError),
    /// A network with BatchNorm.
    #[error(
        "the authors' Hybrid (layers pvcnn) has BatchNorm, whose moments are over all clouds of a batch, and this trainer takes \
         clouds one after another: expected layers `residual`"
    )]
    BatchNorm,
    /// A data set cannot be trained on or validated with.
    #[error("{set} set: {reason}")]
    Data {
        /// `training` or `validation`.
        set: &'static str,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// The loss, its gradient or the validation's distance is NaN or infinite.
    #[error("training diverged at step {step}: {quantity} is {found}")]
    Diverged {
        /// The step, the first is 1.
        step: u64,
        /// What is not finite.
        quantity: &'static str,
        /// Its value.
        found: f64,
    },
    /// The loss has been far above its running level for ten steps in a row.
    #[error(
        "training diverged at step {step}: the loss is {loss}, and was above {factor} times its level of {level} for \
         {SPIKE_STEPS} steps"
    )]
    Spike {
        /// The step, the first is 1.
        step: u64,
        /// Its loss.
        loss: f32,
        /// The running level: the median of up to 100 losses before those.
        level: f32,
        /// [`TrainSettings::spike_factor`](super::TrainSettings::spike_factor).
        factor: f64,
    },
    /// A run cannot start from a model's weights.
    #[error(
        "the run cannot start at the weights of this model: its {what} is {found}, expected {expected}"
    )]
    OtherStart {
        /// What differs.
        what: String,
        /// The model's.
        found: String,
        /// This run's.
        expected: String,
    },
    /// A run cannot be given fewer steps than it has.
    #[error(
        "`steps` is {found}, and the run is of {expected}: a run can be given more steps, not fewer"
    )]
    Shorter {
        /// Steps asked for.
        found: u64,
        /// Steps that the run has.
        expected: u64,
    },
    /// A state belongs to another run.
    #[error("the training state is of another run: {what} was {found}, expected {expected}")]
    OtherRun {
        /// What differs.
        what: String,
        /// The state's.
        found: String,
        /// This run's.
        expected: String,
    },
}

/// Why a model or a training state could not be written or read.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", .path.display())]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: FileProblem,
}

/// What is wrong with a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileProblem {
    /// The operating system refused.
    #[error("cannot {action}: {source}")]
    Io {
        /// What was tried, as a verb.
        action: &'static str,
        /// The operating system's reason.
        source: io::Error,
    },
    /// Not a safetensors file, or a truncated or damaged one.
    #[error("not a whole safetensors file ({0})")]
    NotSafetensors(String),
    /// The header that says what the file holds is missing or unreadable.
    #[error("header `tdcr`: {0}")]
    Header(String),
    /// Written in another version of the format.
    #[error("format version {found}, expected {expected}")]
    Version {
        /// The file's, as it stands in the header.
        found: String,
        /// This program's.
        expected: u32,
    },
    /// A model where a training state was expected, or the reverse.
    #[error("holds a {found}, expected a {expected}")]
    Kind {
        /// What it holds.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// A tensor is not there.
    #[error("no tensor `{name}`, expected one of type {expected}")]
    MissingTensor {
        /// The tensor.
        name: String,
        /// Type and shape it should have.
        expected: String,
    },
    /// A tensor is of another type or shape.
    #[error("tensor `{name}` is {found}, expected {expected}")]
    WrongTensor {
        /// The tensor.
        name: String,
        /// Type and shape it has.
        found: String,
        /// Type and shape it should have.
        expected: String,
    },
    /// A tensor that nothing in the header calls for.
    #[error("unexpected tensor `{0}`")]
    ExtraTensor(String),
    /// A NaN or infinite value.
    #[error("tensor `{name}` is {found} at index {index}, expected finite values")]
    NotFinite {
        /// The tensor.
        name: String,
        /// Where in it, row-major.
        index: usize,
        /// What stands there.
        found: f64,
    },
}

impl TrainError {
    pub(super) fn other_run(difference: Difference) -> Self {
        let Difference {
            what,
            found,
            expected,
        } = difference;
        Self::OtherRun {
            what,
            found,
            expected,
        }
    }

    pub(super) fn other_start(difference: Difference) -> Self {
        let Difference {
            what,
            found,
            expected,
        } = difference;
        Self::OtherStart {
            what,
            found,
            expected,
        }
    }

    /// Whether the run itself went wrong, not what it was given.
    pub fn is_divergence(&self) -> bool {
        matches!(self, Self::Diverged { .. } | Self::Spike { .. })
    }
}

impl FileProblem {
    pub(super) fn io(action: &'static str) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io { action, source }
    }

    /// A value of the header is out of bounds.
    pub(super) fn header(reason: impl ToString) -> Self {
        Self::Header(reason.to_string())
    }

    pub(super) fn at(self, path: &Path) -> FileError {
        FileError {
            path: path.to_owned(),
            problem: self,
        }
    }
}
