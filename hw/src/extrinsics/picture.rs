//! Pictures of boards as cameras see them, for tests and simulated rigs.

use std::ops::Range;

use nalgebra::{Isometry3, Point2, Point3, Vector3};
use rand::Rng;
use rand_distr::{Distribution, Normal};
use rayon::prelude::*;
use tdcr_sim::camera::Camera;

use super::board::Board;
use super::image::GreyImage;

/// How a picture is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Grey of the print's black and white, and of everything else.
    pub greys: [u8; 3],
    /// Standard deviation of each pixel's noise (grey levels).
    pub noise: f64,
    /// White paper around the board, in squares.
    pub margin: f64,
    /// Rays along each edge of a pixel.
    pub rays: u32,
}

impl Default for Exposure {
    /// A print in a dim room, seen by a camera with the noise of a D435's colour camera at short exposure.
    fn default() -> Self {
        Self {
            greys: [35, 215, 110],
            noise: 2.0,
            margin: 0.5,
            rays: 4,
        }
    }
}

/// A picture of `board`, whose frame has the pose `placed` in the world (m), by `camera`.
pub fn picture(
    board: &Board,
    placed: &Isometry3<f64>,
    camera: &Camera,
    exposure: &Exposure,
    rng: &mut impl Rng,
) -> GreyImage {
    let [width, height] = [camera.intrinsics.width, camera.intrinsics.height];
    let [columns, rows] = frame_of(board, placed, camera, exposure.margin);
    // Where the rays through the corners of pixels meet the board's plane.
    let to_board = placed.inverse() * camera.pose;
    let meet = |column: u32, row: u32| {
        let ray = camera.ray(f64::from(column) - 0.5, f64::from(row) - 0.5);
        on_plane(&to_board, &ray)
    };
    let greys: Vec<f64> = (0..height)
        .into_par_iter()
        .flat_map_iter(|row| {
            let shown = if rows.contains(&row) {
                columns.clone()
            } else {
                0..0
            };
            let met = |row: u32| -> Vec<Option<Point2<f64>>> {
                let corners = shown.start..shown.end + u32::from(!shown.is_empty());
                corners.map(|column| meet(column, row)).collect()
            };
            let (above, below) = (met(row), met(row + 1));
            (0..width).map(move |column| {
                let Some(k) = column
                    .checked_sub(shown.start)
                    .filter(|_| column < shown.end)
                else {
                    return f64::from(exposure.greys[2]);
                };
                let k = k as usize;
                mean_grey(
                    board,
                    exposure,
                    [above[k], above[k + 1], below[k], below[k + 1]],
                )
            })
        })
        .collect();
    // A noise that is no number is none.
    let noise = Normal::new(0.0, exposure.noise).ok();
    let pixels = greys.into_iter().map(|grey| {
        let noise = noise.map_or(0.0, |noise| noise.sample(rng));
        (grey + noise).round().clamp(0.0, 255.0) as u8
    });
    let pixels = pixels.collect();
    GreyImage::new([width, height], pixels).expect("a grey for each pixel")
}

/// Columns and rows outside which a picture shows no paper.
fn frame_of(
    board: &Board,
    placed: &Isometry3<f64>,
    camera: &Camera,
    margin: f64,
) -> [Range<u32>; 2] {
    const STEPS: u32 = 50;
    let sides = [camera.intrinsics.width, camera.intrinsics.height];
    let margin = margin * board.spec().square;
    let [width, height] = board.size();
    let mut seen = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for step in 0..=STEPS {
        let along = |side: f64| f64::from(step) / f64::from(STEPS) * (side + 2.0 * margin) - margin;
        let (x, y) = (along(width), along(height));
        for at in [
            [x, -margin],
            [x, height + margin],
            [-margin, y],
            [width + margin, y],
        ] {
            let Some((u, v, _)) = camera.project(&(placed * Point3::new(at[0], at[1], 0.0))) else {
                return sides.map(|side| 0..side);
            };
            for (range, at) in seen.iter_mut().zip([u, v]) {
                *range = [range[0].min(at), range[1].max(at)];
            }
        }
    }
    // Between steps a curved edge is a little farther out. `as` saturates at 0.
    std::array::from_fn(|axis| {
        let end = |pixel: f64| (pixel as u32).min(sides[axis]);
        end(seen[axis][0] - 3.0)..end(seen[axis][1] + 4.0)
    })
}

/// Where a ray (camera frame) meets the plane z = 0 of the board's frame; `None` behind the camera, or where the board is seen
/// from its back.
fn on_plane(to_board: &Isometry3<f64>, ray: &Vector3<f64>) -> Option<Point2<f64>> {
    let (from, along) = (to_board.translation.vector, to_board * ray);
    // The front faces the negative z axis.
    let distance = -from.z / along.z;
    (from.z < 0.0 && along.z > 0.0).then(|| Point3::from(from + along * distance).xy())
}

/// Mean grey of a pixel whose corners (top left, top right, bottom left, bottom right) see these points of the board's plane.
/// Within a pixel the plane is seen bilinearly: perspective bends that by less than a thousandth of a pixel.
fn mean_grey(board: &Board, exposure: &Exposure, corners: [Option<Point2<f64>>; 4]) -> f64 {
    let [black, white, other] = exposure.greys.map(f64::from);
    let [Some(a), Some(b), Some(c), Some(d)] = corners else {
        return other;
    };
    let margin = exposure.margin * board.spec().square;
    let size = board.size();
    let on_paper =
        |p: Point2<f64>| (0..2).all(|axis| p[axis] >= -margin && p[axis] <= size[axis] + margin);
    if ![a, b, c, d].into_iter().any(on_paper) {
        return other;
    }
    let rays = exposure.rays.max(1);
    let share = |k: u32| (f64::from(k) + 0.5) / f64::from(rays);
    let mut sum = 0.0;
    for (x, y) in (0..rays).flat_map(|y| (0..rays).map(move |x| (x, y))) {
        let (x, y) = (share(x), share(y));
        let at = a + (b - a) * x + (c - a) * y + ((d - b) - (c - a)) * (x * y);
        sum += match (on_paper(at), board.is_black(at)) {
            (false, _) => other,
            (true, true) => black,
            (true, false) => white,
        };
    }
    sum / f64::from(rays * rays)
}
