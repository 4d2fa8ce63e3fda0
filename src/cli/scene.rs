//! Obstacles around the robot as an option.

use std::path::{Path, PathBuf};

use clap::Args;
use tdcr::sim::formats::load_scene;
use tdcr::sim::scene::Scene;

/// What is around the robot.
#[derive(Debug, Args)]
pub(super) struct SceneArgs {
    /// Obstacles around the robot: a scene file (.toml), or those of a MuJoCo model (.xml)
    #[arg(long = "scene", value_name = "FILE")]
    scene: Option<PathBuf>,
}

impl SceneArgs {
    /// Whether there is a file.
    pub fn is_given(&self) -> bool {
        self.scene.is_some()
    }

    /// The scene of the file, if one is given.
    pub fn given(&self) -> anyhow::Result<Option<Scene>> {
        self.scene.as_deref().map(load).transpose()
    }

    /// The scene of the file; the one without obstacles where none is given.
    pub fn load(&self) -> anyhow::Result<Scene> {
        Ok(self.given()?.unwrap_or_default())
    }
}

/// The scene of a file.
pub(super) fn load(file: &Path) -> anyhow::Result<Scene> {
    let (scene, notes) = load_scene(file)?;
    super::warn_of(&notes);
    Ok(scene)
}
