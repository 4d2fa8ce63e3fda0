//! Shapes of solids.

use std::sync::{Arc, OnceLock};

use nalgebra::{Matrix3, Vector3};
use parry3d_f64::math::Vec3;
use parry3d_f64::shape::{TriMesh, TriMeshFlags};
use serde::Serialize;
use thiserror::Error;

use super::primitives::{Capsule, Cuboid, Cylinder, Mesh, Sphere};

/// A shape, centred on its frame's origin; a mesh wherever its vertices are.
#[derive(Clone, Debug)]
pub struct Shape(pub(crate) Kind);

#[derive(Clone, Debug)]
pub(crate) enum Kind {
    Cylinder(Cylinder),
    Cuboid(Cuboid),
    Sphere(Sphere),
    Capsule(Capsule),
    Mesh(Arc<Mesh>),
}

/// Why there is no such shape.
#[non_exhaustive]
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ShapeError {
    /// A length that is not above 0.
    #[error("the {what} of a {shape} is {value} m; expected a finite length above 0")]
    Length {
        /// The shape.
        shape: &'static str,
        /// Which length.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A vertex that is not finite.
    #[error("vertex {index} of a mesh is {position:?}; expected finite numbers")]
    Vertex {
        /// The vertex.
        index: usize,
        /// Its position (m).
        position: [f64; 3],
    },
    /// A triangle with a vertex that there is not.
    #[error("triangle {index} of a mesh is {vertices:?}; the mesh has {count} vertices")]
    Triangle {
        /// The triangle.
        index: usize,
        /// Its vertices' numbers.
        vertices: [u32; 3],
        /// Number of vertices.
        count: usize,
    },
    /// A mesh without triangles.
    #[error("a mesh has no triangles; expected one at least")]
    Empty,
    /// A path of fewer than two points.
    #[error("a pipe's path has {count} points; expected two at least")]
    Path {
        /// Number of points.
        count: usize,
    },
    /// A point of a path that is not finite, or so far away that products of its coordinates are not.
    #[error("point {index} of a pipe's path is {position:?}; expected finite numbers below 1e150")]
    PathPoint {
        /// The point.
        index: usize,
        /// Its position (m).
        position: [f64; 3],
    },
    /// A point of a path at the position of the one before.
    #[error("point {index} of a pipe's path is the one before it again; expected another position")]
    PathRepeats {
        /// The point.
        index: usize,
    },
    /// A point at which a path turns back the way it came.
    #[error("a pipe's path turns back at point {index}; expected a bend of less than 180 degrees")]
    PathFolds {
        /// The point.
        index: usize,
    },
    /// A bend that is too narrow for its pipe.
    #[error(
        "a pipe of radius {radius} m bends with a radius of {bend} m at point {index} of its path; expected more than the pipe's, \
         by segments longer than {segment} m there"
    )]
    Bend {
        /// The point.
        index: usize,
        /// Radius of the arc (m).
        bend: f64,
        /// Radius of the pipe (m).
        radius: f64,
        /// Length that both segments at the point must exceed (m).
        segment: f64,
    },
}

/// What a shape is, by its dimensions (m).
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Dimensions {
    /// A cylinder about the z axis.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Half of the height.
        half_height: f64,
    },
    /// A box along the axes.
    Cuboid {
        /// Half of each side.
        half_sides: [f64; 3],
    },
    /// A sphere.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// What is within `radius` of a piece of the z axis.
    Capsule {
        /// Radius.
        radius: f64,
        /// Half of the piece's length.
        half_length: f64,
    },
    /// Triangles.
    Mesh {
        /// Positions.
        vertices: Vec<[f64; 3]>,
        /// Vertices of each triangle, counterclockwise as seen from outside.
        triangles: Vec<[u32; 3]>,
    },
}

impl Shape {
    /// What the shape is, for whoever draws it.
    pub fn dimensions(&self) -> Dimensions {
        match &self.0 {
            Kind::Cylinder(it) => Dimensions::Cylinder {
                radius: it.radius,
                half_height: it.half_height,
            },
            Kind::Cuboid(it) => Dimensions::Cuboid {
                half_sides: it.half.into(),
            },
            Kind::Sphere(it) => Dimensions::Sphere { radius: it.radius },
            Kind::Capsule(it) => Dimensions::Capsule {
                radius: it.radius,
                half_length: it.half_length,
            },
            Kind::Mesh(it) => Dimensions::Mesh {
                vertices: it.mesh.vertices().iter().map(|v| [v.x, v.y, v.z]).collect(),
                triangles: it.mesh.indices().to_vec(),
            },
        }
    }

    /// A cylinder about the z axis, of a radius and half its height (m).
    ///
    /// # Errors
    /// [`ShapeError::Length`] unless both are finite and above 0.
    pub fn cylinder(radius: f64, half_height: f64) -> Result<Self, ShapeError> {
        Ok(Self(Kind::Cylinder(Cylinder {
            radius: length("cylinder", "radius", radius)?,
            half_height: length("cylinder", "half height", half_height)?,
        })))
    }

    /// A box along the axes, of half its sides (m).
    ///
    /// # Errors
    /// [`ShapeError::Length`] unless all are finite and above 0.
    pub fn cuboid(half_sides: [f64; 3]) -> Result<Self, ShapeError> {
        for side in half_sides {
            length("box", "half side", side)?;
        }
        Ok(Self(Kind::Cuboid(Cuboid {
            half: half_sides.into(),
        })))
    }

    /// A sphere of a radius (m).
    ///
    /// # Errors
    /// [`ShapeError::Length`] unless it is finite and above 0.
    pub fn sphere(radius: f64) -> Result<Self, ShapeError> {
        Ok(Self(Kind::Sphere(Sphere {
            radius: length("sphere", "radius", radius)?,
        })))
    }

    /// All points within `radius` of the piece of the z axis from `-half_length` to `half_length` (m).
    ///
    /// # Errors
    /// [`ShapeError::Length`] unless both are finite and above 0.
    pub fn capsule(radius: f64, half_length: f64) -> Result<Self, ShapeError> {
        Ok(Self(Kind::Capsule(Capsule {
            radius: length("capsule", "radius", radius)?,
            half_length: length("capsule", "half length", half_length)?,
        })))
    }

    /// A triangle mesh: vertices (m) and triangles of three vertices' numbers. Both sides of a
    /// triangle are seen.
    ///
    /// # Errors
    /// [`ShapeError`] for a vertex that is not finite, a triangle of vertices that there are not, or
    /// no triangle.
    pub fn mesh(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Self, ShapeError> {
        for (index, &position) in vertices.iter().enumerate() {
            if !position.iter().all(|x| x.is_finite()) {
                return Err(ShapeError::Vertex { index, position });
            }
        }
        let count = vertices.len();
        for (index, &vertices) in triangles.iter().enumerate() {
            if vertices.iter().any(|&vertex| vertex as usize >= count) {
                return Err(ShapeError::Triangle {
                    index,
                    vertices,
                    count,
                });
            }
        }
        let points = vertices
            .iter()
            .map(|&[x, y, z]| Vec3::new(x, y, z))
            .collect();
        let mesh = TriMesh::with_flags(points, triangles.to_vec(), TriMeshFlags::empty())
            .map_err(|_| ShapeError::Empty)?;
        let bounds = mesh.local_aabb();
        let (low, high) = (bounds.mins, bounds.maxs);
        let [low, high] = [low, high].map(|p| Vector3::new(p.x, p.y, p.z));
        Ok(Self(Kind::Mesh(Arc::new(Mesh {
            mesh,
            middle: (low + high) / 2.0,
            half: (high - low) / 2.0,
            adjacency: OnceLock::new(),
        }))))
    }

    /// Middle of the shape, in its frame (m).
    pub(crate) fn middle(&self) -> Vector3<f64> {
        match &self.0 {
            Kind::Mesh(mesh) => mesh.middle,
            _ => Vector3::zeros(),
        }
    }

    /// How far the shape reaches from its middle, at most, along each of the unit vectors that are
    /// the rows of `axes` (m).
    pub(crate) fn extents(&self, axes: &Matrix3<f64>) -> Vector3<f64> {
        let of_box = |half: &Vector3<f64>| axes.abs() * half;
        match &self.0 {
            Kind::Cylinder(c) => Vector3::from_fn(|k, _| {
                let across = axes[(k, 0)].hypot(axes[(k, 1)]);
                c.radius * across + c.half_height * axes[(k, 2)].abs()
            }),
            Kind::Cuboid(cuboid) => of_box(&cuboid.half),
            Kind::Sphere(sphere) => Vector3::repeat(sphere.radius),
            Kind::Capsule(c) => axes.column(2).abs() * c.half_length + Vector3::repeat(c.radius),
            Kind::Mesh(mesh) => of_box(&mesh.half),
        }
    }
}

pub(super) fn length(
    shape: &'static str,
    what: &'static str,
    value: f64,
) -> Result<f64, ShapeError> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(ShapeError::Length { shape, what, value })
    }
}
