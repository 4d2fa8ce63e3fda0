//! Scenes in records, such as that of a data set: whole, so that no other file is needed to make them again.

use std::path::Path;
use std::sync::Arc;

use serde::de::Error as _;
use serde::ser::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::error::called;
use super::{Scene, SceneError, SceneSpec, SelfContact, ShapeSpec};

/// Most triangles of a scene that is written whole: their numbers take 40 MB as indented JSON.
const MOST_TRIANGLES: usize = 100_000;

impl Scene {
    /// What a file says to give this scene without any other file: meshes by their numbers (m).
    ///
    /// # Errors
    /// [`SceneError::Unwritten`] for a pipe that was made in memory, [`SceneError::Triangles`] for meshes of more than 100,000
    /// triangles together.
    pub fn whole_spec(&self) -> Result<SceneSpec, SceneError> {
        let obstacles = self.obstacles.iter().enumerate();
        let obstacles = obstacles.map(|(index, obstacle)| {
            obstacle.whole_spec(&called(Some(index), Some(&obstacle.name)))
        });
        let spec = SceneSpec {
            obstacles: obstacles.collect::<Result<_, _>>()?,
            self_contact: self.self_contact,
            contact_law: self.contact_law,
            smoothing: self.smoothing,
        };
        let triangles = spec.obstacles.iter().map(|obstacle| match &obstacle.shape {
            ShapeSpec::Triangles { triangles, .. } => triangles.len(),
            _ => 0,
        });
        let (found, most) = (triangles.sum(), MOST_TRIANGLES);
        match found <= most {
            true => Ok(spec),
            false => Err(SceneError::Triangles { found, most }),
        }
    }

    /// Whether robots touch nothing: there are no obstacles, and they pass through themselves.
    pub fn is_empty(&self) -> bool {
        self.obstacles.is_empty() && self.self_contact == SelfContact::Ignored
    }
}

/// Whether all numbers and names are the same; a scene that cannot be written whole is the same as its clones alone.
impl PartialEq for Scene {
    fn eq(&self, other: &Self) -> bool {
        let rules = |scene: &Self| (scene.self_contact, scene.contact_law, scene.smoothing);
        (Arc::ptr_eq(&self.obstacles, &other.obstacles) && rules(self) == rules(other))
            || matches!((self.whole_spec(), other.whole_spec()), (Ok(own), Ok(other)) if own == other)
    }
}

/// As [`Scene::whole_spec`].
impl Serialize for Scene {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let spec = self.whole_spec().map_err(S::Error::custom)?;
        spec.serialize(serializer)
    }
}

/// A scene that was written whole: a record names no files that are read along with it.
impl<'de> Deserialize<'de> for Scene {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let spec = SceneSpec::deserialize(deserializer)?;
        let in_file = |shape: &ShapeSpec| matches!(shape, ShapeSpec::Mesh { .. });
        if let Some(obstacle) = spec.obstacles.iter().find(|one| in_file(&one.shape)) {
            let name = &obstacle.name;
            return Err(D::Error::custom(format!(
                "obstacle `{name}` is a mesh in a file; expected one with `vertices` and `triangles`"
            )));
        }
        Self::compile(spec, Path::new("")).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;
    use crate::scene::Obstacle;

    /// A tetrahedron as an STL file.
    fn stl(folder: &Path) -> std::path::PathBuf {
        let corners = [[0, 0, 0], [31, 0, 0], [0, 32, 0], [0, 0, 33]];
        let faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        let mut text = "solid t\n".to_owned();
        for face in faces {
            text += "facet normal 0 0 0\nouter loop\n";
            for [x, y, z] in face.map(|corner: usize| corners[corner]) {
                text += &format!("vertex {x} {y} {z}\n");
            }
            text += "endloop\nendfacet\n";
        }
        let path = folder.join("t.stl");
        std::fs::write(&path, text + "endsolid t\n").unwrap();
        path
    }

    fn scene(folder: &Path) -> Scene {
        let tetrahedron = Obstacle::mesh("tetrahedron", &stl(folder), 0.001).unwrap();
        let path = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.2], [0.1, 0.0, 0.3]];
        let pipe = Obstacle::pipe_along("pipe", 0.02, &path).unwrap();
        let turned = pipe.with_orientation([0.3, 0.1, -0.7, 0.2]).unwrap();
        Scene::new(vec![Obstacle::half_space("floor"), turned, tetrahedron]).unwrap()
    }

    #[test]
    fn a_scene_in_a_record_is_the_same_to_the_last_bit_without_its_files() {
        let folder = tempfile::tempdir().unwrap();
        let written = scene(folder.path());
        let text = serde_json::to_string(&written).unwrap();
        drop(folder);
        let mut read: Scene = serde_json::from_str(&text).unwrap();
        for _ in 0..3 {
            assert!(read == written);
            assert_eq!(serde_json::to_string(&read).unwrap(), text);
            read = serde_json::from_str(&serde_json::to_string(&read).unwrap()).unwrap();
        }
        let point = nalgebra::Vector3::new(0.04, 0.05, 0.06);
        let distance = |scene: &Scene| match &scene.obstacles()[2].shape {
            super::super::ObstacleShape::Solid(shape) => shape.nearest(&point).distance,
            _ => f64::NAN,
        };
        assert_eq!(distance(&read), distance(&written));
    }

    #[test]
    fn scenes_differ_where_a_number_does() {
        let folder = tempfile::tempdir().unwrap();
        let one = scene(folder.path());
        let mut obstacles = one.obstacles().to_vec();
        obstacles[1].pose.translation.x += 1e-15;
        assert!(one == one.clone() && one != Scene::new(obstacles).unwrap());
        assert!(one != Scene::default() && Scene::default() == Scene::default());
        let through = one.clone().with_self_contact(SelfContact::Ignored).unwrap();
        assert!(one != through && through == through.clone());
    }

    #[test]
    fn a_record_reads_no_other_file() {
        let text = r#"{"obstacle": [{"name": "part", "mesh": "/dev/zero"}]}"#;
        let error = serde_json::from_str::<Scene>(text).unwrap_err().to_string();
        assert!(
            error.contains("obstacle `part` is a mesh in a file"),
            "{error}"
        );
    }

    #[test]
    fn a_mesh_of_too_many_triangles_is_refused() {
        let strip: Vec<[f64; 3]> = (0..=100_002)
            .map(|k| [f64::from(k), f64::from(k % 2), 0.0])
            .collect();
        let triangles: Vec<[u32; 3]> = (0..100_001).map(|k| [k, k + 1, k + 2]).collect();
        let shape = crate::geometry::Shape::mesh(&strip, &triangles).unwrap();
        let obstacle = Obstacle::new("strip", super::super::ObstacleShape::Solid(shape));
        let scene = Scene::new(vec![obstacle]).unwrap();
        let refused = scene.whole_spec().unwrap_err().to_string();
        assert_eq!(
            refused,
            "meshes of 100001 triangles; expected 100000 at most to write a scene whole"
        );
    }
}
