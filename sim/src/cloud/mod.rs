//! Point clouds: back-projection and fusion of frames, voxel grids, fixed-size samples, PLY.

mod observe;
mod ply;

pub use observe::Observer;
pub use ply::{PlyError, write_ply};

use hashbrown::HashSet;
use rand::Rng;
use rand::seq::{IndexedRandom, SliceRandom};

use crate::render::{Instance, RgbdFrame};

/// A coloured point cloud in the world frame.
///
/// `points[k]` (m) and `colors[k]` (8-bit RGB) describe the same point; both have the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions in the world frame (m).
    pub points: Vec<[f32; 3]>,
    /// Colours, 8-bit RGB.
    pub colors: Vec<[u8; 3]>,
}

/// A grid of cubes that keeps one point in each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoxelGrid {
    /// Edge of a cube (m), above 0.
    pub size: f64,
    /// A corner of the grid, world frame (m).
    pub origin: [f64; 3],
}

impl VoxelGrid {
    /// A grid with a corner at the world's origin.
    pub fn new(size: f64) -> Self {
        Self {
            size,
            origin: [0.0; 3],
        }
    }

    fn cell(&self, point: &[f32; 3]) -> [i32; 3] {
        // `as` saturates: points beyond the grid's range share its outermost cells.
        std::array::from_fn(|axis| {
            ((f64::from(point[axis]) - self.origin[axis]) / self.size).floor() as i32
        })
    }
}

impl PointCloud {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether the cloud holds no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Adds a point (m) and its colour.
    pub fn push(&mut self, point: [f32; 3], color: [u8; 3]) {
        self.points.push(point);
        self.colors.push(color);
    }

    /// Removes all points, keeping the memory.
    pub fn clear(&mut self) {
        self.points.clear();
        self.colors.clear();
    }

    /// Adds the back-projection of every pixel of `frame` that is not background, row by row.
    pub fn add_frame(&mut self, frame: &RgbdFrame) {
        let bounds = frame.touched();
        for v in bounds.rows.clone() {
            for u in bounds.columns.clone() {
                let index = frame.index(u, v);
                if frame.mask[index] != Instance::Background {
                    let depth = f64::from(frame.depth[index]);
                    let point = frame.camera.back_project(f64::from(u), f64::from(v), depth);
                    self.push(point.coords.map(|x| x as f32).into(), frame.color[index]);
                }
            }
        }
    }

    /// The first point in each voxel of `grid`, in the order of the points.
    pub fn voxel_downsample(&self, grid: VoxelGrid) -> PointCloud {
        let mut occupied = HashSet::with_capacity(self.len() / 8);
        let mut kept = PointCloud::default();
        for (point, color) in self.points.iter().zip(&self.colors) {
            if occupied.insert(grid.cell(point)) {
                kept.push(*point, *color);
            }
        }
        kept
    }

    /// Exactly `count` points in random order: a random subset, or every point and as many random
    /// repetitions as are missing. An empty cloud stays empty.
    pub fn sample_or_pad(&self, count: usize, rng: &mut impl Rng) -> PointCloud {
        let mut chosen: Vec<usize> = (0..self.len()).collect();
        let (subset, _) = chosen.partial_shuffle(rng, count.min(self.len()));
        let mut chosen = subset.to_vec();
        if !self.is_empty() {
            let all = chosen.clone();
            chosen.extend((all.len()..count).filter_map(|_| all.choose(rng).copied()));
        }
        PointCloud {
            points: chosen.iter().map(|&k| self.points[k]).collect(),
            colors: chosen.iter().map(|&k| self.colors[k]).collect(),
        }
    }
}
