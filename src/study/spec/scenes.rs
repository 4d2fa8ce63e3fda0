//! Scenes of a study: which there are, and what cannot be said without any.

use std::path::Path;

use tdcr_sim::scene::{Scene, SceneError};

use super::{Output, Study};
use crate::study::error::Refusal;

/// The scene of the file `name`, a path from `folder`. Errors name the `key`.
pub(super) fn load(key: &str, name: &str, folder: &Path) -> Result<Scene, Refusal> {
    Scene::load(&folder.join(name))
        .and_then(whole)
        .map_err(|source| Refusal::Scene {
            key: key.to_owned(),
            source,
        })
}

/// The scene of all configurations: that `given`, or else of the file `name`, or else nothing.
pub(super) fn of_all(
    given: Option<&Scene>,
    name: Option<&str>,
    folder: &Path,
) -> Result<Scene, Refusal> {
    match (given, name) {
        (Some(scene), _) => whole(scene.clone()).map_err(|source| Refusal::Scene {
            key: "scene".to_owned(),
            source,
        }),
        (None, Some(name)) => load("scene", name, folder),
        (None, None) => Ok(Scene::default()),
    }
}

/// The scene, if a record can hold it: another study has another.
fn whole(scene: Scene) -> Result<Scene, SceneError> {
    scene.whole_spec().map(|_| scene)
}

impl Study {
    /// Refuses an output of obstacles without any.
    pub(super) fn check_scenes(&self) -> Result<(), Refusal> {
        let around = self.all_scenes().any(|scene| !scene.is_empty());
        if !around && self.want.contains(&Output::Contact) {
            let output = Output::Contact.name();
            return Err(Refusal::NoScene { output });
        }
        Ok(())
    }
}
