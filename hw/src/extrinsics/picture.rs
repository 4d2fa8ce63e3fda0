//! Pictures of boards as cameras see them, for tests and simulated rigs.

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
    // Where the rays through the corners of pixels meet the board's plane.
    let to_board = placed.inverse() * camera.pose;
    let meet = |column: u32, row: u32| {
        let ray = camera.ray(f64::from(column) - 0.5, f64::from(row) - 0.5);
        on_plane(&to_board, &ray)
    };
    let met: Vec<Option<Point2<f64>>> = (0..=height)
        .into_par_iter()
        .flat_map_iter(|row| (0..=width).map(move |column| meet(column, row)))
        .collect();
    let greys: Vec<f64> = (0..width as usize * height as usize)
        .into_par_iter()
        .map(|pixel| {
            let (column, row) = (pixel % width as usize, pixel / width as usize);
            let first = row * (width as usize + 1) + column;
            let below = first + width as usize + 1;
            mean_grey(
                board,
                exposure,
                [met[first], met[first + 1], met[below], met[below + 1]],
            )
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
