//! Training a velocity network by flow matching, and the files that training leaves.
//!
//! A [`Trainer`] takes steps on a [`Feed`] (a data set, a stream, the trajectories of a [`Teacher`], or the ends of a flow:
//! [`Refiner`]) with [`TrainSettings`]. [`TrainingState`] is the whole run on disk, from which it is resumed exactly; [`Model`]
//! predicts.

mod check;
mod difference;
mod error;
mod feed;
mod flow_predictor;
mod format;
mod model;
mod optimizer;
mod orthogonal;
mod refined;
mod refinement;
mod samples;
mod schedule;
mod settings;
mod spike;
mod start;
mod state;
mod teacher;
mod trainer;
mod trajectory;
mod validation;

pub use error::{FileError, FileProblem, SettingsError, TrainError};
pub use feed::{Feed, StreamWindow};
pub use flow_predictor::FlowPredictor;
pub use model::{Model, Provenance};
pub use optimizer::Optimizer;
pub use refinement::Refiner;
pub use settings::{Procedure, Refinement, Schedule, Target, TrainSettings};
pub use start::Start;
pub use state::{Best, TrainingState};
pub use teacher::Teacher;
pub use trainer::{Distance, Trainer};
