//! Point clouds: back-projection and fusion of frames, voxel grids, fixed-size samples, PLY.

mod back_project;
mod observe;
mod ply;
mod voxels;

pub use observe::Observer;
pub use ply::{PlyError, PointProperty, write_ply, write_ply_with};
pub use voxels::VoxelGrid;

use rand::Rng;
use rand::seq::{IndexedRandom, SliceRandom};

use crate::render::RgbdFrame;
use back_project::RowPoints;
use voxels::CellSet;

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

    /// Adds the back-projection of every pixel of `frame` that has a depth, row by row.
    pub fn add_frame(&mut self, frame: &RgbdFrame) {
        let mut row = RowPoints::default();
        let rows = 0..frame.camera.intrinsics.height;
        for v in rows.filter(|&v| !frame.span(v).is_empty()) {
            row.take(frame, v);
            for (k, u) in frame.span(v).enumerate() {
                let index = frame.index(u, v);
                if frame.depth[index] > 0.0 {
                    self.push(row.point(k), frame.color[index]);
                }
            }
        }
    }

    /// The first point in each voxel of `grid`, in the order of the points.
    pub fn voxel_downsample(&self, grid: VoxelGrid) -> PointCloud {
        let mut occupied = CellSet::default();
        let mut kept = PointCloud::default();
        for (point, color) in self.points.iter().zip(&self.colors) {
            let cell = std::array::from_fn(|axis| grid.cell(axis, point[axis]));
            if occupied.insert(cell) {
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
