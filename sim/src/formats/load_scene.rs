//! Scenes by path: their own files, and what stands around a robot in files of other tools.

use std::path::Path;

use thiserror::Error;

use super::{ImportError, Note, mjcf};
use crate::scene::{Scene, SceneError};

/// Why a scene was not read from a file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SceneFileError {
    /// It is not the file of a scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The file is of another tool, and says what cannot be read here.
    #[error(transparent)]
    Import(Box<ImportError>),
}

impl From<ImportError> for SceneFileError {
    fn from(error: ImportError) -> Self {
        Self::Import(Box::new(error))
    }
}

/// The scene of a file, and notes on what was passed over: of a MuJoCo model (`.xml`) what [`mjcf::import_scene`] reads, else of a
/// scene's file ([`Scene::load`]).
///
/// # Errors
/// [`SceneFileError`] when the file cannot be read or is neither.
pub fn load_scene(path: &Path) -> Result<(Scene, Vec<Note>), SceneFileError> {
    let extension = path.extension().and_then(|extension| extension.to_str());
    match extension.map(str::to_ascii_lowercase).as_deref() {
        Some("xml") => {
            let imported = mjcf::import_scene(path)?;
            Ok((imported.scene, imported.notes))
        }
        _ => Ok((Scene::load(path)?, Vec::new())),
    }
}
