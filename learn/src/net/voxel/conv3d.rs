//! Convolution of a grid with 3 x 3 x 3 weights.
//!
//! A convolution is 27 products of shifted rows: in a grid whose lines and planes share their zero padding, a voxel's
//! neighbours are at fixed distances, so nothing is gathered (a twelfth of the rows is padding at 24 voxels per edge). Three
//! neighbours in one product of overlapping rows are no faster in floats.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::grid::Grid;
use crate::net::kernels::float32::{Sums, fill_rows};
use crate::net::parameters::{Table, fan_in};

/// Number of neighbours of a voxel, itself included.
pub const NEIGHBOURS: usize = 27;

/// `y(v) = b + sum over offsets o in {-1, 0, 1}^3 of W_o x(v + o)`, with zeros outside the grid.
///
/// The weight is stored offset by offset, `(3, 3, 3, outputs, inputs)` with the axes z, y, x: the products that the
/// layer consists of, one per offset, take their matrices from it as they lie there.
#[derive(Clone, Debug)]
pub struct Conv3d {
    pub grid: Grid,
    pub inputs: usize,
    pub outputs: usize,
    pub weight: Range<usize>,
    pub bias: Range<usize>,
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

    /// Floating-point operations of the forward pass where no voxel is empty.
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
    pub fn per_plane(
        &self,
        y: &mut [f32],
        channels: usize,
        work: impl Fn(usize, &mut [f32]) + Sync,
    ) {
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
pub fn shift(grid: Grid, neighbour: usize) -> usize {
    grid.row([neighbour % 3, neighbour / 3 % 3, neighbour / 9])
}

fn shifts(grid: Grid) -> impl Iterator<Item = usize> {
    (0..NEIGHBOURS).map(move |neighbour| shift(grid, neighbour))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::kernels::check::{assert_close, assert_is_gradient, numbers, single};

    const GRID: Grid = Grid { resolution: 3 };
    const SIZES: [usize; 2] = [2, 3];

    fn layer() -> (Conv3d, usize) {
        let mut table = Table::default();
        let conv = Conv3d::declare(&mut table, "conv", GRID, SIZES[0], SIZES[1]);
        (conv, table.len())
    }

    /// The voxels' features, without padding.
    fn dense(grid: &[f32], channels: usize) -> Vec<f32> {
        let planes = GRID.body(grid, channels).chunks(GRID.plane() * channels);
        let lines = |plane: &[f32]| {
            let lines = GRID.rows().lines(plane.len(), channels);
            lines
                .flat_map(|line| plane[line].to_vec())
                .collect::<Vec<_>>()
        };
        planes.flat_map(lines).collect()
    }

    fn padded(voxels: &[f64], channels: usize) -> Vec<f32> {
        let mut grid = Vec::new();
        GRID.prepare(&mut grid, channels);
        let body = GRID.body_mut(&mut grid, channels);
        for (index, voxel) in voxels.chunks(channels).enumerate() {
            let row = GRID.row([index % 3, index / 3 % 3, index / 9]);
            for (k, value) in voxel.iter().enumerate() {
                body[row * channels + k] = *value as f32;
            }
        }
        grid
    }

    /// The definition, in f64.
    fn convolve(params: &[f64], x: &[f64]) -> Vec<f64> {
        let [inputs, outputs] = SIZES;
        let (weight, bias) = params.split_at(NEIGHBOURS * inputs * outputs);
        let at = |v: [i64; 3], k: usize| {
            let inside = v.iter().all(|v| (0..3).contains(v));
            let row = (v[2] * 9 + v[1] * 3 + v[0]) as usize;
            if inside { x[row * inputs + k] } else { 0.0 }
        };
        let mut y = Vec::new();
        for voxel in 0..27i64 {
            let v = [voxel % 3, voxel / 3 % 3, voxel / 9];
            for o in 0..outputs {
                let mut sum = bias[o];
                for n in 0..27i64 {
                    let moved = [v[0] + n % 3 - 1, v[1] + n / 3 % 3 - 1, v[2] + n / 9 - 1];
                    for k in 0..inputs {
                        let weight = weight[(n as usize * outputs + o) * inputs + k];
                        sum += weight * at(moved, k);
                    }
                }
                y.push(sum);
            }
        }
        y
    }

    #[test]
    fn output_and_gradients_are_those_of_the_definition() {
        let (conv, parameters) = layer();
        let [inputs, outputs] = SIZES;
        let (params, x) = (numbers(1, parameters), numbers(2, 27 * inputs));
        let weights = numbers(3, 27 * outputs);
        let (p32, x32) = (single(&params), padded(&x, inputs));

        let mut y = padded(&[], outputs);
        conv.forward(&p32, &x32, &mut y);
        assert_close(&dense(&y, outputs), &convolve(&params, &x));
        assert_eq!(
            y.iter().filter(|y| **y != 0.0).count(),
            27 * outputs,
            "padding stays zero"
        );

        let dy = padded(&weights, outputs);
        let (mut dx, mut gradient) = (padded(&[], inputs), vec![0.0; parameters]);
        conv.backward_input(&p32, &dy, &mut dx);
        conv.backward(&mut gradient, &x32, &dy, &mut Sums::default());
        assert_is_gradient(&dense(&dx, inputs), &x, &weights, |x| convolve(&params, x));
        assert_is_gradient(&gradient, &params, &weights, |params| convolve(params, &x));
    }

    #[test]
    fn flops_are_two_for_every_weight_and_voxel() {
        let (conv, parameters) = layer();
        assert_eq!(conv.flops(), 2 * 27 * (parameters - SIZES[1]) as u64);
    }
}
