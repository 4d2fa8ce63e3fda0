//! Scenes from files or text.

use std::path::{Path, PathBuf, absolute};

use nalgebra::Translation3;
use pyo3::prelude::*;
use tdcr::sim::formats::mjcf;
use tdcr::sim::scene::{SceneError, SceneSpec, SelfContact, ShapeSpec};

use crate::arrays::quaternions;
use crate::errors::{Failure, Outcome};

/// Obstacles around a robot. Immutable, and cheap to hand around.
#[pyclass(frozen, module = "tdcr._tdcr")]
pub struct Scene(pub tdcr::sim::scene::Scene);

impl Scene {
    /// The scene of a specification, in which every mesh has an absolute path.
    fn compile(spec: SceneSpec) -> Result<Self, SceneError> {
        let turns: Vec<f64> = spec
            .obstacles
            .iter()
            .flat_map(|one| one.orientation)
            .collect();
        let scene = tdcr::sim::scene::Scene::compile(spec, Path::new(""))?;
        let mut obstacles = scene.obstacles().to_vec();
        // Unit quaternions stay what they are, so that a scene is the same to the last bit when it is read again.
        for (obstacle, turn) in obstacles.iter_mut().zip(quaternions(&turns)) {
            obstacle.pose.rotation = turn;
        }
        scene.with_obstacles(obstacles).map(Self)
    }
}

#[pymethods]
impl Scene {
    /// The scene of a file, or that of a MuJoCo model, with notes on what was passed over. Meshes beside a scene's file are named by
    /// their absolute paths from then on.
    #[staticmethod]
    fn load(path: PathBuf) -> Outcome<(Self, Vec<String>)> {
        let is_model = path
            .extension()
            .is_some_and(|ending| ending.eq_ignore_ascii_case("xml"));
        if is_model {
            let imported = mjcf::import_scene(&path)
                .map_err(|error| Failure::Of("SceneError", error.to_string()))?;
            let notes = imported.notes.iter().map(ToString::to_string).collect();
            return Ok((Self::compile(imported.scene.spec()?)?, notes));
        }
        let in_file = |error| SceneError::File {
            path: path.clone(),
            source: Box::new(error),
        };
        let mut spec = SceneSpec::load(&path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        for obstacle in &mut spec.obstacles {
            if let ShapeSpec::Mesh { file, .. } = &mut obstacle.shape {
                *file = absolute(folder.join(&*file))
                    .map_err(|error| in_file(SceneError::Read(error)))?;
            }
        }
        Ok((Self::compile(spec).map_err(in_file)?, Vec::new()))
    }

    /// The scene of the JSON text of a scene's file.
    #[staticmethod]
    fn from_json(text: &str) -> Outcome<Self> {
        let spec: SceneSpec = serde_json::from_str(text)
            .map_err(|error| Failure::Of("SceneError", error.to_string()))?;
        Ok(Self::compile(spec)?)
    }

    /// The scene's file as JSON text, from which the same scene is made.
    fn to_json(&self) -> Outcome<String> {
        serde_json::to_string(&self.0.spec()?)
            .map_err(|error| Failure::Of("SceneError", error.to_string()))
    }

    /// The scene's file as TOML text.
    fn to_toml(&self) -> Outcome<String> {
        Ok(self.0.to_toml()?)
    }

    /// How far discs that touch each other give way (m/N); None where they pass through each other.
    fn self_contact(&self) -> Option<f64> {
        match self.0.self_contact() {
            SelfContact::Ignored => None,
            SelfContact::Touching { compliance, .. } => Some(compliance),
        }
    }

    /// Coefficient of friction between discs.
    fn self_friction(&self) -> f64 {
        self.0.self_contact().friction()
    }

    /// Names of the obstacles, by their numbers.
    fn names(&self) -> Vec<String> {
        let obstacles = self.0.obstacles().iter();
        obstacles.map(|obstacle| obstacle.name.clone()).collect()
    }

    /// This scene with other poses of some obstacles: number, and where they change, position (m) and quaternion (w, x, y, z),
    /// not all 0.
    fn moved(&self, poses: Vec<Motion>) -> Outcome<Self> {
        let mut obstacles = self.0.obstacles().to_vec();
        let count = obstacles.len();
        for (number, position, orientation) in poses {
            let obstacle = obstacles.get_mut(number).ok_or_else(|| {
                let message = format!("obstacle {number} of {count}; expected one of the scene");
                Failure::Of("SceneError", message)
            })?;
            if let Some(position) = position {
                obstacle.pose.translation = Translation3::from(position);
            }
            if let Some(orientation) = orientation {
                obstacle.pose.rotation = quaternions(&orientation)[0];
            }
        }
        Ok(Self(self.0.with_obstacles(obstacles)?))
    }
}

/// Another pose of an obstacle: its number, position (m), and quaternion (w, x, y, z).
type Motion = (usize, Option<[f64; 3]>, Option<[f64; 4]>);
