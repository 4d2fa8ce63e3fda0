//! Shapes of obstacles as the user writes them, and as files have them.

use std::fmt;
use std::path::PathBuf;

use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

/// Shape of an obstacle, in its own frame.
#[derive(Clone, Debug, PartialEq)]
pub enum ShapeSpec {
    /// All that is below the frame's x-y plane: `half_space = {}`.
    HalfSpace,
    /// A box along the axes, about the origin.
    Box {
        /// Its sides, whole (m).
        size: [f64; 3],
    },
    /// A sphere about the origin.
    Sphere {
        /// Its radius (m).
        radius: f64,
    },
    /// A cylinder about the z axis with a half ball on each end, its middle at the origin.
    Capsule {
        /// Radius of cylinder and balls (m).
        radius: f64,
        /// Distance between the centres of the balls, the length of the cylinder (m).
        length: f64,
    },
    /// A cylinder about the z axis, its middle at the origin.
    Cylinder {
        /// Its radius (m).
        radius: f64,
        /// Its length (m).
        length: f64,
    },
    /// A straight pipe: [`Pipe::straight`](crate::geometry::Pipe::straight).
    Pipe {
        /// Radius of the bore (m).
        radius: f64,
        /// Its length (m).
        length: f64,
    },
    /// A pipe along a line: [`Pipe::along`](crate::geometry::Pipe::along).
    PipeAlong {
        /// Radius of the bore (m).
        radius: f64,
        /// Points of its middle line (m).
        path: Vec<[f64; 3]>,
    },
    /// A triangle mesh from an STL file.
    Mesh {
        /// The file; a relative path is one from the folder of the scene's file.
        file: PathBuf,
        /// What the file's numbers are multiplied with to give metres; 0.001 for millimetres.
        scale: f64,
    },
    /// A triangle mesh by its numbers.
    Triangles {
        /// Its vertices (m).
        vertices: Vec<[f64; 3]>,
        /// The vertices of each triangle, by their numbers from 0, counterclockwise as seen from outside.
        triangles: Vec<[u32; 3]>,
    },
}

impl ShapeSpec {
    /// The field that gives it.
    pub(super) fn field(&self) -> &'static str {
        match self {
            Self::HalfSpace => "half_space",
            Self::Box { .. } => "box",
            Self::Sphere { .. } => "sphere",
            Self::Capsule { .. } => "capsule",
            Self::Cylinder { .. } => "cylinder",
            Self::Pipe { .. } | Self::PipeAlong { .. } => "pipe",
            Self::Mesh { .. } | Self::Triangles { .. } => "mesh",
        }
    }
}

/// `half_space = {}`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table without fields, {}")]
pub(super) struct HalfSpaceInFile {}

/// `box = { size = [x, y, z] }`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table { size }")]
pub(super) struct BoxInFile {
    pub size: [f64; 3],
}

/// `sphere = { radius = r }`.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table { radius }")]
pub(super) struct SphereInFile {
    pub radius: f64,
}

/// `capsule = { radius = r, length = l }`, and the same of a cylinder.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table { radius, length }")]
pub(super) struct RoundInFile {
    pub radius: f64,
    pub length: f64,
}

/// `pipe = { radius = r, length = l }`, or a `path` in place of the length.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "a table { radius, length } or { radius, path }"
)]
pub(super) struct PipeInFile {
    pub radius: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub path: Option<Vec<[f64; 3]>>,
}

/// `mesh = "file.stl"`, `mesh = { file = "file.stl", scale = s }` or `mesh = { vertices = [...], triangles = [...] }`.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub(super) enum MeshInFile {
    File {
        file: PathBuf,
        #[serde(skip_serializing_if = "is_one")]
        scale: f64,
    },
    Numbers {
        vertices: Vec<[f64; 3]>,
        triangles: Vec<[u32; 3]>,
    },
}

/// The second form and the third.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MeshTable {
    file: Option<PathBuf>,
    scale: Option<f64>,
    vertices: Option<Vec<[f64; 3]>>,
    triangles: Option<Vec<[u32; 3]>>,
}

impl<'de> Deserialize<'de> for MeshInFile {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(MeshVisitor)
    }
}

struct MeshVisitor;

impl<'de> Visitor<'de> for MeshVisitor {
    type Value = MeshInFile;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("the name of an STL file, { file, scale }, or { vertices, triangles }")
    }

    fn visit_str<E>(self, file: &str) -> Result<MeshInFile, E> {
        let file = file.into();
        Ok(MeshInFile::File { file, scale: 1.0 })
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<MeshInFile, A::Error> {
        let MeshTable {
            file,
            scale,
            vertices,
            triangles,
        } = MeshTable::deserialize(MapAccessDeserializer::new(map))?;
        match (file, scale, vertices, triangles) {
            (Some(file), scale, None, None) => {
                let scale = scale.unwrap_or(1.0);
                Ok(MeshInFile::File { file, scale })
            }
            (None, None, Some(vertices), Some(triangles)) => Ok(MeshInFile::Numbers {
                vertices,
                triangles,
            }),
            _ => Err(A::Error::custom(
                "expected a mesh with `file` and perhaps `scale`, or one with `vertices` and `triangles`",
            )),
        }
    }
}

fn is_one(value: &f64) -> bool {
    *value == 1.0
}
