//! Why a study is not done.

use std::path::PathBuf;

use tdcr_learn::data::DataError;
use tdcr_sim::formats::RobotFileError;
use tdcr_sim::scene::SceneError;
use thiserror::Error;

use crate::pipeline::PipelineError;

/// Why a study ended before it was done.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum StudyError {
    /// The monitor asked to stop. What was done is kept, and the same call goes on.
    #[error("interrupted")]
    Interrupted,
    /// The study's file could not be read.
    #[error("cannot read study {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is not a study.
    #[error("study {}: {reason}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Where in the file, and what was expected there.
        reason: String,
    },
    /// A key of the file has a value that no study can have.
    #[error("study {}: {refusal}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Which key, and what would be right.
        refusal: Box<Refusal>,
    },
    /// A folder or file could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The folder or file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The table as Parquet could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Parquet {
        /// The file.
        path: PathBuf,
        /// What the library said.
        source: parquet::errors::ParquetError,
    },
    /// The folder holds another study, or another part of it.
    #[error("{} holds another study, another part of it, or one by another version", path.display())]
    OtherStudy {
        /// The folder.
        path: PathBuf,
    },
    /// Another process works in the folder.
    #[error("{} is being written by another process", path.display())]
    InUse {
        /// The folder.
        path: PathBuf,
    },
    /// A table was changed, or is not one of a study.
    #[error("{} line {line}: {reason}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// A folder to merge holds no finished part.
    #[error("{} is not a finished part of a study: {reason}", path.display())]
    NoPart {
        /// The folder.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The folders are not all parts of one study, each once.
    #[error("{reason}; expected all parts of one study, each once")]
    OtherParts {
        /// What is wrong.
        reason: String,
    },
    /// The points of the design cannot be made.
    #[error(transparent)]
    Design(#[from] DataError),
}

/// Which key of a study's file is refused, and why.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Refusal {
    /// A value out of place.
    #[error("`{key}` is {found}; expected {expected}")]
    Value {
        /// The key, such as `vary[1].range`.
        key: String,
        /// What was found.
        found: String,
        /// What would be right.
        expected: String,
    },
    /// No file of a trained model.
    #[error("`model.file` is {found}, which is not there; expected the file of a trained model")]
    NoModel {
        /// The file.
        found: String,
    },
    /// A robot that cannot be read.
    #[error("`{key}`: {source}")]
    Robot {
        /// The key.
        key: String,
        /// Why.
        source: RobotFileError,
    },
    /// A scene that cannot be read, or not be kept whole.
    #[error("`{key}`: {source}")]
    Scene {
        /// The key.
        key: String,
        /// Why.
        source: SceneError,
    },
    /// An output that tells of obstacles, without any.
    #[error(
        "`want` has \"{output}\", and there is no scene; expected a `scene` with obstacles, or another output"
    )]
    NoScene {
        /// The output's name.
        output: &'static str,
    },
    /// The first configuration, or one that a value of a variable makes of it, cannot be simulated.
    #[error("`{key}` is {found}, and no robot comes of it: {reason}")]
    Configuration {
        /// The key.
        key: String,
        /// The value.
        found: String,
        /// What the robot said.
        reason: String,
    },
    /// A design that has no such points.
    #[error("`sample`: {0}")]
    Design(#[from] DataError),
}

impl Refusal {
    /// A value out of place.
    pub(super) fn value(
        key: impl Into<String>,
        found: impl ToString,
        expected: impl Into<String>,
    ) -> Self {
        Self::Value {
            key: key.into(),
            found: found.to_string(),
            expected: expected.into(),
        }
    }
}

impl From<PipelineError> for StudyError {
    fn from(error: PipelineError) -> Self {
        match error {
            PipelineError::Interrupted | PipelineError::Abandoned => Self::Interrupted,
            PipelineError::InUse { path } => Self::InUse { path },
            PipelineError::Write { path, source } => Self::Write { path, source },
            other => Self::OtherParts {
                reason: other.to_string(),
            },
        }
    }
}
