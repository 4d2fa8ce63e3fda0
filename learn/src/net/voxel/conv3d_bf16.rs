//! Convolution of a grid with bfloat16 products.
//!
//! Three neighbours along x are three adjacent rows of a grid, one row of a left matrix: nine products, one for each line
//! of neighbours, are the whole convolution, and their sum stays in registers. So is the gradient by the input, from
//! weights in the reverse order. The gradient by the weight has the rows as its inner dimension.

use faer::Accum;
use rayon::prelude::*;

use super::conv3d::{Conv3d, NEIGHBOURS, shift};
use super::grid::Grid;
use crate::net::kernels::bfloat16::{Floats, Operands, Taps, Tiles, padded};
use crate::net::kernels::float32::{Sums, fill_rows};
use crate::net::layers::Passes;

/// Lines of neighbours, and neighbours in a line.
const LINES: usize = NEIGHBOURS / LINE;
const LINE: usize = 3;

/// A convolution's weight in tiles, a line of neighbours at a time.
#[derive(Debug, Default)]
pub struct PackedConv {
    forward: Packed,
    backward: Packed,
}

#[derive(Debug, Default)]
struct Packed([PackedLine; LINES]);

/// A right matrix; the inner dimension is a line's three neighbours, and the features of each.
#[derive(Debug, Default)]
struct PackedLine {
    tiles: Tiles,
    /// The same in floats.
    floats: Vec<f32>,
}

impl PackedConv {
    /// Packs the weight of `conv`.
    pub fn set(&mut self, conv: &Conv3d, params: &[f32], passes: Passes) {
        let (inputs, outputs) = (conv.inputs, conv.outputs);
        let weights = &params[conv.weight.clone()];
        let weight =
            |neighbour: usize| &weights[neighbour * inputs * outputs..][..inputs * outputs];
        self.forward.each(|line, PackedLine { tiles, floats }| {
            let stride = padded(inputs);
            floats.resize(outputs * LINE * stride, 0.0);
            for (output, row) in floats.chunks_exact_mut(LINE * stride).enumerate() {
                for (x, to) in row.chunks_exact_mut(stride).enumerate() {
                    let from = &weight(line * LINE + x)[output * inputs..][..inputs];
                    to[..inputs].copy_from_slice(from);
                }
            }
            tiles.set_right_transposed(Floats::dense(floats, LINE * stride));
        });
        if passes == Passes::Training {
            self.backward.each(|line, PackedLine { tiles, floats }| {
                let stride = padded(outputs);
                floats.resize(LINE * stride * inputs, 0.0);
                for (x, to) in floats.chunks_exact_mut(stride * inputs).enumerate() {
                    let from = weight(NEIGHBOURS - 1 - (line * LINE + x));
                    to[..outputs * inputs].copy_from_slice(from);
                }
                tiles.set_right(Floats::dense(floats, inputs));
            });
        }
    }
}

impl Packed {
    fn each(&mut self, pack: impl Fn(usize, &mut PackedLine) + Sync) {
        self.0
            .par_iter_mut()
            .enumerate()
            .for_each(|(line, packed)| pack(line, packed));
    }

    /// Grid `y` of `columns` features from the grid in `operands`; `prepare` as [`Operands::multiply`] has it.
    fn convolve(
        &self,
        grid: Grid,
        operands: &Operands,
        y: &mut [f32],
        columns: usize,
        prepare: impl Fn(&mut [f32]) -> Accum + Sync,
    ) {
        let taps = Taps {
            starts: std::array::from_fn(|line| shift(grid, line * LINE)),
            adjacent: LINE,
            matrices: self.0.each_ref().map(|packed| &packed.tiles),
        };
        let body = grid.body_mut(y, columns);
        operands.multiply(&taps, body, columns, prepare);
        body.par_chunks_mut(grid.plane() * columns)
            .for_each(|plane| grid.clear_padding(plane, columns));
    }
}

impl Conv3d {
    /// [`Conv3d::forward`], with the weight packed.
    pub fn forward_bf16(
        &self,
        params: &[f32],
        packed: &PackedConv,
        operands: &mut Operands,
        x: &[f32],
        y: &mut [f32],
    ) {
        let bias = &params[self.bias.clone()];
        operands.set_left(x, self.inputs);
        packed
            .forward
            .convolve(self.grid, operands, y, self.outputs, |y| {
                fill_rows(y, bias);
                Accum::Add
            });
    }

    /// [`Conv3d::backward_input`], with the weight packed.
    pub fn backward_input_bf16(
        &self,
        packed: &PackedConv,
        operands: &mut Operands,
        dy: &[f32],
        dx: &mut [f32],
    ) {
        operands.set_left(dy, self.outputs);
        packed
            .backward
            .convolve(self.grid, operands, dx, self.inputs, |_| Accum::Replace);
    }

    /// [`Conv3d::backward`] with bfloat16 products.
    pub fn backward_bf16(
        &self,
        operands: &mut Operands,
        gradient: &mut [f32],
        x: &[f32],
        dy: &[f32],
        sums: &mut Sums,
    ) {
        let starts: [usize; NEIGHBOURS] = std::array::from_fn(|n| shift(self.grid, n));
        let dy = self.grid.body(dy, self.outputs);
        let weight = &mut gradient[self.weight.clone()];
        operands.add_weight_gradient(starts, (x, self.inputs), (dy, self.outputs), weight);
        sums.add_columns(dy, self.grid.rows(), &mut gradient[self.bias.clone()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::kernels::check::{numbers, single};
    use crate::net::parameters::Table;

    /// Whole numbers and halves: bfloat16 holds them, and floats hold their sums.
    fn halves(seed: u64, len: usize) -> Vec<f64> {
        let numbers = numbers(seed, len);
        numbers.iter().map(|x| (x * 8.0).round() / 2.0).collect()
    }

    /// On the unit that this machine has; products of either unit have tests of their own.
    #[test]
    fn bfloat16_products_give_what_those_of_floats_give() {
        for (resolution, [inputs, outputs]) in
            [(3, [2, 3]), (9, [37, 20]), (5, [16, 80]), (4, [112, 112])]
        {
            let grid = Grid { resolution };
            let mut table = Table::default();
            let conv = Conv3d::declare(&mut table, "conv", grid, inputs, outputs);
            let params = single(&halves(1, table.len()));
            let fresh = |channels| {
                let mut buffer = Vec::new();
                grid.prepare(&mut buffer, channels);
                buffer
            };
            let filled = |seed, channels| {
                let mut buffer = fresh(channels);
                let body = grid.body_mut(&mut buffer, channels);
                body.copy_from_slice(&single(&halves(seed, body.len())));
                let planes = body.chunks_mut(grid.plane() * channels);
                planes.for_each(|plane| grid.clear_padding(plane, channels));
                buffer
            };
            let (x, dy) = (filled(2, inputs), filled(3, outputs));
            let (mut packed, mut operands) = (PackedConv::default(), Operands::default());
            packed.set(&conv, &params, Passes::Training);

            let (mut y, mut expected) = (fresh(outputs), fresh(outputs));
            conv.forward(&params, &x, &mut expected);
            conv.forward_bf16(&params, &packed, &mut operands, &x, &mut y);
            assert_eq!(y, expected, "forward, {conv:?}");

            let (mut dx, mut expected) = (fresh(inputs), fresh(inputs));
            conv.backward_input(&params, &dy, &mut expected);
            conv.backward_input_bf16(&packed, &mut operands, &dy, &mut dx);
            assert_eq!(dx, expected, "gradient by the input, {conv:?}");

            let mut gradients = [vec![1.0; table.len()], vec![1.0; table.len()]];
            conv.backward(&mut gradients[0], &x, &dy, &mut Sums::default());
            conv.backward_bf16(
                &mut operands,
                &mut gradients[1],
                &x,
                &dy,
                &mut Sums::default(),
            );
            assert_eq!(
                gradients[1], gradients[0],
                "gradient by the weight, {conv:?}"
            );
        }
    }
}
