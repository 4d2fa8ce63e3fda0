//! Obstacles around the robot as an option.

use std::path::PathBuf;

use clap::Args;
use tdcr::sim::scene::{Scene, SceneError};

/// What is around the robot.
#[derive(Debug, Args)]
pub(super) struct SceneArgs {
    /// Obstacles around the robot: a scene file (.toml)
    #[arg(long = "scene", value_name = "FILE")]
    file: Option<PathBuf>,
}

impl SceneArgs {
    /// The scene of the file; the one without obstacles where none is given.
    pub fn load(&self) -> Result<Scene, SceneError> {
        match &self.file {
            Some(file) => Scene::load(file),
            None => Ok(Scene::default()),
        }
    }
}
