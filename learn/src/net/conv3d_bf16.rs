//! Convolution of a grid with bfloat16 products.
//!
//! Three neighbours along x are three adjacent rows of a grid, one row of a left matrix: nine products, one for each line
//! of neighbours, are the whole convolution, and their sum stays in registers. So is the gradient by the input, from
//! weights in the reverse order. The gradient by the weight has the rows as its inner dimension.

use std::ops::Range;

use faer::Accum;
use rayon::prelude::*;

use super::bf16::{Floats, Output, Paired, Passes, Rows, Term, Tiles, multiply_terms, padded};
use super::conv3d::{Conv3d, NEIGHBOURS, shift};
use super::grid::Grid;
use super::kernels::{add, fill_rows};
use super::rows::Sums;

/// Lines of neighbours, and neighbours in a line.
const LINES: usize = NEIGHBOURS / LINE;
const LINE: usize = 3;

/// Rows of a grid that a task of the convolution takes.
const TASK: usize = 128;

/// Rows of a grid that the gradient by the weight sums over before it is read and written again.
const CHUNK: usize = 512;

/// Parts of a grid whose gradients by the weight are summed apart, and then added in order.
const PARTS: usize = 4;

/// A convolution's weight in tiles, a line of neighbours at a time.
#[derive(Debug, Default)]
pub(super) struct PackedConv {
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
        let weight = |neighbour: usize| &weights[neighbour * inputs * outputs..][..inputs * outputs];
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
        self.0.par_iter_mut().enumerate().for_each(|(line, packed)| pack(line, packed));
    }
}

/// A grid as the products take it, and room for the gradient by the weight.
#[derive(Debug, Default)]
pub(super) struct ConvRoom {
    rows: Rows,
    paired: Paired,
    /// The gradient by the output, transposed, a left matrix per chunk of rows.
    transposed: Vec<Tiles>,
    partials: Vec<f32>,
}

impl Conv3d {
    /// [`Conv3d::forward`], with the weight packed.
    pub fn forward_bf16(
        &self,
        params: &[f32],
        packed: &PackedConv,
        room: &mut ConvRoom,
        x: &[f32],
        y: &mut [f32],
    ) {
        room.rows.set(x, self.inputs);
        let bias = &params[self.bias.clone()];
        convolve(self.grid, &room.rows, &packed.forward, self.outputs, y, |y| {
            fill_rows(y, bias);
            Accum::Add
        });
    }

    /// [`Conv3d::backward_input`], with the weight packed.
    pub fn backward_input_bf16(
        &self,
        packed: &PackedConv,
        room: &mut ConvRoom,
        dy: &[f32],
        dx: &mut [f32],
    ) {
        room.rows.set(dy, self.outputs);
        convolve(self.grid, &room.rows, &packed.backward, self.inputs, dx, |_| Accum::Replace);
    }

    /// [`Conv3d::backward`] with bfloat16 products.
    pub fn backward_bf16(
        &self,
        room: &mut ConvRoom,
        gradient: &mut [f32],
        x: &[f32],
        dy: &[f32],
        sums: &mut Sums,
    ) {
        let (inputs, outputs) = (self.inputs, self.outputs);
        let grid = self.grid;
        let ConvRoom {
            rows,
            paired,
            transposed,
            partials,
        } = room;
        rows.set(x, inputs);
        paired.set(rows);
        let body = grid.body(dy, outputs);
        let chunks = body.par_chunks(CHUNK * outputs);
        transposed.resize_with(chunks.len(), Tiles::default);
        let floats = chunks.map(|chunk| Floats::dense(chunk, outputs));
        (transposed.par_iter_mut().zip(floats)).for_each(|(tiles, dy)| tiles.set_left_transposed(dy));

        let weight = NEIGHBOURS * inputs * outputs;
        partials.resize(PARTS * weight, 0.0);
        let per_part = transposed.len().div_ceil(PARTS);
        let tasks = partials.par_chunks_mut(LINE * LINE * inputs * outputs).enumerate();
        tasks.for_each(|(task, partial)| {
            partial.fill(0.0);
            let (part, plane) = (task / LINE, task % LINE);
            let chunks = transposed.iter().enumerate().skip(part * per_part).take(per_part);
            for (chunk, dy) in chunks {
                let rows = chunk * CHUNK..(body.len() / outputs).min((chunk + 1) * CHUNK);
                let weights = partial.chunks_exact_mut(inputs * outputs).enumerate();
                for (index, dw) in weights {
                    let neighbour = plane * LINE * LINE + index;
                    let term = Term {
                        left: dy.panel(0..dy.depth()),
                        right: paired.panel(rows.start + shift(grid, neighbour), rows.len()),
                    };
                    multiply_terms(Output::dense(dw, inputs), Accum::Add, &[term]);
                }
            }
        });
        let stripe = inputs * outputs;
        let gradients = gradient[self.weight.clone()].par_chunks_mut(stripe).enumerate();
        gradients.for_each(|(index, gradient)| {
            for partial in partials.chunks_exact(weight) {
                add(&partial[index * stripe..][..stripe], gradient);
            }
        });
        let bias = &mut gradient[self.bias.clone()];
        sums.add_columns(body, grid.rows(), bias);
    }
}

/// Grid `y` of `columns` features from the grid `x`; `prepare` says what is in `y` before the products.
fn convolve(
    grid: Grid,
    x: &Rows,
    weights: &Packed,
    columns: usize,
    y: &mut [f32],
    prepare: impl Fn(&mut [f32]) -> Accum + Sync,
) {
    let body = grid.body_mut(y, columns);
    let tasks = body.par_chunks_mut(TASK * columns).enumerate();
    tasks.for_each(|(task, y)| {
        let accum = prepare(y);
        let Range { start, end } = task * TASK..task * TASK + y.len() / columns;
        let terms: [Term; LINES] = std::array::from_fn(|line| {
            let right = &weights.0[line].tiles;
            Term {
                left: x.panel(start + shift(grid, line * LINE), end - start, LINE),
                right: right.panel(0..right.depth()),
            }
        });
        multiply_terms(Output::dense(y, columns), accum, &terms);
    });
    body.par_chunks_mut(grid.plane() * columns)
        .for_each(|plane| grid.clear_padding(plane, columns));
}
