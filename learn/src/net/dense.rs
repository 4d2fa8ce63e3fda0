//! Dense layers over rows: products and their gradients.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::kernels::{fill_rows, sum_rows};
use super::rows::{Rows, Sums};

/// Rows, and outputs, that a task of the parallel products takes.
const ROWS: usize = 256;
const OUTPUTS: usize = 32;

/// A dense layer `y = W x + b`: where its weight, row-major `(outputs, inputs)`, and its bias lie in a flat slice.
///
/// Rows are points or clouds; `params` and `gradient` are flat slices laid out alike.
#[derive(Clone, Debug)]
pub(super) struct Dense {
    pub inputs: usize,
    pub outputs: usize,
    pub weight: Range<usize>,
    pub bias: Range<usize>,
}

impl Dense {
    /// Floating-point operations of the product with `rows` rows.
    pub fn flops(&self, rows: usize) -> u64 {
        2 * (rows * self.inputs * self.outputs) as u64
    }

    /// `Y = X W^T + b`, with `X` `(rows, inputs)` and `Y` `(rows, outputs)`.
    pub fn forward(&self, params: &[f32], x: &[f32], y: &mut [f32]) {
        fill_rows(y, &params[self.bias.clone()]);
        self.add_product(params, x, y);
    }

    /// `Y += X W^T`.
    pub fn add_product(&self, params: &[f32], x: &[f32], y: &mut [f32]) {
        let rows = x.len() / self.inputs;
        let y = MatMut::from_row_major_slice_mut(y, rows, self.outputs);
        let x = MatRef::from_row_major_slice(x, rows, self.inputs);
        matmul(
            y,
            Accum::Add,
            x,
            self.weight(params).transpose(),
            1.0,
            Par::Seq,
        );
    }

    /// `dX = dY W`.
    pub fn backward_input(&self, params: &[f32], dy: &[f32], dx: &mut [f32]) {
        self.input_gradient(params, Accum::Replace, dy, dx);
    }

    /// `dW += dY^T X`, `db += sum over rows of dY`.
    pub fn backward(&self, gradient: &mut [f32], x: &[f32], dy: &[f32]) {
        self.backward_weight(gradient, x, dy);
        sum_rows(dy, &mut gradient[self.bias.clone()]);
    }

    /// `dW += dY^T X`.
    pub fn backward_weight(&self, gradient: &mut [f32], x: &[f32], dy: &[f32]) {
        let rows = dy.len() / self.outputs;
        let dw = &mut gradient[self.weight.clone()];
        let dw = MatMut::from_row_major_slice_mut(dw, self.outputs, self.inputs);
        let x = MatRef::from_row_major_slice(x, rows, self.inputs);
        let dy = MatRef::from_row_major_slice(dy, rows, self.outputs);
        matmul(dw, Accum::Add, dy.transpose(), x, 1.0, Par::Seq);
    }

    /// [`Dense::forward`] of many rows, in parallel.
    pub fn par_forward(&self, params: &[f32], x: &[f32], y: &mut [f32]) {
        x.par_chunks(ROWS * self.inputs)
            .zip(y.par_chunks_mut(ROWS * self.outputs))
            .for_each(|(x, y)| self.forward(params, x, y));
    }

    /// [`Dense::add_product`] of many rows, in parallel.
    pub fn par_add_product(&self, params: &[f32], x: &[f32], y: &mut [f32]) {
        x.par_chunks(ROWS * self.inputs)
            .zip(y.par_chunks_mut(ROWS * self.outputs))
            .for_each(|(x, y)| self.add_product(params, x, y));
    }

    /// [`Dense::backward_input`] of many rows, in parallel.
    pub fn par_backward_input(&self, params: &[f32], dy: &[f32], dx: &mut [f32]) {
        self.par_input_gradient(params, Accum::Replace, dy, dx);
    }

    /// `dX += dY W` of many rows, in parallel.
    pub fn par_add_backward_input(&self, params: &[f32], dy: &[f32], dx: &mut [f32]) {
        self.par_input_gradient(params, Accum::Add, dy, dx);
    }

    fn par_input_gradient(&self, params: &[f32], accum: Accum, dy: &[f32], dx: &mut [f32]) {
        dx.par_chunks_mut(ROWS * self.inputs)
            .zip(dy.par_chunks(ROWS * self.outputs))
            .for_each(|(dx, dy)| self.input_gradient(params, accum, dy, dx));
    }

    fn input_gradient(&self, params: &[f32], accum: Accum, dy: &[f32], dx: &mut [f32]) {
        let rows = dy.len() / self.outputs;
        let dx = MatMut::from_row_major_slice_mut(dx, rows, self.inputs);
        let dy = MatRef::from_row_major_slice(dy, rows, self.outputs);
        matmul(dx, accum, dy, self.weight(params), 1.0, Par::Seq);
    }

    /// [`Dense::backward_weight`] of many rows, parallel over the outputs.
    pub fn par_backward_weight(&self, gradient: &mut [f32], x: &[f32], dy: &[f32]) {
        let rows = dy.len() / self.outputs;
        gradient[self.weight.clone()]
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

    /// [`Dense::backward`] of many rows, in parallel.
    pub fn par_backward(&self, gradient: &mut [f32], x: &[f32], dy: &[f32], sums: &mut Sums) {
        self.par_backward_weight(gradient, x, dy);
        let rows = Rows::points(dy.len() / self.outputs);
        sums.add_columns(dy, rows, &mut gradient[self.bias.clone()]);
    }

    fn weight<'a>(&self, params: &'a [f32]) -> MatRef<'a, f32> {
        MatRef::from_row_major_slice(&params[self.weight.clone()], self.outputs, self.inputs)
    }
}
