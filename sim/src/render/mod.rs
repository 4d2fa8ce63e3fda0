//! RGB-D images and masks of a robot by casting rays at its analytic shapes.
//!
//! Each solid is cast only at the pixels that its bounding sphere can cover, so background costs
//! nothing. Colours are lit by a head light: brightest where the surface faces the camera.

mod frame;
mod scene;

pub use frame::{Instance, PixelBounds, RgbdFrame};
pub use scene::{BaseVisibility, Scene, Solid, disc_color};

use nalgebra::{Point3, Vector3};

use crate::camera::Camera;

/// Share of the colour that does not depend on the angle to the head light.
const AMBIENT: f64 = 0.35;

impl Scene {
    /// Sees the scene with `camera`, writing to `frame`, whose memory is reused.
    pub fn render_into(&self, camera: &Camera, frame: &mut RgbdFrame) {
        frame.clear_for(camera);
        for solid in &self.solids {
            draw(solid, camera, frame);
        }
    }

    /// Sees the scene with `camera`.
    pub fn render(&self, camera: &Camera) -> RgbdFrame {
        let mut frame = RgbdFrame::new(camera);
        self.render_into(camera, &mut frame);
        frame
    }
}

fn draw(solid: &Solid, camera: &Camera, frame: &mut RgbdFrame) {
    let center = camera
        .pose
        .inverse_transform_point(&Point3::from(solid.pose.translation.vector));
    let bounds = sphere_bounds(camera, &center, solid.shape.bounding_radius());
    if bounds.is_empty() {
        return;
    }
    frame.touch(&bounds);
    let to_solid = solid.pose.inverse() * camera.pose;
    let origin = Point3::from(to_solid.translation.vector);
    let rotation = to_solid.rotation.to_rotation_matrix();
    for v in bounds.rows.clone() {
        for u in bounds.columns.clone() {
            let direction = camera.ray(f64::from(u), f64::from(v));
            let index = frame.index(u, v);
            // The camera-frame ray has depth 1 per unit, so the hit's parameter is its z-depth.
            let Some(hit) = solid.shape.cast(&origin, &(rotation * direction)) else {
                continue;
            };
            if (hit.depth as f32) < frame.depth[index] || frame.mask[index] == Instance::Background
            {
                let facing = (hit.normal.dot(&(rotation * direction)) / direction.norm()).abs();
                frame.depth[index] = hit.depth as f32;
                frame.color[index] = shade(solid.color, facing);
                frame.mask[index] = solid.instance;
            }
        }
    }
}

fn shade(color: [u8; 3], facing: f64) -> [u8; 3] {
    let light = AMBIENT + (1.0 - AMBIENT) * facing;
    color.map(|channel| (f64::from(channel) * light).round() as u8)
}

/// Pixels that a sphere at `center` (camera frame, m) can cover; all of them around the camera.
fn sphere_bounds(camera: &Camera, center: &Point3<f64>, radius: f64) -> PixelBounds {
    let k = &camera.intrinsics;
    if center.z < -radius {
        return PixelBounds::default();
    }
    if center.z <= radius {
        return PixelBounds {
            columns: 0..k.width,
            rows: 0..k.height,
        };
    }
    let columns = tangent_slopes(center.x, center.z, radius).map(|slope| k.fx * slope + k.cx);
    let rows = tangent_slopes(center.y, center.z, radius).map(|slope| k.fy * slope + k.cy);
    PixelBounds {
        columns: pixel_range(columns, k.width),
        rows: pixel_range(rows, k.height),
    }
}

/// Slopes `x / z` of the two lines through the origin that touch a circle around `(x, z)`, `z > r`.
fn tangent_slopes(x: f64, z: f64, radius: f64) -> [f64; 2] {
    let spread = radius * (x * x + z * z - radius * radius).sqrt();
    let denominator = z * z - radius * radius;
    [
        (x * z - spread) / denominator,
        (x * z + spread) / denominator,
    ]
}

fn pixel_range([low, high]: [f64; 2], size: u32) -> std::ops::Range<u32> {
    // `as` saturates: bounds beyond the image, however far, end at its edge.
    let first = low.ceil().max(0.0) as u32;
    let end = ((high.floor() + 1.0).max(0.0) as u32).min(size);
    first.min(end)..end
}

/// Where a ray meets a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    /// Ray parameter at the hit.
    pub depth: f64,
    /// Unit normal of the surface, in the shape's frame.
    pub normal: Vector3<f64>,
}
