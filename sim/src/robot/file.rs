//! Robot specifications in files, and why one is refused.

use std::path::{Path, PathBuf};

use thiserror::Error;

use super::RobotSpec;

/// Why a robot specification was refused.
#[derive(Debug, Error)]
pub enum SpecError {
    /// The name is neither a standard robot nor a file.
    #[error("unknown robot `{0}`: expected 2m, 3m, 5m or the path of a .toml or .json robot file")]
    Unknown(String),
    /// The file could not be read.
    #[error("cannot read robot file {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is not a robot specification.
    #[error("robot file {} is not a robot specification: {reason}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Where in the file, and what was expected there.
        reason: String,
    },
    /// A field has a value that no robot can have.
    #[error("robot field `{field}` is {value}; expected {expected}")]
    Field {
        /// The field's path, e.g. `modules[1].radius`.
        field: String,
        /// The value found.
        value: String,
        /// What would be right.
        expected: &'static str,
    },
}

const TWO_MODULES: &str = include_str!("../../robots/2m.toml");
const THREE_MODULES: &str = include_str!("../../robots/3m.toml");
const FIVE_MODULES: &str = include_str!("../../robots/5m.toml");

impl RobotSpec {
    /// Names of the paper's simulated robots.
    pub const STANDARD: [&str; 3] = ["2m", "3m", "5m"];

    /// One of the paper's simulated robots, by its name; `None` for any other name.
    pub fn standard(name: &str) -> Option<Self> {
        let text = match name {
            "2m" => TWO_MODULES,
            "3m" => THREE_MODULES,
            "5m" => FIVE_MODULES,
            _ => return None,
        };
        Some(toml::from_str(text).expect("the standard robots parse: a test loads each"))
    }

    /// A standard robot by name, or a robot file (TOML, or JSON by its extension), validated.
    ///
    /// # Errors
    /// [`SpecError`] when there is no such robot, or the file cannot be read, parsed or accepted.
    pub fn load(name_or_path: &str) -> Result<Self, SpecError> {
        if let Some(spec) = Self::standard(name_or_path) {
            return Ok(spec);
        }
        let path = Path::new(name_or_path);
        let is_json = path.extension().is_some_and(|e| e == "json");
        if !is_json && path.extension().is_none_or(|e| e != "toml") {
            return Err(SpecError::Unknown(name_or_path.to_owned()));
        }
        let text = std::fs::read_to_string(path).map_err(|source| SpecError::Read {
            path: path.to_owned(),
            source,
        })?;
        let parsed: Result<Self, String> = if is_json {
            serde_json::from_str(&text).map_err(|e| e.to_string())
        } else {
            toml::from_str(&text).map_err(|e| e.to_string())
        };
        let spec = parsed.map_err(|reason| SpecError::Parse {
            path: path.to_owned(),
            reason,
        })?;
        spec.validate()?;
        Ok(spec)
    }
}

pub(super) fn refuse(field: &str, value: impl ToString, expected: &'static str) -> SpecError {
    SpecError::Field {
        field: field.to_owned(),
        value: value.to_string(),
        expected,
    }
}
