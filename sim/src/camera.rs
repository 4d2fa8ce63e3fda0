//! Cameras in the world, singly and in rings.

pub use crate::lens::{Distortion, Intrinsics};

use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Rotation3, Translation3};
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use crate::robot::{Aim, CameraSpec, Cameras, Lens, RingSpec};

/// A camera somewhere in the world. Its frame has x to the right of the image, y down, z along the
/// optical axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Intrinsics.
    pub intrinsics: Intrinsics,
    /// Pose of the camera frame in the world (m).
    pub pose: Isometry3<f64>,
}

impl Camera {
    /// Direction (camera frame, depth 1) of the ray through pixel coordinates `(u, v)`.
    pub fn ray(&self, u: f64, v: f64) -> Vector3<f64> {
        self.intrinsics.normalised(u, v).push(1.0)
    }

    /// The world point (m) seen at pixel coordinates `(u, v)` at `depth` (m) along the optical axis.
    pub fn back_project(&self, u: f64, v: f64, depth: f64) -> Point3<f64> {
        self.pose * Point3::from(self.ray(u, v) * depth)
    }

    /// Pixel coordinates and depth (m) of a world point (m); `None` behind the camera.
    ///
    /// Far beyond the image a distorted lens may fold: pixel coordinates inside the image then need
    /// not mean that the point is seen there.
    pub fn project(&self, point: &Point3<f64>) -> Option<(f64, f64, f64)> {
        let p = self.pose.inverse_transform_point(point);
        (p.z > 0.0).then(|| {
            let (u, v) = (self.intrinsics).pixel(Vector2::new(p.x / p.z, p.y / p.z));
            (u, v, p.z)
        })
    }

    /// All cameras of a robot's specification, in order.
    pub fn placed(cameras: &Cameras) -> Vec<Camera> {
        match cameras {
            Cameras::Ring(ring) => Self::ring(ring),
            Cameras::Free(cameras) => cameras.iter().map(Self::free).collect(),
        }
    }

    /// The cameras of a ring, the first at `(0, -radius)`, the others counter-clockwise.
    pub fn ring(ring: &RingSpec) -> Vec<Camera> {
        let intrinsics = Lens::Fovy(ring.fovy).intrinsics(ring.resolution, ring.distortion);
        // At angle 0: x right is the world's x; y down and z forward are turned about it by the pitch.
        let (sin, cos) = ring.pitch.sin_cos();
        let level = Rotation3::from_matrix_unchecked(Matrix3::new(
            1.0, 0.0, 0.0, //
            0.0, -sin, cos, //
            0.0, -cos, -sin,
        ));
        (0..ring.count)
            .map(|index| {
                let angle = std::f64::consts::TAU * index as f64 / ring.count as f64;
                let around = Rotation3::from_axis_angle(&Vector3::z_axis(), angle);
                let position = around * Vector3::new(0.0, -ring.radius, ring.height);
                let rotation = UnitQuaternion::from_rotation_matrix(&(around * level));
                Camera {
                    intrinsics,
                    pose: Isometry3::from_parts(Translation3::from(position), rotation),
                }
            })
            .collect()
    }

    /// A camera with a place of its own.
    pub fn free(camera: &CameraSpec) -> Camera {
        let position = Vector3::from(camera.position);
        let rotation = match camera.aim {
            Aim::At(target) => upright(&(Vector3::from(target) - position)),
            Aim::Orientation([w, x, y, z]) => {
                UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
            }
        };
        Camera {
            intrinsics: camera.lens.intrinsics(camera.resolution, camera.distortion),
            pose: Isometry3::from_parts(Translation3::from(position), rotation),
        }
    }
}

/// Orientation of a camera that looks along `axis` (world frame) with the horizon level. Of a camera
/// that looks straight up or down, x is the world's x.
fn upright(axis: &Vector3<f64>) -> UnitQuaternion<f64> {
    let z = axis.normalize();
    let right = z.cross(&Vector3::z());
    let x = if right.norm() < 1e-9 {
        Vector3::x()
    } else {
        right.normalize()
    };
    let axes = Matrix3::from_columns(&[x, z.cross(&x), z]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}
