//! Robots as options.

use serde::{Deserialize, Serialize};
use tdcr_sim::formats::RobotFileError;
use tdcr_sim::robot::RobotSpec;

/// A robot that an option asks for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum RobotChoice {
    /// By its name, or its file.
    Named(String),
    /// As its file says.
    Described(Box<RobotSpec>),
}

impl RobotChoice {
    /// The robot.
    ///
    /// # Errors
    /// [`RobotFileError`] where there is no robot of this name, or its file cannot be read, parsed or accepted.
    pub fn load(&self) -> Result<RobotSpec, RobotFileError> {
        match self {
            Self::Named(name) => RobotSpec::load(name),
            Self::Described(spec) => Ok((**spec).clone()),
        }
    }
}

impl From<String> for RobotChoice {
    fn from(name: String) -> Self {
        Self::Named(name)
    }
}

impl From<RobotSpec> for RobotChoice {
    fn from(spec: RobotSpec) -> Self {
        Self::Described(Box::new(spec))
    }
}
