//! The stages of a study, from commands to scores, as library calls that the command line wraps.
//!
//! [`collect`] makes a data set (or parts of one, for [`merge`]), [`train`] a network, an [`Evaluator`] scores it; a [`Comparer`]
//! sets two data sets beside each other. Each tells a
//! [`Monitor`] how far it is and stops when the monitor says so, leaving files from which the same
//! call resumes.

mod capture;
mod collect;
mod collect_settings;
mod compare;
mod compare_settings;
mod distillation;
mod error;
mod eval_settings;
mod evaluate;
mod events;
mod journal;
mod line_file;
mod log;
mod measure;
mod method;
mod metrics;
mod monitor;
mod pairing;
mod probe;
pub mod recording;
mod sampler_plan;
mod scores;
mod simulation;
mod stream_options;
mod subject;
mod survey;
mod symmetry;
mod tip;
mod train;
mod training_data;

pub use capture::{CaptureReport, CaptureSettings, capture};
pub use collect::{CollectTimes, Collected, PoseCounts, collect, export, import, merge};
pub use collect_settings::{CollectSettings, Noise, visibility};
pub use compare::{Comparer, Comparison, Configuration, Reference, Spread, TipSource};
pub use compare_settings::{CompareSettings, Match, Which};
pub use distillation::distillation;
pub use error::{CaptureStop, CompareError, Divergence, EvalError, PipelineError, TrainRunError};
pub use eval_settings::{EvalSettings, Scoring};
pub use evaluate::Evaluator;
pub(crate) use line_file::LineFile;
pub use method::ScoredMethod;
pub use metrics::{DistanceQuantiles, MethodScores, Metrics, OtherMetrics, Results, ScoredTest};
pub use monitor::{Monitor, Silent};
pub use pairing::Place;
pub(crate) use probe::{Probe, Probed};
pub use sampler_plan::SamplerPlan;
pub use scores::{
    Distances, Evaluation, Quantiles, Row, RowKind, RowScore, Scores, UncertaintyScore,
};
pub use stream_options::StreamOptions;
pub use survey::{Survey, Tips};
pub use symmetry::seen_symmetries;
pub use tip::seen_tip;
pub use train::{Trained, distill, model_path, train};
pub use training_data::{StreamSettings, TrainingData};

use std::fs::File;
use std::path::Path;

use tdcr_base::lock::try_lock;

/// Locks the folder `path`, which is made if need be, against other processes that lock it, for as long as the returned file
/// is open.
///
/// # Errors
/// [`PipelineError::InUse`] while another process holds the lock, [`PipelineError::Write`] where it cannot be taken.
pub fn lock_folder(path: &Path) -> Result<File, PipelineError> {
    let locked = std::fs::create_dir_all(path).and_then(|()| try_lock(&path.join(".lock")));
    let lock = locked.map_err(|source| PipelineError::Write {
        path: path.to_owned(),
        source,
    })?;
    lock.ok_or_else(|| PipelineError::InUse {
        path: path.to_owned(),
    })
}
