//! The pages that the command line and the Python package write: of an evaluation, of data sets, of the demo, of
//! two data sets beside each other.
//!
//! Here the results of the [`pipeline`](crate::pipeline) become the plain data of a [`report`](crate::report).

mod calibration;
mod comparison;
mod data_sets;
mod demo;
mod evaluation;
mod methods;
mod set_info;

pub use calibration::CalibrationPage;
pub use comparison::comparison_page;
pub use data_sets::{CLOUDS_SHOWN, DataDrawing};
pub use demo::{Demo, DemoMetrics, DemoSettings, demo};
pub use evaluation::{Evaluated, evaluation_page, headline};
pub use methods::methods_page;
pub use set_info::{PayloadInfo, SetInfo};

use std::io::Write;
use std::path::{Path, PathBuf};

use tdcr_learn::data::SimulateError;
use thiserror::Error;

use crate::pipeline::PipelineError;

/// Why there is no page.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PageError {
    /// A stage failed or was interrupted, or a file cannot be written.
    #[error(transparent)]
    Stage(#[from] PipelineError),
    /// The file to write has no extension of a drawing.
    #[error("{} has none of the extensions .html, .svg and .png", path.display())]
    DrawingFormat {
        /// The file.
        path: PathBuf,
    },
    /// A picture of clouds is to show another number of data sets than one.
    #[error(
        "a .png shows the clouds of one data set, and there are {found}; expected one folder, or a file with .html or .svg"
    )]
    SeveralSets {
        /// Data sets.
        found: usize,
    },
    /// The demo's folder holds a data set of another size.
    #[error(
        "{} holds {found} samples, and {expected} are asked for",
        path.display()
    )]
    OtherCount {
        /// Folder of the data set.
        path: PathBuf,
        /// Its samples.
        found: usize,
        /// Samples asked for.
        expected: usize,
    },
    /// The results have no JSON form.
    #[error("cannot write the metrics as JSON: {0}")]
    Json(#[from] serde_json::Error),
}

impl From<SimulateError> for PageError {
    fn from(error: SimulateError) -> Self {
        Self::Stage(error.into())
    }
}

/// The name that a data set goes by: its folder's.
pub fn set_name(dir: &Path) -> String {
    let name = dir.file_name().unwrap_or(dir.as_os_str());
    name.to_string_lossy().into_owned()
}

/// Writes a file that is whole, or keeps what it held.
fn write(path: &Path, bytes: &[u8]) -> Result<(), PipelineError> {
    tdcr_base::files::write_atomically(path, |file| file.write_all(bytes)).map_err(|source| {
        PipelineError::Write {
            path: path.to_owned(),
            source,
        }
    })
}
