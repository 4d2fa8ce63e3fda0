//! The voxels of a grid that hold points.

use std::ops::Range;

use rayon::prelude::*;

use super::grid::Grid;

/// Rows of the voxels that hold points, ascending: most voxels about a cloud are empty.
#[derive(Debug, Default)]
pub struct Occupied {
    rows: Vec<usize>,
    /// Where the voxels of each plane start among them, and their number.
    planes: Vec<usize>,
}

impl Occupied {
    /// The voxels of `grid` with a number above zero in `counts`, one for each of the grid's rows without its margins.
    /// Allocates for `most` of them, the most there may be.
    pub fn set(&mut self, grid: Grid, counts: &[u32], most: usize) {
        self.rows.clear();
        self.rows.reserve(most);
        self.planes.clear();
        for (plane, counts) in counts.chunks_exact(grid.plane()).enumerate() {
            self.planes.push(self.rows.len());
            let filled = counts.iter().enumerate().filter(|(_, count)| **count > 0);
            self.rows
                .extend(filled.map(|(row, _)| plane * grid.plane() + row));
        }
        self.planes.push(self.rows.len());
    }

    /// Rows of the voxels, counted from the first plane.
    pub fn rows(&self) -> &[usize] {
        &self.rows
    }

    /// Which of them lie in plane `plane`.
    pub fn of_plane(&self, plane: usize) -> Range<usize> {
        self.planes[plane]..self.planes[plane + 1]
    }

    /// The voxels' features `x` `(M, C)` from a grid.
    pub fn collect(&self, grid: Grid, voxels: &[f32], channels: usize, x: &mut [f32]) {
        let voxels = grid.body(voxels, channels);
        x.par_chunks_exact_mut(channels)
            .zip(&self.rows)
            .for_each(|(x, row)| x.copy_from_slice(&voxels[row * channels..][..channels]));
    }
}

/// Features `(M, C)` of the voxels that hold points; all others have none.
#[derive(Clone, Copy)]
pub struct Sparse<'a> {
    pub voxels: &'a Occupied,
    pub features: &'a [f32],
    pub channels: usize,
}

impl Sparse<'_> {
    /// Puts the features into a grid, zeros in all other voxels.
    pub fn spread(self, grid: Grid, all: &mut [f32]) {
        let c = self.channels;
        grid.body_mut(all, c)
            .par_chunks_mut(grid.plane() * c)
            .enumerate()
            .for_each(|(plane, all)| {
                all.fill(0.0);
                for index in self.voxels.of_plane(plane) {
                    let row = self.voxels.rows[index] - plane * grid.plane();
                    all[row * c..][..c].copy_from_slice(&self.features[index * c..][..c]);
                }
            });
    }
}
