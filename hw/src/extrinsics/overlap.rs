//! How well the clouds of several cameras lie on each other: what a calibration leaves, seen on the robot itself.
//!
//! Each pixel's point has a normal from its neighbours'; the distance of a point from another camera's surface is taken along
//! that surface's normal, as in point-to-plane registration (Chen and Medioni, Object modelling by registration of multiple
//! range images, 1992). The distances are only reported: a slender robot does not tell where a camera slides along it or turns
//! about it, and poses from a board are surer than those from the depth of such a body.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use tdcr_sim::geometry::Instance;
use tdcr_sim::render::RgbdFrame;

/// Largest angle between normals of points that may be of one surface, as a cosine: 45 degrees. Opposite sides of a thin disc
/// are not.
const ALIKE: f64 = 0.7;
/// Smallest cosine between a normal and the sight of its camera: depth is poor beyond 75 degrees.
const FACING: f64 = 0.26;
/// Neighbouring pixels are of one surface where their depths differ by less than so many times the pixel's width there: 80
/// degrees off.
const STEEPEST: f64 = 6.0;

/// How far the points of one camera are from the surface that another one sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Number of the camera whose points these are.
    pub points_of: usize,
    /// Number of the camera whose surface it is.
    pub surface_of: usize,
    /// Points that have a surface nearby.
    pub points: u32,
    /// Mean distance along the surface's normal, outside positive (m).
    pub mean: f64,
    /// Root mean square distance (m).
    pub rms: f64,
}

/// The overlaps of frames that were taken at one time, for all pairs of cameras both ways. Pixels whose mask is
/// [`Instance::Background`] do not count; surfaces farther than `reach` (m, above 0) from a point are not its own.
pub fn overlaps(frames: &[RgbdFrame], reach: f64) -> Vec<Overlap> {
    let surfaces: Vec<Surface> = frames
        .par_iter()
        .map(|frame| Surface::of(frame, reach))
        .collect();
    let pairs = (0..frames.len()).flat_map(|a| (0..frames.len()).map(move |b| (a, b)));
    let pairs: Vec<(usize, usize)> = pairs.filter(|(a, b)| a != b).collect();
    let overlap = |(points_of, surface_of): (usize, usize)| {
        let distances = surfaces[points_of].points.iter().filter_map(|point| {
            let (surface, normal) = surfaces[surface_of].nearest(point, reach)?;
            Some(normal.dot(&(point.0 - surface)))
        });
        let sums = distances.fold((0, 0.0, 0.0), |(count, sum, squares), distance| {
            (count + 1, sum + distance, squares + distance * distance)
        });
        let (points, sum, squares) = sums;
        (points > 0).then(|| Overlap {
            points_of,
            surface_of,
            points,
            mean: sum / f64::from(points),
            rms: (squares / f64::from(points)).sqrt(),
        })
    };
    pairs.into_par_iter().filter_map(overlap).collect()
}

/// What one camera sees: points (m, world) with normals.
struct Surface {
    points: Vec<(Point3<f64>, Vector3<f64>)>,
    /// Numbers of points by cubes of edge `reach`.
    cells: HashMap<[i64; 3], Vec<u32>>,
}

impl Surface {
    fn of(frame: &RgbdFrame, reach: f64) -> Self {
        let points = points_of(frame);
        let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        for (index, (point, _)) in (0..).zip(&points) {
            cells.entry(cell(point, reach)).or_default().push(index);
        }
        Self { points, cells }
    }

    /// The nearest point within `reach` whose normal is like that of the point asked for.
    fn nearest(
        &self,
        (point, normal): &(Point3<f64>, Vector3<f64>),
        reach: f64,
    ) -> Option<&(Point3<f64>, Vector3<f64>)> {
        let [x, y, z] = cell(point, reach);
        let around = [-1, 0, 1];
        let cells = around.into_iter().flat_map(|i| {
            around
                .into_iter()
                .flat_map(move |j| around.into_iter().map(move |k| [x + i, y + j, z + k]))
        });
        let near = cells.filter_map(|cell| self.cells.get(&cell)).flatten();
        let near = near.map(|&index| &self.points[index as usize]);
        near.filter(|(_, other)| other.dot(normal) > ALIKE)
            .map(|found| ((found.0 - point).norm_squared(), found))
            .filter(|(squared, _)| *squared <= reach * reach)
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, found)| found)
    }
}

fn cell(point: &Point3<f64>, edge: f64) -> [i64; 3] {
    // `as` saturates: what is so far away has no neighbours.
    std::array::from_fn(|axis| (point[axis] / edge).floor().clamp(-1e15, 1e15) as i64)
}

/// Points of a frame's foreground with normals towards the camera (world).
fn points_of(frame: &RgbdFrame) -> Vec<(Point3<f64>, Vector3<f64>)> {
    let camera = &frame.camera;
    let [width, height] = [camera.intrinsics.width, camera.intrinsics.height];
    let depth = |u: u32, v: u32| {
        let index = frame.index(u, v);
        let depth = f64::from(frame.depth[index]);
        (depth > 0.0 && frame.mask[index] != Instance::Background).then_some(depth)
    };
    let at =
        |u: u32, v: u32, depth: f64| Point3::from(camera.ray(f64::from(u), f64::from(v)) * depth);
    let mut points = Vec::new();
    for v in 1..height.saturating_sub(1) {
        for u in 1..width.saturating_sub(1) {
            let Some(here) = depth(u, v) else { continue };
            // Differences of neighbours on both sides halve the noise of one side's.
            let beside = [(u - 1, v), (u + 1, v), (u, v - 1), (u, v + 1)].map(|(u, v)| {
                let depth = depth(u, v)?;
                let pixel = here / camera.intrinsics.fx.min(camera.intrinsics.fy);
                ((depth - here).abs() < STEEPEST * pixel).then(|| at(u, v, depth))
            });
            let [Some(left), Some(right), Some(above), Some(below)] = beside else {
                continue;
            };
            let point = at(u, v, here);
            let normal = (below - above).cross(&(right - left)).normalize();
            let facing = -normal.dot(&point.coords.normalize());
            // A normal that is no number faces nowhere.
            if facing > FACING {
                points.push((camera.pose * point, camera.pose * normal));
            }
        }
    }
    points
}
