//! Pinhole cameras and rings of them.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::robot::RingSpec;

/// Pinhole intrinsics (pixels). Pixel `(u, v)`, column and row, has its centre at integer
/// coordinates; a point `(x, y, z)` of the camera frame is seen at
/// `(fx x / z + cx, fy y / z + cy)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Intrinsics {
    /// Image width.
    pub width: u32,
    /// Image height.
    pub height: u32,
    /// Horizontal focal length.
    pub fx: f64,
    /// Vertical focal length.
    pub fy: f64,
    /// Column of the principal point.
    pub cx: f64,
    /// Row of the principal point.
    pub cy: f64,
}

impl Intrinsics {
    /// Square pixels and a centred principal point, for a vertical field of view `fovy` (rad).
    pub fn from_fovy(width: u32, height: u32, fovy: f64) -> Self {
        let focal = f64::from(height) / (2.0 * (fovy / 2.0).tan());
        Self {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: (f64::from(width) - 1.0) / 2.0,
            cy: (f64::from(height) - 1.0) / 2.0,
        }
    }
}

/// A pinhole camera somewhere in the world. Its frame has x to the right of the image, y down, z
/// along the optical axis.
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
        let k = &self.intrinsics;
        Vector3::new((u - k.cx) / k.fx, (v - k.cy) / k.fy, 1.0)
    }

    /// The world point (m) seen at pixel coordinates `(u, v)` at `depth` (m) along the optical axis.
    pub fn back_project(&self, u: f64, v: f64, depth: f64) -> Point3<f64> {
        self.pose * Point3::from(self.ray(u, v) * depth)
    }

    /// Pixel coordinates and depth (m) of a world point (m); `None` behind the camera.
    pub fn project(&self, point: &Point3<f64>) -> Option<(f64, f64, f64)> {
        let p = self.pose.inverse_transform_point(point);
        let k = &self.intrinsics;
        (p.z > 0.0).then(|| (k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy, p.z))
    }

    /// The cameras of a ring, the first at `(0, -radius)`, the others counter-clockwise.
    pub fn ring(ring: &RingSpec) -> Vec<Camera> {
        let [width, height] = ring.resolution;
        let intrinsics = Intrinsics::from_fovy(width, height, ring.fovy.to_radians());
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
}
