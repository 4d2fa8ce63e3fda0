//! Depth laid onto the colour image.

use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use tdcr_sim::camera::Intrinsics;

/// Lays depth images of one camera onto the images of another beside it.
///
/// A depth pixel is a square of surface; it covers the pixels of the other camera whose centres lie within its square's image
/// there, and the nearest surface wins. Depth becomes that along the other camera's axis.
#[derive(Clone, Debug)]
pub struct Aligner {
    depth: Intrinsics,
    color: Intrinsics,
    depth_to_color: Isometry3<f64>,
    /// Normalised coordinates of the corners of depth pixels, row by row: one more of each than there are pixels.
    corners: Vec<Vector2<f64>>,
}

impl Aligner {
    /// From the images of `depth` to those of `color`, whose frames `depth_to_color` (m) relates.
    pub fn new(depth: Intrinsics, color: Intrinsics, depth_to_color: Isometry3<f64>) -> Self {
        let corner = |v: u32, u: u32| depth.normalised(f64::from(u) - 0.5, f64::from(v) - 0.5);
        let corners = (0..=depth.height).flat_map(|v| (0..=depth.width).map(move |u| corner(v, u)));
        Self {
            corners: corners.collect(),
            depth,
            color,
            depth_to_color,
        }
    }

    /// Depth (m) as the other camera sees it, 0 where it is not known, from a row-major depth image (m); pixels that it lacks
    /// are not known.
    pub fn align(&self, depth: &[f32]) -> Vec<f32> {
        let [width, height] = [self.color.width as usize, self.color.height as usize];
        let mut aligned = vec![0.0_f32; width * height];
        let columns = self.depth.width as usize;
        for (pixel, &z) in depth
            .iter()
            .take(columns * self.depth.height as usize)
            .enumerate()
        {
            // Written so that NaN is no depth.
            if !(z > 0.0 && z.is_finite()) {
                continue;
            }
            let first = pixel / columns * (columns + 1) + pixel % columns;
            let ends = [self.corners[first], self.corners[first + columns + 2]];
            let Some([from, to]) = self.image_of(ends, f64::from(z)) else {
                continue;
            };
            let middle = (ends[0] + ends[1]) / 2.0;
            let z = self.seen(middle, f64::from(z)).z as f32;
            let span = |low: f64, high: f64, size: usize| {
                // The pixels whose centres lie from `low` on and below `high`; `as` saturates.
                let end = |x: f64| (x.ceil().max(0.0) as usize).min(size);
                end(low)..end(high)
            };
            for v in span(from.y, to.y, height) {
                for seen in &mut aligned[v * width..][span(from.x, to.x, width)] {
                    if *seen == 0.0 || z < *seen {
                        *seen = z;
                    }
                }
            }
        }
        aligned
    }

    /// A point at depth `z` of the depth camera, in the other camera's frame (m).
    fn seen(&self, normalised: Vector2<f64>, z: f64) -> Vector3<f64> {
        (self.depth_to_color * Point3::from(normalised.push(1.0) * z)).coords
    }

    /// Smallest and largest coordinates in the other image of a square at depth `z` between two corners; `None` where it is not
    /// in front of that camera.
    fn image_of(&self, corners: [Vector2<f64>; 2], z: f64) -> Option<[Vector2<f64>; 2]> {
        let [a, b] = corners.map(|corner| {
            let p = self.seen(corner, z);
            (p.z > 0.0).then(|| {
                let (u, v) = self.color.pixel(Vector2::new(p.x / p.z, p.y / p.z));
                Vector2::new(u, v)
            })
        });
        let (a, b) = (a?, b?);
        Some([a.inf(&b), a.sup(&b)])
    }
}
