//! Shapes by their dimensions.

use std::sync::OnceLock;

use nalgebra::Vector3;
use parry3d_f64::shape::TriMesh;

use super::distance::Adjacency;

/// A cylinder about the z axis (m).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cylinder {
    pub radius: f64,
    pub half_height: f64,
}

/// A box along the axes (m).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cuboid {
    pub half: Vector3<f64>,
}

/// A sphere about the origin (m).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sphere {
    pub radius: f64,
}

/// What is within `radius` of a piece of the z axis (m).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Capsule {
    pub radius: f64,
    pub half_length: f64,
}

/// Triangles, in parry's bounding volume hierarchy, the box around them (m), and which of them meet, once asked for.
#[derive(Clone, Debug)]
pub(crate) struct Mesh {
    pub mesh: TriMesh,
    pub middle: Vector3<f64>,
    pub half: Vector3<f64>,
    pub adjacency: OnceLock<Adjacency>,
}
