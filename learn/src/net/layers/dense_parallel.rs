//! Dense layers over many rows, in parallel.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::dense::Dense;
use super::dense_bf16::PackedWeight;
use super::pass::Weights;
use crate::net::kernels::bfloat16::{Operands, Taps, Tiles};
use crate::net::kernels::float32::{Rows, Sums, fill_rows};

/// Rows, and outputs, that a task of the products takes.
const ROWS: usize = 256;
const OUTPUTS: usize = 32;

impl Dense {
    /// [`Dense::forward`].
    pub fn par_forward(
        &self,
        weights: Weights<PackedWeight>,
        operands: &mut Operands,
        x: &[f32],
        y: &mut [f32],
    ) {
        let params = weights.params;
        let Some(packed) = weights.packed else {
            let rows = x.par_chunks(ROWS * self.inputs);
            return (rows.zip(y.par_chunks_mut(ROWS * self.outputs)))
                .for_each(|(x, y)| self.forward(params, x, y));
        };
        operands.set_left(x, self.inputs);
        operands.multiply(&alone(&packed.forward), y, self.outputs, |y| {
            fill_rows(y, &params[self.bias.clone()]);
            Accum::Add
        });
    }

    /// [`Dense::add_product`].
    pub fn par_add_product(
        &self,
        weights: Weights<PackedWeight>,
        operands: &mut Operands,
        x: &[f32],
        y: &mut [f32],
    ) {
        let Some(packed) = weights.packed else {
            let rows = x.par_chunks(ROWS * self.inputs);
            return (rows.zip(y.par_chunks_mut(ROWS * self.outputs)))
                .for_each(|(x, y)| self.add_product(weights.params, x, y));
        };
        operands.set_left(x, self.inputs);
        operands.multiply(&alone(&packed.forward), y, self.outputs, |_| Accum::Add);
    }

    /// [`Dense::input_gradient`].
    pub fn par_input_gradient(
        &self,
        weights: Weights<PackedWeight>,
        operands: &mut Operands,
        accum: Accum,
        dy: &[f32],
        dx: &mut [f32],
    ) {
        let Some(packed) = weights.packed else {
            let rows = dx.par_chunks_mut(ROWS * self.inputs);
            return (rows.zip(dy.par_chunks(ROWS * self.outputs)))
                .for_each(|(dx, dy)| self.input_gradient(weights.params, accum, dy, dx));
        };
        operands.set_left(dy, self.outputs);
        operands.multiply(&alone(&packed.backward), dx, self.inputs, |_| accum);
    }

    /// [`Dense::backward_weight`], parallel over the outputs where it is in floats.
    pub fn par_backward_weight(
        &self,
        weights: Weights<PackedWeight>,
        operands: &mut Operands,
        gradient: &mut [f32],
        x: &[f32],
        dy: &[f32],
    ) {
        let gradient = &mut gradient[self.weight.clone()];
        if weights.packed.is_some() {
            let (x, dy) = ((x, self.inputs), (dy, self.outputs));
            return operands.add_weight_gradient([0], x, dy, gradient);
        }
        let rows = dy.len() / self.outputs;
        gradient
            .par_chunks_mut(OUTPUTS * self.inputs)
            .enumerate()
            .for_each(|(index, dw)| {
                let outputs = dw.len() / self.inputs;
                let dw = MatMut::from_row_major_slice_mut(dw, outputs, self.inputs);
                let x = MatRef::from_row_major_slice(x, rows, self.inputs);
                let dy = MatRef::from_row_major_slice(dy, rows, self.outputs)
                    .subcols(index * OUTPUTS, outputs);
                matmul(dw, Accum::Add, dy.transpose(), x, 1.0, Par::Seq);
            });
    }

    /// [`Dense::backward`].
    pub fn par_backward(
        &self,
        weights: Weights<PackedWeight>,
        operands: &mut Operands,
        gradient: &mut [f32],
        [x, dy]: [&[f32]; 2],
        sums: &mut Sums,
    ) {
        self.par_backward_weight(weights, operands, gradient, x, dy);
        let rows = Rows::points(dy.len() / self.outputs);
        sums.add_columns(dy, rows, &mut gradient[self.bias.clone()]);
    }
}

/// One weight that acts on the rows as they are.
fn alone(matrix: &Tiles) -> Taps<'_, 1> {
    Taps {
        starts: [0],
        adjacent: 1,
        matrices: [matrix],
    }
}
