//! From shapes as they are written to shapes that can be touched and seen.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use tdcr_base::files::{LARGEST_MESH, regular};

use super::SceneError;
use super::checks::{length, point, positive};
use super::error::refuse;
use super::shape_spec::ShapeSpec;
use crate::geometry::{Kind, Pipe, Shape, ShapeError};

/// Most points of all pipes of a scene, 2 of a straight one: each takes the memory of a ring of triangles.
const MOST_PIPE_POINTS: usize = 20_000;

/// Shape of an obstacle, in its own frame.
#[derive(Clone, Debug)]
pub enum ObstacleShape {
    /// All that is below the frame's x-y plane.
    HalfSpace,
    /// A box, sphere, capsule, cylinder or triangle mesh.
    Solid(Shape),
    /// A pipe.
    Pipe(Pipe),
}

/// Where shapes come from: the folder of the meshes, those read so far, and how much more the scene may take.
#[derive(Debug)]
pub(super) struct Sources {
    folder: PathBuf,
    meshes: HashMap<(PathBuf, u64), Shape>,
    mesh_bytes: u64,
    pipe_points: usize,
}

impl Sources {
    /// Meshes with relative paths are in `folder`.
    pub fn new(folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
            meshes: HashMap::new(),
            mesh_bytes: LARGEST_MESH,
            pipe_points: MOST_PIPE_POINTS,
        }
    }

    /// The shape that is written as `spec`. Errors name the `obstacle`.
    pub fn shape(&mut self, obstacle: &str, spec: &ShapeSpec) -> Result<ObstacleShape, SceneError> {
        let prefix = spec.field();
        let check = |field: &str, value: f64| length(obstacle, &format!("{prefix}.{field}"), value);
        let refused = |source: ShapeError| SceneError::Shape {
            obstacle: obstacle.to_owned(),
            source,
        };
        let solid = match spec {
            ShapeSpec::HalfSpace => return Ok(ObstacleShape::HalfSpace),
            ShapeSpec::Box { size } => {
                size.iter().try_for_each(|&side| check("size", side))?;
                Shape::cuboid(size.map(|side| side / 2.0))
            }
            &ShapeSpec::Sphere { radius } => {
                check("radius", radius)?;
                Shape::sphere(radius)
            }
            &ShapeSpec::Capsule { radius, length } => {
                check("radius", radius)?;
                check("length", length)?;
                Shape::capsule(radius, length / 2.0)
            }
            &ShapeSpec::Cylinder { radius, length } => {
                check("radius", radius)?;
                check("length", length)?;
                Shape::cylinder(radius, length / 2.0)
            }
            &ShapeSpec::Pipe { radius, length } => {
                check("radius", radius)?;
                check("length", length)?;
                self.take_points(obstacle, "pipe.length", 2)?;
                let pipe = Pipe::straight(radius, length).map_err(refused)?;
                return Ok(ObstacleShape::Pipe(pipe));
            }
            ShapeSpec::PipeAlong { radius, path } => {
                check("radius", *radius)?;
                self.check_path(obstacle, path)?;
                let pipe = Pipe::along(*radius, path).map_err(refused)?;
                return Ok(ObstacleShape::Pipe(pipe));
            }
            ShapeSpec::Mesh { file, scale } => {
                return Ok(ObstacleShape::Solid(self.mesh(obstacle, file, *scale)?));
            }
            ShapeSpec::Triangles {
                vertices,
                triangles,
            } => Shape::mesh(vertices, triangles),
        };
        Ok(ObstacleShape::Solid(solid.map_err(refused)?))
    }

    fn check_path(&mut self, obstacle: &str, path: &[[f64; 3]]) -> Result<(), SceneError> {
        if path.len() < 2 {
            let found = format!("a list of {}", path.len());
            return Err(refuse(obstacle, "pipe.path", found, "two points at least"));
        }
        self.take_points(obstacle, "pipe.path", path.len())?;
        for (index, place) in path.iter().enumerate() {
            point(obstacle, &format!("pipe.path[{index}]"), place)?;
        }
        Ok(())
    }

    fn take_points(&mut self, obstacle: &str, field: &str, count: usize) -> Result<(), SceneError> {
        let Some(left) = self.pipe_points.checked_sub(count) else {
            let found = format!("a line of {count} points, with {} left", self.pipe_points);
            let expected = "20000 points at most of all pipes together, 2 of a straight one";
            return Err(refuse(obstacle, field, found, expected));
        };
        self.pipe_points = left;
        Ok(())
    }

    /// A mesh of a file, which is read once.
    fn mesh(&mut self, obstacle: &str, file: &Path, scale: f64) -> Result<Shape, SceneError> {
        positive(obstacle, "mesh.scale", scale)?;
        let path = self.folder.join(file);
        let key = (path, scale.to_bits());
        if let Some(shape) = self.meshes.get(&key) {
            return Ok(shape.clone());
        }
        let path = &key.0;
        // Reading says what is wrong with a file without a length.
        let bytes = regular(path).map_or(0, |found| found.len());
        let Some(left) = self.mesh_bytes.checked_sub(bytes) else {
            let found = format!("{} of {bytes} bytes", path.display());
            let expected = "files of 256 MiB at most of all meshes together";
            return Err(refuse(obstacle, "mesh", found, expected));
        };
        let refused = |source| SceneError::Mesh {
            obstacle: obstacle.to_owned(),
            source,
        };
        let shape = Shape::read_stl(path).map_err(refused)?;
        let shape = scaled(shape, scale).map_err(|source| SceneError::Shape {
            obstacle: obstacle.to_owned(),
            source,
        })?;
        self.mesh_bytes = left;
        self.meshes.insert(key, shape.clone());
        Ok(shape)
    }
}

/// A mesh whose vertices are multiplied with `scale`.
fn scaled(shape: Shape, scale: f64) -> Result<Shape, ShapeError> {
    match &shape.0 {
        Kind::Mesh(mesh) if scale != 1.0 => {
            let vertices = mesh.mesh.vertices().iter();
            let vertices: Vec<[f64; 3]> = vertices
                .map(|v| [scale * v.x, scale * v.y, scale * v.z])
                .collect();
            Shape::mesh(&vertices, mesh.mesh.indices())
        }
        _ => Ok(shape),
    }
}

impl ObstacleShape {
    /// How a file says a mesh by its numbers; `None` for other shapes.
    pub(super) fn triangles(&self) -> Option<ShapeSpec> {
        match self {
            Self::Solid(Shape(Kind::Mesh(mesh))) => Some(ShapeSpec::Triangles {
                vertices: (mesh.mesh.vertices().iter())
                    .map(|v| [v.x, v.y, v.z])
                    .collect(),
                triangles: mesh.mesh.indices().to_vec(),
            }),
            _ => None,
        }
    }

    /// How a file says it, where the shape itself tells: not of meshes and pipes.
    pub(super) fn spec(&self) -> Option<ShapeSpec> {
        let shape = match self {
            Self::HalfSpace => return Some(ShapeSpec::HalfSpace),
            Self::Pipe(_) => return None,
            Self::Solid(shape) => shape,
        };
        match &shape.0 {
            Kind::Cuboid(cuboid) => Some(ShapeSpec::Box {
                size: (2.0 * cuboid.half).into(),
            }),
            Kind::Sphere(sphere) => Some(ShapeSpec::Sphere {
                radius: sphere.radius,
            }),
            Kind::Capsule(capsule) => Some(ShapeSpec::Capsule {
                radius: capsule.radius,
                length: 2.0 * capsule.half_length,
            }),
            Kind::Cylinder(cylinder) => Some(ShapeSpec::Cylinder {
                radius: cylinder.radius,
                length: 2.0 * cylinder.half_height,
            }),
            Kind::Mesh(_) => None,
        }
    }
}
