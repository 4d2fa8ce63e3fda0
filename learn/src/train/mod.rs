//! Training a velocity network by flow matching, and the files that training leaves.
//!
//! [`Trainer`] takes steps; [`TrainingState`] is all of it on disk, for exact resumption; [`Model`] is what predicts.

mod difference;
mod error;
mod feed;
mod flow_predictor;
mod format;
mod model;
mod optimizer;
mod orthogonal;
mod samples;
mod schedule;
mod settings;
mod start;
mod state;
mod teacher;
mod trainer;

pub use error::{FileError, FileProblem, TrainError};
pub use feed::{Feed, StreamWindow};
pub use flow_predictor::FlowPredictor;
pub use model::{Model, Provenance};
pub use optimizer::Optimizer;
pub use schedule::Schedule;
pub use settings::{SPIKE_STEPS, SettingsError, Target, TrainSettings};
pub use start::Start;
pub use state::{Best, TrainingState};
pub use teacher::Teacher;
pub use trainer::{Distance, Trainer};
