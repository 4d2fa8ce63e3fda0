//! Convolution of a grid with 3 x 3 x 3 weights.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::grid::Grid;
use super::kernels::fill_rows;
use super::rows::Sums;
use super::shape::{Table, fan_in};

/// Number of neighbours of a voxel, itself included.
const NEIGHBOURS: usize = 27;

/// `y(v) = b + sum over offsets o in {-1, 0, 1}^3 of W_o x(v + o)`, with zeros outside the grid.
///
/// The weight is stored offset by offset, `(3, 3, 3, outputs, inputs)` with the axes z, y, x: the products that the
/// layer consists of, one per offset, take their matrices from it as they lie there.
#[derive(Clone, Debug)]
pub(super) struct Conv3d {
    pub grid: Grid,
    inputs: usize,
    outputs: usize,
    weight: Range<usize>,
    bias: Range<usize>,
}

impl Conv3d {
    /// Adds the layer's tensors; they start as PyTorch's.
    pub fn declare(
        table: &mut Table,
        name: &str,
        grid: Grid,
        inputs: usize,
        outputs: usize,
    ) -> Self {
        let initial = fan_in(NEIGHBOURS * inputs);
        Self {
            grid,
            inputs,
            outputs,
            weight: table.push(
                format!("{name}.weight"),
                &[3, 3, 3, outputs, inputs],
                initial,
            ),
            bias: table.push(format!("{name}.bias"), &[outputs], initial),
        }
    }

    /// Floating-point operations of the forward pass.
    pub fn flops(&self) -> u64 {
        2 * (NEIGHBOURS * self.grid.voxels() * self.inputs * self.outputs) as u64
    }

    /// Grid `y` of `outputs` features from grid `x` of `inputs` features.
    pub fn forward(&self, params: &[f32], x: &[f32], y: &mut [f32]) {
        let (grid, bias) = (self.grid, &params[self.bias.clone()]);
        self.per_plane(y, self.outputs, |start, y| {
            fill_rows(y, bias);
            for (weight, shift) in self.weights(params).zip(shifts(grid)) {
                let x = rows_at(x, self.inputs, start + shift, grid.plane());
                let y = MatMut::from_row_major_slice_mut(y, grid.plane(), self.outputs);
                matmul(y, Accum::Add, x, weight.transpose(), 1.0, Par::Seq);
            }
        });
    }

    /// Grid `dx`, the gradient by `x`, from grid `dy`, the gradient by `y`.
    pub fn backward_input(&self, params: &[f32], dy: &[f32], dx: &mut [f32]) {
        let grid = self.grid;
        self.per_plane(dx, self.inputs, |start, dx| {
            dx.fill(0.0);
            for (weight, shift) in self.weights(params).zip(shifts(grid)) {
                let start = start + 2 * grid.margin() - shift;
                let dy = rows_at(dy, self.outputs, start, grid.plane());
                let dx = MatMut::from_row_major_slice_mut(dx, grid.plane(), self.inputs);
                matmul(dx, Accum::Add, dy, weight, 1.0, Par::Seq);
            }
        });
    }

    /// Adds the gradients by weight and bias.
    pub fn backward(&self, gradient: &mut [f32], x: &[f32], dy: &[f32], sums: &mut Sums) {
        let grid = self.grid;
        let (inputs, outputs) = (self.inputs, self.outputs);
        gradient[self.weight.clone()]
            .par_chunks_mut(inputs * outputs)
            .enumerate()
            .for_each(|(neighbour, dw)| {
                for plane in 0..grid.resolution {
                    let start = plane * grid.plane();
                    let x = rows_at(x, inputs, start + shift(grid, neighbour), grid.plane());
                    let dy = rows_at(dy, outputs, start + grid.margin(), grid.plane());
                    let dw = MatMut::from_row_major_slice_mut(dw, outputs, inputs);
                    matmul(dw, Accum::Add, dy.transpose(), x, 1.0, Par::Seq);
                }
            });
        let bias = &mut gradient[self.bias.clone()];
        sums.add_columns(grid.body(dy, outputs), grid.rows(), bias);
    }

    /// Runs `work` on every plane of `y`, with the row where it starts counted from the first plane; then clears the
    /// padding, into which the products also write.
    fn per_plane(&self, y: &mut [f32], channels: usize, work: impl Fn(usize, &mut [f32]) + Sync) {
        let grid = self.grid;
        grid.body_mut(y, channels)
            .par_chunks_mut(grid.plane() * channels)
            .enumerate()
            .for_each(|(plane, y)| {
                work(plane * grid.plane(), y);
                grid.clear_padding(y, channels);
            });
    }

    fn weights<'a>(&self, params: &'a [f32]) -> impl Iterator<Item = MatRef<'a, f32>> {
        let (inputs, outputs) = (self.inputs, self.outputs);
        params[self.weight.clone()]
            .chunks_exact(inputs * outputs)
            .map(move |weight| MatRef::from_row_major_slice(weight, outputs, inputs))
    }
}

/// `count` rows of a grid with margins.
fn rows_at(grid: &[f32], channels: usize, start: usize, count: usize) -> MatRef<'_, f32> {
    let rows = &grid[start * channels..(start + count) * channels];
    MatRef::from_row_major_slice(rows, count, channels)
}

/// Distance in rows to a neighbour, plus the margin.
fn shift(grid: Grid, neighbour: usize) -> usize {
    grid.row([neighbour % 3, neighbour / 3 % 3, neighbour / 9])
}

fn shifts(grid: Grid) -> impl Iterator<Item = usize> {
    (0..NEIGHBOURS).map(move |neighbour| shift(grid, neighbour))
}
