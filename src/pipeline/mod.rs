//! The stages of a study, from commands to scores, as library calls that the command line wraps.
//!
//! [`collect`] makes a data set (or parts of one, for [`merge`]), [`train`] a network, an [`Evaluator`] scores it; a [`Comparer`]
//! sets two data sets beside each other. Each tells a
//! [`Monitor`] how far it is and stops when the monitor says so, leaving files from which the same
//! call resumes.

mod capture;
mod collect;
mod compare;
mod contestant;
mod eval_settings;
mod evaluate;
mod events;
mod journal;
mod line_file;
mod log;
mod measure;
mod metrics;
mod monitor;
mod network_size;
mod pairing;
mod plan;
mod preset;
mod probe;
pub mod recording;
mod scores;
mod simulation;
mod subject;
mod survey;
mod symmetry;
mod tip;
mod train;
mod training_data;

pub use capture::{CaptureLog, CaptureReport, CaptureSettings, capture};
pub use collect::{CollectSettings, CollectTimes, collect, merge};
pub use compare::{
    CompareSettings, Comparer, Comparison, Configuration, Counterpart, Spread, TipSource,
};
pub use eval_settings::{EvalSettings, Scoring};
pub use evaluate::Evaluator;
pub(crate) use line_file::LineFile;
pub use metrics::{DistanceQuantiles, Metrics, OtherMetrics, Results, WorstTest};
pub use monitor::{Monitor, Silent};
pub use network_size::NetworkSize;
pub use pairing::{Pairing, Place};
pub use plan::{SamplerPlan, TrainPlan};
pub use preset::{Length, Preset, Rates, distillation, student_sampler};
pub(crate) use probe::{Probe, Probed};
pub use scores::{Distances, Evaluation, Quantiles, Row, RowScore, Scores, UncertaintyScore};
pub use survey::{Survey, Tips};
pub use symmetry::seen_symmetries;
pub use tip::seen_tip;
pub use train::{Trained, distill, model_path, train};
pub use training_data::{StreamSettings, TrainingData};

use std::fs::File;
use std::path::{Path, PathBuf};

use tdcr_base::lock::try_lock;
use tdcr_hw::capture::CaptureError;
use tdcr_hw::rig::RigError;
use tdcr_learn::data::{DataError, PayloadRange, SimulateError};
use tdcr_learn::flow::FlowError;
use tdcr_learn::metrics::MetricError;
use tdcr_learn::predict::PredictError;
use tdcr_learn::prior::SurfaceError;
use tdcr_learn::train::{FileError, Target, TrainError};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::SpecError;
use thiserror::Error;

/// Why a stage ended before it was done.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The monitor asked to stop. What was done is kept.
    #[error("interrupted; run the same command again to go on")]
    Interrupted,
    /// The monitor asked to stop work that keeps nothing to resume from.
    #[error("interrupted")]
    Abandoned,
    /// A capture ended early. What was captured is kept.
    #[error(
        "{}; {kept} of {count} samples are kept in {}: run the same command again to go on",
        short(ended), path.display()
    )]
    CaptureEnded {
        /// Why.
        ended: Box<PipelineError>,
        /// Samples that are in the folder, those of earlier runs too.
        kept: usize,
        /// Samples that are wanted.
        count: usize,
        /// Folder of the data set.
        path: PathBuf,
    },
    /// The robot was refused.
    #[error(transparent)]
    Robot(#[from] SpecError),
    /// The data set could not be read or written.
    #[error(transparent)]
    Data(DataError),
    /// A sample could not be simulated.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// The rig did not capture what it should.
    #[error(transparent)]
    Capture(CaptureError),
    /// A folder or file of the stage's own could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The folder or file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The prior's robot cannot be simulated under the data set's conditions.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Training cannot start.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// A preset's epochs, of a stream.
    #[error(
        "preset {preset} takes {epochs} epochs of a data set, and a stream has no end: say --steps N"
    )]
    Endless {
        /// Name of the preset.
        preset: &'static str,
        /// Its epochs.
        epochs: u64,
    },
    /// The values of a sampler describe none.
    #[error(transparent)]
    Sampler(#[from] FlowError),
    /// Another sampler than the one that a network was distilled for.
    #[error(
        "the network was distilled for {evaluations} evaluations by its own sampler: leave out --sampler, --sampler-steps, \
         --sampler-power, --sampler-tolerance and --sampler-denoise"
    )]
    OwnSampler {
        /// Evaluations by its own sampler.
        evaluations: usize,
    },
    /// Training diverged, and left its last good state.
    #[error(transparent)]
    Diverged(Box<Divergence>),
    /// The folder holds a run with other settings or data.
    #[error(
        "{} cannot be resumed: {source}; choose another folder (--out), where --init MODEL starts at the network of this \
         run, or remove this one",
        path.display()
    )]
    OtherRun {
        /// The state's file.
        path: PathBuf,
        /// What differs.
        source: TrainError,
    },
    /// The folder holds a model, and no state of a run that it could be of.
    #[error(
        "{} is a model without the state of its run beside it, and would be overwritten: choose another folder (--out), or \
         move it away",
        path.display()
    )]
    ModelInTheWay {
        /// The model's file.
        path: PathBuf,
    },
    /// Another process works in the folder.
    #[error("{} is being written by another process: wait for its end, or choose another folder (--out)", path.display())]
    InUse {
        /// The folder.
        path: PathBuf,
    },
    /// A model or training state could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// A predictor has no cloud for a command.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// Two clouds cannot be compared.
    #[error(transparent)]
    Metric(#[from] MetricError),
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
    /// The model was trained with payloads and the data set has none, or the reverse, or heavier or lighter ones.
    #[error("the model was trained {}, the data set was made {}", with_payload(.model), with_payload(.data))]
    OtherPayload {
        /// The model's payloads.
        model: Option<PayloadRange>,
        /// The data set's payloads.
        data: Option<PayloadRange>,
    },
    /// There is not one predicted cloud for each test command.
    #[error(
        "{found} predicted clouds, expected {expected}, one for each test command in the order of the test split"
    )]
    OtherClouds {
        /// Clouds.
        found: usize,
        /// Test commands.
        expected: usize,
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
    /// Two data sets that are compared have commands of different lengths.
    #[error(
        "commands of the first data set have {} numbers, those of the second {}: expected data sets of robots with as many \
         motors",
        found[0],
        found[1]
    )]
    OtherMotors {
        /// Motors of each.
        found: [usize; 2],
    },
    /// No configuration is in both of two data sets.
    #[error(
        "no configuration of the first data set is one of the second within {tolerance} of each motor's range: expected the \
         same commands and payloads, in the same units; --tolerance allows larger differences, --match index pairs samples by \
         their places"
    )]
    NothingInCommon {
        /// Allowed difference, as a part of a motor's range.
        tolerance: f64,
    },
    /// No index is in both of two data sets.
    #[error(
        "no sample of the first data set has the place of one in the second: expected samples in the same split"
    )]
    NoCommonIndex,
    /// A data set does not say which robot it shows, and that is to be simulated.
    #[error(
        "{} does not say which robot it shows, so that it cannot be simulated: name the robot (--robot), or a second data set",
        path.display()
    )]
    NoRobot {
        /// Folder of the data set.
        path: PathBuf,
    },
    /// More commands are to be scored than there are.
    #[error("{found} test commands are to be scored; expected 1 to {most}, as many as there are")]
    ScoredTests {
        /// Commands asked for.
        found: usize,
        /// Commands there are.
        most: usize,
    },
    /// More points are to be compared than there are.
    #[error("{setting} is {found}; expected 1 to {most}, as many points as there are to compare")]
    ComparedPoints {
        /// The field of [`EvalSettings`] or [`CompareSettings`] that asks for them.
        setting: &'static str,
        /// Points asked for.
        found: usize,
        /// Points there are.
        most: usize,
    },
}

impl PipelineError {
    /// Whether a monitor asked to stop.
    pub fn is_interruption(&self) -> bool {
        match self {
            Self::Interrupted | Self::Abandoned => true,
            Self::CaptureEnded { ended, .. } => ended.is_interruption(),
            _ => false,
        }
    }
}

/// Why a stage ended, without how to go on.
fn short(error: &PipelineError) -> String {
    match error {
        PipelineError::Interrupted => "interrupted".to_owned(),
        error => error.to_string(),
    }
}

impl From<DataError> for PipelineError {
    fn from(error: DataError) -> Self {
        match error {
            DataError::Interrupted => Self::Interrupted,
            error => Self::Data(error),
        }
    }
}

impl From<CaptureError> for PipelineError {
    fn from(error: CaptureError) -> Self {
        match error {
            CaptureError::Rig(RigError::Interrupted) => Self::Interrupted,
            error => Self::Capture(error),
        }
    }
}

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

/// A run that diverged, and what it left.
#[derive(Debug, Error)]
#[error("{source}; {}", self.advice())]
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
    /// What is left, and how to go on.
    fn advice(&self) -> String {
        let kept = |what: &str, kept: &Option<(PathBuf, u64)>| match kept {
            Some((path, step)) => format!("the {what} is of step {step}, in {}", path.display()),
            None => format!("there is no {what} yet"),
        };
        let (state, model) = (
            kept("last good state", &self.state),
            kept("best network", &self.model),
        );
        format!(
            "{state}; {model}. The same command would come to the same end: {}",
            self.remedy()
        )
    }

    fn remedy(&self) -> String {
        if self.target == Target::Steps {
            return "distil into another folder (--out) with another --seed".to_owned();
        }
        let lower = format!(
            "train into another folder (--out) with a lower --learning-rate than {}, such as {:.1e}",
            self.learning_rate,
            self.learning_rate / 3.0
        );
        match &self.model {
            None => lower,
            Some((path, _)) => format!(
                "{lower}. To go on from the best network, other options as they were: tdcr train --init {} \
                 --learning-rate {:.1e} --out NEW",
                path.display(),
                self.learning_rate / 3.0
            ),
        }
    }
}

fn with_base(base: &BaseVisibility) -> &'static str {
    match base {
        BaseVisibility::Shown => "with the base",
        BaseVisibility::Hidden => "without the base",
    }
}

fn with_payload(payload: &Option<PayloadRange>) -> String {
    payload.map_or("without payloads".to_owned(), |range| {
        format!("with payloads of {range} kg")
    })
}
