//! Why a scene is refused.

use std::path::PathBuf;

use thiserror::Error;

use crate::geometry::{ShapeError, StlError};

/// Why there is no such scene. An obstacle is named by its number from 0, its name, or both: ``obstacle 2 `wall` ``.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The file is not that of a scene.
    #[error("scene file {}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: Box<SceneError>,
    },
    /// The file could not be read.
    #[error("it cannot be read: {0}")]
    Read(std::io::Error),
    /// The text is not TOML, or has fields that a scene has not.
    #[error("{}{reason}", .obstacle.as_ref().map(|which| format!("{which}: ")).unwrap_or_default())]
    Parse {
        /// The obstacle in question, if it is known.
        obstacle: Option<String>,
        /// Where in the file, and what was expected there.
        reason: String,
    },
    /// There are too many obstacles.
    #[error("{found} obstacles; expected {most} at most")]
    Count {
        /// Number of obstacles found.
        found: usize,
        /// Largest number.
        most: usize,
    },
    /// Two obstacles have one name.
    #[error("obstacles {} and {} are both named `{name}`; expected names of their own", .obstacles[0], .obstacles[1])]
    Name {
        /// The name.
        name: String,
        /// The two, by their numbers from 0.
        obstacles: [usize; 2],
    },
    /// An obstacle has no shape, or several.
    #[error("{obstacle} has {}; expected exactly one of {expected}", found_shapes(.found))]
    Shapes {
        /// The obstacle.
        obstacle: String,
        /// Fields of the shapes found.
        found: Vec<&'static str>,
        /// Fields that give a shape.
        expected: String,
    },
    /// A field has a value that no obstacle can have.
    #[error("{obstacle}: field `{field}` is {value}; expected {expected}")]
    Field {
        /// The obstacle.
        obstacle: String,
        /// The field's path, e.g. `sphere.radius`.
        field: String,
        /// The value found.
        value: String,
        /// What would be right.
        expected: &'static str,
    },
    /// Discs cannot give way so.
    #[error("`self_contact.compliance` is {compliance}; expected a number from 0 to 1e15 (m/N)")]
    SelfContact {
        /// The compliance found (m/N).
        compliance: f64,
    },
    /// Discs cannot rub so.
    #[error("`self_contact.friction` is {friction}; expected a number from 0 to 1e15")]
    SelfFriction {
        /// The coefficient found.
        friction: f64,
    },
    /// Contacts cannot be so smooth.
    #[error("`smoothing` is {0}; expected a number from 0 to 1 (J)")]
    Smoothing(f64),
    /// Contacts cannot push so.
    #[error("`contact_law.{field}` is {value}; expected {expected}")]
    ContactLaw {
        /// The field's path below `contact_law`.
        field: &'static str,
        /// The value found.
        value: String,
        /// What would be right.
        expected: &'static str,
    },
    /// There is no such shape.
    #[error("{obstacle}: {source}")]
    Shape {
        /// The obstacle.
        obstacle: String,
        /// Why not.
        source: ShapeError,
    },
    /// A mesh could not be read.
    #[error("{obstacle}: {source}")]
    Mesh {
        /// The obstacle.
        obstacle: String,
        /// Why not.
        source: StlError,
    },
    /// A mesh or a pipe that was not made from numbers or a file is not written to files.
    #[error(
        "{obstacle} is a mesh or a pipe made in memory; expected one of a file, or by its numbers, to write it"
    )]
    Unwritten {
        /// The obstacle.
        obstacle: String,
    },
    /// The meshes have more triangles than are written by their numbers.
    #[error("meshes of {found} triangles; expected {most} at most to write a scene whole")]
    Triangles {
        /// Number of triangles of all meshes.
        found: usize,
        /// Largest number.
        most: usize,
    },
    /// The scene has what TOML cannot say, such as a file's name that is not UTF-8.
    #[error("the scene cannot be written as TOML: {0}")]
    Write(toml::ser::Error),
}

fn found_shapes(found: &[&str]) -> String {
    match found {
        [] => "no shape".to_owned(),
        _ => format!("the shapes `{}`", found.join("` and `")),
    }
}

/// What an error calls an obstacle: its number from 0 where it is in a list, and its name where it has one.
pub(super) fn called(index: Option<usize>, name: Option<&str>) -> String {
    let number = index.map_or(String::new(), |index| format!(" {index}"));
    match name {
        // A name by the number says nothing more.
        Some(name) if name.strip_prefix("obstacle") != Some(&number) => {
            format!("obstacle{number} `{name}`")
        }
        _ => format!("obstacle{number}"),
    }
}

/// Refuses the value of a field of an obstacle.
pub(super) fn refuse(
    obstacle: &str,
    field: &str,
    value: impl ToString,
    expected: &'static str,
) -> SceneError {
    SceneError::Field {
        obstacle: obstacle.to_owned(),
        field: field.to_owned(),
        value: value.to_string(),
        expected,
    }
}
