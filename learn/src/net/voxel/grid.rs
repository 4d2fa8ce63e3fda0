//! Where the voxels of a grid lie in memory.

use crate::net::kernels::float32::Rows;

/// A cube of `r^3` voxels as rows of features, with zero rows as padding for 3 x 3 x 3 convolutions.
///
/// Every line of `r` voxels along x is followed by one row of padding, every plane of lines by one line of padding; before
/// the first plane and behind the last there is enough of it too. So a voxel's neighbour is at the same distance for all
/// voxels, and padding serves both of its sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Grid {
    /// Voxels per edge.
    pub resolution: usize,
}

impl Grid {
    /// Rows from one line to the next.
    pub fn line(self) -> usize {
        self.resolution + 1
    }

    /// Rows from one plane to the next.
    pub fn plane(self) -> usize {
        self.line() * self.line()
    }

    /// Rows of padding before the first plane, and behind the last: the distance of the farthest neighbour.
    pub fn margin(self) -> usize {
        self.plane() + self.line() + 1
    }

    /// The rows of a voxel, counted from the first plane.
    pub fn row(self, [x, y, z]: [usize; 3]) -> usize {
        z * self.plane() + y * self.line() + x
    }

    /// Number of voxels.
    pub fn voxels(self) -> usize {
        self.resolution.pow(3)
    }

    /// Makes `buffer` a grid of `channels` features per voxel. Padding is zero; so it stays, as nothing writes to it.
    pub fn prepare(self, buffer: &mut Vec<f32>, channels: usize) {
        let len = (self.resolution * self.plane() + 2 * self.margin()) * channels;
        if buffer.len() != len {
            buffer.clear();
            buffer.resize(len, 0.0);
        }
    }

    /// The planes without the margins.
    pub fn body(self, buffer: &[f32], channels: usize) -> &[f32] {
        let margin = self.margin() * channels;
        &buffer[margin..buffer.len() - margin]
    }

    /// The planes without the margins.
    pub fn body_mut(self, buffer: &mut [f32], channels: usize) -> &mut [f32] {
        let (margin, len) = (self.margin() * channels, buffer.len());
        &mut buffer[margin..len - margin]
    }

    /// The planes as blocks of rows.
    pub fn rows(self) -> Rows {
        Rows {
            block: self.plane(),
            lines: self.resolution,
            line: self.resolution,
            step: self.line(),
            count: self.voxels(),
        }
    }

    /// Sets the padding within a plane to zero.
    pub fn clear_padding(self, plane: &mut [f32], channels: usize) {
        let (line, real) = (self.line() * channels, self.resolution * channels);
        let (lines, rest) = plane.split_at_mut(self.resolution * line);
        lines
            .chunks_exact_mut(line)
            .for_each(|line| line[real..].fill(0.0));
        rest.fill(0.0);
    }
}
