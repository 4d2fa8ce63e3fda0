//! Priors and bounds of unknowns as files.

use std::path::{Path, PathBuf};

use tdcr_base::files::{LARGEST_TEXT, Table, read_text, with_place, without_mark};
use tdcr_sim::inverse::{Prior, PriorError, Priors};

use super::RecordingFileError;

/// What is known of unknowns before a fit, as a TOML file has it: a table for each group or unknown, by its name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GivenPriors {
    /// The file, or what else messages call them.
    pub source: PathBuf,
    /// What it says.
    pub priors: Priors,
}

impl GivenPriors {
    /// Reads a file of priors. Whether they are of unknowns that are fitted shows in the fit.
    ///
    /// # Errors
    /// [`RecordingFileError`] for a file that cannot be read, or has other keys.
    pub fn load(path: &Path) -> Result<Self, RecordingFileError> {
        let text = read_text(path, LARGEST_TEXT).map_err(|source| RecordingFileError::Read {
            path: path.to_owned(),
            source,
        })?;
        Self::of(
            path,
            toml::from_str(&text).map_err(|error| error.to_string()),
        )
    }

    /// Priors from JSON text of the same keys.
    ///
    /// # Errors
    /// [`RecordingFileError::Priors`].
    pub fn from_json(text: &str) -> Result<Self, RecordingFileError> {
        let read = serde_json::from_str(without_mark(text));
        Self::of(Path::new("priors"), read.map_err(|error| error.to_string()))
    }

    /// What is wrong with these priors, as a fit found.
    pub fn refused(&self, error: &PriorError) -> RecordingFileError {
        RecordingFileError::Priors {
            path: self.source.clone(),
            reason: error.to_string(),
        }
    }

    fn of(source: &Path, read: Result<Priors, String>) -> Result<Self, RecordingFileError> {
        let source = source.to_owned();
        let tables = [Table::of::<Prior>("the table of a group or an unknown")];
        match read {
            Ok(priors) => Ok(Self { source, priors }),
            Err(wrong) => Err(RecordingFileError::Priors {
                path: source,
                reason: with_place(&wrong, &tables),
            }),
        }
    }
}
