//! Shapes of a scene as rapier's.

use nalgebra::{Isometry3, Vector3};
use rapier3d_f64::prelude::{ColliderBuilder, Pose, Rotation, SharedShape, TriMesh, Vector};

use super::ObjectError;
use crate::geometry::{Kind, Shape};
use crate::scene::{Obstacle, ObstacleShape};

pub(super) fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

pub(super) fn back(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

pub(super) fn pose(pose: &Isometry3<f64>) -> Pose {
    let turn = pose.rotation;
    Pose::from_parts(
        vector(&pose.translation.vector),
        Rotation::from_xyzw(turn.i, turn.j, turn.k, turn.w),
    )
}

pub(super) fn pose_back(pose: &Pose) -> Isometry3<f64> {
    let turn = pose.rotation;
    let turn = nalgebra::Quaternion::new(turn.w, turn.x, turn.y, turn.z);
    let rotation = nalgebra::UnitQuaternion::new_normalize(turn);
    Isometry3::from_parts(back(pose.translation).into(), rotation)
}

/// The shape of a fixed obstacle.
pub(super) fn fixed(obstacle: &Obstacle) -> ColliderBuilder {
    match &obstacle.shape {
        ObstacleShape::HalfSpace => ColliderBuilder::new(SharedShape::halfspace(Vector::Z)),
        ObstacleShape::Pipe(pipe) => solid(&pipe.mesh()),
        ObstacleShape::Solid(shape) => solid(shape),
    }
}

/// The shape of an object, which must be convex.
pub(super) fn movable(obstacle: &Obstacle) -> Result<ColliderBuilder, ObjectError> {
    let refuse = |found| {
        Err(ObjectError::Shape {
            object: obstacle.name.clone(),
            found,
            expected: "a box, a sphere, a capsule, a cylinder or a convex mesh",
        })
    };
    match &obstacle.shape {
        ObstacleShape::HalfSpace => refuse("a half space, which has no end and no mass"),
        ObstacleShape::Pipe(_) => refuse("a pipe, which is a bore in a block without an outside"),
        ObstacleShape::Solid(shape) => match &shape.0 {
            Kind::Mesh(_) => match hull(shape) {
                Some(hull) => Ok(hull),
                None => refuse("a mesh that is open, flat or not convex"),
            },
            _ => Ok(solid(shape)),
        },
    }
}

fn solid(shape: &Shape) -> ColliderBuilder {
    match &shape.0 {
        Kind::Cuboid(it) => ColliderBuilder::cuboid(it.half.x, it.half.y, it.half.z),
        Kind::Sphere(it) => ColliderBuilder::ball(it.radius),
        Kind::Capsule(it) => ColliderBuilder::capsule_z(it.half_length, it.radius),
        // Rapier's stands along y.
        Kind::Cylinder(it) => ColliderBuilder::cylinder(it.half_height, it.radius).position(
            Pose::from_rotation(Rotation::from_rotation_x(std::f64::consts::FRAC_PI_2)),
        ),
        Kind::Mesh(mesh) => ColliderBuilder::new(SharedShape::new(TriMesh::clone(&mesh.mesh))),
    }
}

/// A mesh that is closed and convex; `None` of others.
fn hull(shape: &Shape) -> Option<ColliderBuilder> {
    let surface = shape.convex_surface()?;
    let points: Vec<Vector> = surface.points.iter().map(vector).collect();
    ColliderBuilder::convex_hull(&points)
}
