//! RGB-D images and masks of a robot by casting rays at its analytic shapes.
//!
//! Each solid is cast only at the pixels that its bounding box can cover, so background costs
//! nothing. Colours are lit by a head light: brightest where the surface faces the camera.

mod frame;
mod scene;
mod shape;

pub use frame::{Instance, PixelBounds, RgbdFrame};
pub(crate) use scene::base_solids;
pub use scene::{BaseVisibility, Scene, Solid, disc_color};
pub(crate) use shape::Shape;

use nalgebra::{Point3, Vector3};

use crate::camera::Camera;
use shape::Cast;

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
    let bounds = pixel_bounds(solid, camera);
    if bounds.is_empty() {
        return;
    }
    frame.touch(&bounds);
    // Choosing the shape here, not at each ray, lets the compiler see through the cast.
    match solid.shape {
        Shape::Cylinder(cylinder) => draw_within(&bounds, solid, camera, frame, cylinder),
        Shape::Cuboid(cuboid) => draw_within(&bounds, solid, camera, frame, cuboid),
    }
}

fn draw_within(
    bounds: &PixelBounds,
    solid: &Solid,
    camera: &Camera,
    frame: &mut RgbdFrame,
    shape: impl Cast,
) {
    let to_solid = solid.pose.inverse() * camera.pose;
    let origin = Point3::from(to_solid.translation.vector);
    let rotation = to_solid.rotation.to_rotation_matrix();
    let per_column = rotation * Vector3::new(1.0 / camera.intrinsics.fx, 0.0, 0.0);
    for v in bounds.rows.clone() {
        let row_start = rotation * camera.ray(0.0, f64::from(v));
        for u in bounds.columns.clone() {
            // The camera-frame ray has depth 1 per unit, so the hit's parameter is its z-depth.
            let direction = row_start + per_column * f64::from(u);
            let Some(hit) = shape.cast(&origin, &direction) else {
                continue;
            };
            let index = frame.index(u, v);
            let depth = hit.depth as f32;
            if frame.mask[index] == Instance::Background || depth < frame.depth[index] {
                let facing = hit.normal.dot(&direction).abs() / direction.norm();
                frame.depth[index] = depth;
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

/// Pixels that a solid can cover, from its extents along the camera's axes; all of them where it
/// reaches the camera's plane.
fn pixel_bounds(solid: &Solid, camera: &Camera) -> PixelBounds {
    let k = &camera.intrinsics;
    let center = camera
        .pose
        .inverse_transform_point(&solid.pose.translation.vector.into());
    let to_camera = camera.pose.rotation.inverse() * solid.pose.rotation;
    let extent = |axis: Vector3<f64>| solid.shape.extent(&(to_camera.inverse() * axis));
    let depth = extent(Vector3::z());
    let (near, far) = (center.z - depth, center.z + depth);
    if far <= 0.0 {
        return PixelBounds::default();
    }
    if near <= 0.0 {
        return PixelBounds {
            columns: 0..k.width,
            rows: 0..k.height,
        };
    }
    let slopes = |middle: f64, extent: f64| {
        let (low, high) = (middle - extent, middle + extent);
        [
            low / if low < 0.0 { near } else { far },
            high / if high > 0.0 { near } else { far },
        ]
    };
    let columns = slopes(center.x, extent(Vector3::x())).map(|slope| k.fx * slope + k.cx);
    let rows = slopes(center.y, extent(Vector3::y())).map(|slope| k.fy * slope + k.cy);
    PixelBounds {
        columns: pixel_range(columns, k.width),
        rows: pixel_range(rows, k.height),
    }
}

fn pixel_range([low, high]: [f64; 2], size: u32) -> std::ops::Range<u32> {
    // `as` saturates: bounds beyond the image, however far, end at its edge.
    let first = low.ceil().max(0.0) as u32;
    let end = ((high.floor() + 1.0).max(0.0) as u32).min(size);
    first.min(end)..end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Intrinsics;
    use nalgebra::{Isometry3, Translation3, UnitQuaternion};
    use rand::{RngExt, SeedableRng};

    /// A solid is never cut by the rectangle it is drawn in, wherever it is and however it is turned.
    #[test]
    fn bounds_hold_every_pixel_that_a_solid_covers() {
        let camera = Camera {
            intrinsics: Intrinsics::from_fovy(96, 72, 1.0),
            pose: Isometry3::identity(),
        };
        let everything = PixelBounds {
            columns: 0..96,
            rows: 0..72,
        };
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
        let mut random =
            |size: f64| Vector3::from_fn(|_, _| size * (2.0 * rng.random::<f64>() - 1.0));
        for round in 0..200 {
            let half = random(0.1).abs();
            let shape = if round % 2 == 0 {
                Shape::Cylinder(shape::Cylinder {
                    radius: half.x,
                    half_height: half.y,
                })
            } else {
                let half = parry3d_f64::math::Vec3::new(half.x, half.y, half.z);
                Shape::Cuboid(parry3d_f64::shape::Cuboid::new(half))
            };
            let place = Translation3::from(random(0.3) + Vector3::new(0.0, 0.0, 0.5));
            let turn = UnitQuaternion::from_scaled_axis(random(3.0));
            let solid = Solid {
                shape,
                pose: Isometry3::from_parts(place, turn),
                color: [200, 100, 50],
                instance: Instance::Disc(0),
            };
            let mut bounded = RgbdFrame::new(&camera);
            draw(&solid, &camera, &mut bounded);
            let mut full = RgbdFrame::new(&camera);
            match shape {
                Shape::Cylinder(shape) => {
                    draw_within(&everything, &solid, &camera, &mut full, shape)
                }
                Shape::Cuboid(shape) => draw_within(&everything, &solid, &camera, &mut full, shape),
            }
            assert_eq!(bounded.depth, full.depth, "round {round}");
        }
    }
}
