//! From the rows of a frame to points.

use pulp::Arch;

use super::VoxelGrid;
use crate::render::RgbdFrame;

/// The points that one row of a frame shows, pixel by pixel along the row's span; memory is reused.
#[derive(Debug, Default)]
pub(super) struct RowPoints {
    /// Normalised coordinates of the pixels.
    rays: [Vec<f64>; 2],
    /// World coordinates (m).
    axes: [Vec<f32>; 3],
    /// Cells of a voxel grid.
    cells: [Vec<i32>; 3],
}

impl RowPoints {
    /// Computes the points of row `v`; where a pixel has no depth, the camera's place.
    pub fn take(&mut self, frame: &RgbdFrame, v: u32) {
        let (k, span) = (&frame.camera.intrinsics, frame.span(v));
        // Normalised coordinates of the row's pixels.
        let [x, y] = &mut self.rays;
        x.clear();
        y.clear();
        match k.distortion {
            None => {
                x.extend(span.clone().map(|u| (f64::from(u) - k.cx) / k.fx));
                y.resize(x.len(), (f64::from(v) - k.cy) / k.fy);
            }
            Some(_) => {
                for u in span.clone() {
                    let seen = k.normalised(f64::from(u), f64::from(v));
                    x.push(seen.x);
                    y.push(seen.y);
                }
            }
        }
        // p + z R (x, y, 1), axis by axis of the world.
        let first = frame.index(span.start, v);
        let depth = &frame.depth[first..first + span.len()];
        let rotation = frame.camera.pose.rotation.to_rotation_matrix();
        let position = frame.camera.pose.translation.vector;
        for (axis, points) in self.axes.iter_mut().enumerate() {
            points.resize(depth.len(), 0.0);
            let [across, down, ahead] = [0, 1, 2].map(|k| rotation[(axis, k)]);
            let from = position[axis];
            Arch::new().dispatch(
                #[inline(always)]
                || {
                    for (((point, z), x), y) in points.iter_mut().zip(depth).zip(&*x).zip(&*y) {
                        let z = f64::from(*z);
                        *point = (from + z * (across * x + down * y + ahead)) as f32;
                    }
                },
            );
        }
    }

    /// Finds the cells of `grid` that the points are in.
    pub fn find_cells(&mut self, grid: &VoxelGrid) {
        for (axis, (cells, points)) in self.cells.iter_mut().zip(&self.axes).enumerate() {
            cells.resize(points.len(), 0);
            Arch::new().dispatch(
                #[inline(always)]
                || {
                    for (cell, x) in cells.iter_mut().zip(points) {
                        *cell = grid.cell(axis, *x);
                    }
                },
            );
        }
    }

    /// Point `k` of the row (m).
    pub fn point(&self, k: usize) -> [f32; 3] {
        [self.axes[0][k], self.axes[1][k], self.axes[2][k]]
    }

    /// Cell of point `k` of the row.
    pub fn cell(&self, k: usize) -> [i32; 3] {
        [self.cells[0][k], self.cells[1][k], self.cells[2][k]]
    }
}
