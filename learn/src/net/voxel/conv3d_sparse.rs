//! Convolution of a grid in which few voxels are occupied: products for those alone (Graham, Engelcke and van der Maaten,
//! CVPR 2018). Outputs are as dense as any convolution's.
//!
//! The first convolution of a block sees points: 2,048 of them fill a tenth of 24^3 voxels, a sixth of 16^3. Products for those
//! alone, whose outputs are scattered and whose gradients' neighbours are gathered, take a sixth of the time, and a training
//! step half. After the first convolution all voxels have features.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::conv3d::{Conv3d, NEIGHBOURS, shift};
use super::occupied::{Occupied, Sparse};
use crate::net::kernels::float32::{Sums, fill_rows, vectorised};
use crate::pool::Pool;

/// Neighbours in a plane.
const PLANE: usize = 9;

/// Occupied voxels that a product takes: what is gathered for them stays in a core's cache.
const ROWS: usize = 128;

/// Buffers for features gathered or to be scattered, kept from call to call.
pub type Buffers = Pool<Vec<f32>>;

impl Conv3d {
    /// [`Conv3d::forward`] of a few voxels' features.
    pub fn forward_sparse(&self, params: &[f32], x: Sparse, buffers: &Buffers, y: &mut [f32]) {
        let Sparse {
            voxels, features, ..
        } = x;
        let (grid, bias) = (self.grid, &params[self.bias.clone()]);
        let (inputs, outputs) = (self.inputs, self.outputs);
        let weights = &params[self.weight.clone()];
        self.per_plane(y, outputs, |start, y| {
            fill_rows(y, bias);
            let plane = start / grid.plane();
            for (distance, weight) in weights.chunks_exact(PLANE * inputs * outputs).enumerate() {
                // Padding before the first plane and behind the last is empty.
                let Some(from) = (plane + distance).checked_sub(1) else {
                    continue;
                };
                if from == grid.resolution {
                    continue;
                }
                // Products of the voxels in plane `from` with the nine weights that reach this plane, then added where they
                // belong.
                let weight = MatRef::from_row_major_slice(weight, PLANE * outputs, inputs);
                for block in blocks(voxels.of_plane(from)) {
                    let rows = &voxels.rows()[block.clone()];
                    let x = &features[block.start * inputs..block.end * inputs];
                    let x = MatRef::from_row_major_slice(x, rows.len(), inputs);
                    self.with_buffer(buffers, [rows.len(), PLANE], |products| {
                        let all =
                            MatMut::from_row_major_slice_mut(products, rows.len(), PLANE * outputs);
                        matmul(all, Accum::Replace, x, weight.transpose(), 1.0, Par::Seq);
                        let origin = from * grid.plane();
                        scatter(products, rows, origin, grid.line(), outputs, y);
                    });
                }
            }
        });
    }

    /// [`Conv3d::backward_input`] for a few voxels: gradient `dx` `(M, inputs)`.
    pub fn backward_input_sparse(
        &self,
        params: &[f32],
        voxels: &Occupied,
        dy: &[f32],
        buffers: &Buffers,
        dx: &mut [f32],
    ) {
        let (inputs, outputs) = (self.inputs, self.outputs);
        let weight = &params[self.weight.clone()];
        let weight = MatRef::from_row_major_slice(weight, NEIGHBOURS * outputs, inputs);
        dx.par_chunks_mut(ROWS * inputs)
            .zip(voxels.rows().par_chunks(ROWS))
            .for_each(|(dx, rows)| {
                self.with_buffer(buffers, [rows.len(), NEIGHBOURS], |gathered| {
                    // A row per voxel: dy at all of its neighbours. One product with all weights sums over them.
                    for (row, gathered) in rows
                        .iter()
                        .zip(gathered.chunks_exact_mut(NEIGHBOURS * outputs))
                    {
                        for (neighbour, to) in gathered.chunks_exact_mut(outputs).enumerate() {
                            to.copy_from_slice(self.at_inverse_neighbour(dy, *row, neighbour));
                        }
                    }
                    let dy =
                        MatRef::from_row_major_slice(gathered, rows.len(), NEIGHBOURS * outputs);
                    let dx = MatMut::from_row_major_slice_mut(dx, rows.len(), inputs);
                    matmul(dx, Accum::Replace, dy, weight, 1.0, Par::Seq);
                });
            });
    }

    /// [`Conv3d::backward`] of a few voxels' features.
    pub fn backward_sparse(
        &self,
        gradient: &mut [f32],
        x: Sparse,
        dy: &[f32],
        buffers: &Buffers,
        sums: &mut Sums,
    ) {
        let Sparse {
            voxels, features, ..
        } = x;
        let (inputs, outputs) = (self.inputs, self.outputs);
        gradient[self.weight.clone()]
            .par_chunks_mut(inputs * outputs)
            .enumerate()
            .for_each(|(neighbour, dw)| {
                for block in blocks(0..voxels.rows().len()) {
                    let rows = &voxels.rows()[block.clone()];
                    self.with_buffer(buffers, [rows.len(), 1], |gathered| {
                        for (row, to) in rows.iter().zip(gathered.chunks_exact_mut(outputs)) {
                            to.copy_from_slice(self.at_inverse_neighbour(dy, *row, neighbour));
                        }
                        let dy = MatRef::from_row_major_slice(gathered, rows.len(), outputs);
                        let x = &features[block.start * inputs..block.end * inputs];
                        let x = MatRef::from_row_major_slice(x, rows.len(), inputs);
                        let dw = MatMut::from_row_major_slice_mut(dw, outputs, inputs);
                        matmul(dw, Accum::Add, dy.transpose(), x, 1.0, Par::Seq);
                    });
                }
            });
        let (grid, bias) = (self.grid, &mut gradient[self.bias.clone()]);
        sums.add_columns(grid.body(dy, outputs), grid.rows(), bias);
    }

    /// The features in the grid `dy` of the voxel whose neighbour number `neighbour` is the voxel at `row`.
    fn at_inverse_neighbour<'a>(&self, dy: &'a [f32], row: usize, neighbour: usize) -> &'a [f32] {
        let row = row + 2 * self.grid.margin() - shift(self.grid, neighbour);
        &dy[row * self.outputs..][..self.outputs]
    }

    /// Runs `work` with a buffer for the outputs of `neighbours` neighbours of `rows` voxels.
    fn with_buffer(
        &self,
        buffers: &Buffers,
        [rows, neighbours]: [usize; 2],
        work: impl FnOnce(&mut [f32]),
    ) {
        let most = ROWS * NEIGHBOURS * self.outputs;
        buffers.with(
            || vec![0.0; most],
            |buffer| work(&mut buffer[..rows * neighbours * self.outputs]),
        );
    }
}

/// `range` in blocks.
fn blocks(range: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let end = range.end;
    range
        .step_by(ROWS)
        .map(move |start| start..end.min(start + ROWS))
}

vectorised! {
    /// Adds `products`, of each of `rows` for all neighbours in a plane, to the rows of the plane `y` that they are
    /// neighbours of. `origin` is the row where the plane of `rows` starts, `line` the rows from line to line.
    fn scatter(
        products: &'a [f32],
        rows: &'a [usize],
        origin: usize,
        line: usize,
        channels: usize,
        y: &'a mut [f32],
    ) {
        for (row, products) in rows.iter().zip(products.chunks_exact(PLANE * channels)) {
            for (neighbour, products) in products.chunks_exact(channels).enumerate() {
                // The neighbour of the row that it is added to lies on the other side. Before the first line is padding.
                let moved = row - origin + line + 1;
                let Some(to) = moved.checked_sub(neighbour / 3 * line + neighbour % 3) else {
                    continue;
                };
                let y = &mut y[to * channels..][..channels];
                y.iter_mut().zip(products).for_each(|(y, product)| *y += product);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::grid::Grid;
    use super::*;
    use crate::net::kernels::check::{numbers, single};
    use crate::net::parameters::Table;

    const SIZES: [usize; 2] = [5, 3];

    /// Every `step`-th voxel of `grid` is occupied.
    fn occupied(grid: Grid, step: usize) -> Occupied {
        let mut counts = vec![0; grid.resolution * grid.plane()];
        let r = grid.resolution;
        for voxel in (0..grid.voxels()).step_by(step) {
            counts[grid.row([voxel % r, voxel / r % r, voxel / (r * r)])] = 1;
        }
        let mut occupied = Occupied::default();
        occupied.set(grid, &counts, grid.voxels());
        occupied
    }

    fn assert_close(found: &[f32], expected: &[f32]) {
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert!(
                (found - expected).abs() < 1e-4,
                "{found} instead of {expected}"
            );
        }
    }

    #[test]
    fn output_and_gradients_are_those_of_the_dense_convolution() {
        let [inputs, outputs] = SIZES;
        for (resolution, step) in [(1, 1), (2, 3), (6, 1), (6, 7), (7, 2)] {
            let grid = Grid { resolution };
            let mut table = Table::default();
            let conv = Conv3d::declare(&mut table, "conv", grid, inputs, outputs);
            let params = single(&numbers(1, table.len()));
            let occupied = occupied(grid, step);
            let x = single(&numbers(2, occupied.rows().len() * inputs));
            let [mut dense_x, mut y, mut dense_y, mut dy, mut dense_dx] = Default::default();
            for (buffer, channels) in [(&mut dense_x, inputs), (&mut dense_dx, inputs)] {
                grid.prepare(buffer, channels);
            }
            for buffer in [&mut y, &mut dense_y, &mut dy] {
                grid.prepare(buffer, outputs);
            }
            let sparse = Sparse {
                voxels: &occupied,
                features: &x,
                channels: inputs,
            };
            sparse.spread(grid, &mut dense_x);
            let (buffers, sums) = (Buffers::default(), &mut Sums::default());

            conv.forward_sparse(&params, sparse, &buffers, &mut y);
            conv.forward(&params, &dense_x, &mut dense_y);
            assert_close(&y, &dense_y);

            let numbers = single(&numbers(3, resolution * grid.plane() * outputs));
            let body = grid.body_mut(&mut dy, outputs);
            body.copy_from_slice(&numbers);
            body.chunks_exact_mut(grid.plane() * outputs)
                .for_each(|plane| grid.clear_padding(plane, outputs));
            let mut dx = vec![0.0; x.len()];
            conv.backward_input_sparse(&params, &occupied, &dy, &buffers, &mut dx);
            conv.backward_input(&params, &dy, &mut dense_dx);
            let mut expected = vec![0.0; x.len()];
            occupied.collect(grid, &dense_dx, inputs, &mut expected);
            assert_close(&dx, &expected);

            let [mut gradient, mut expected] = [(); 2].map(|()| vec![1.0; table.len()]);
            conv.backward_sparse(&mut gradient, sparse, &dy, &buffers, sums);
            conv.backward(&mut expected, &dense_x, &dy, sums);
            assert_close(&gradient, &expected);
        }
    }
}
