//! Training a velocity network by flow matching, and the files that training leaves.
//!
//! [`Trainer`] takes steps; [`TrainingState`] is all of it on disk, for exact resumption; [`Model`] is what predicts.

mod check;
mod difference;
mod error;
mod feed;
mod format;
mod model;
mod optimizer;
mod orthogonal;
mod samples;
mod schedule;
mod settings;
mod spike;
mod start;
mod state;
mod teacher;
mod trainer;

pub use error::{FileError, FileProblem, SettingsError, TrainError};
pub use feed::{Feed, StreamWindow};
pub use model::{Model, PredictError, Prediction, Provenance};
pub use optimizer::Optimizer;
pub use settings::{Schedule, Target, TrainSettings};
pub use start::Start;
pub use state::{Best, TrainingState};
pub use teacher::Teacher;
pub use trainer::{Distance, Trainer};
