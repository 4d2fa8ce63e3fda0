//! Dense layers over rows: products and their gradients.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use crate::net::kernels::float32::{fill_rows, sum_rows};
use crate::net::parameters::{Initial, Table};

/// A dense layer `y = W x + b`: where its weight, row-major `(outputs, inputs)`, and its bias lie in a flat slice.
///
/// Rows are points or clouds; `params` and `gradient` are flat slices laid out alike.
#[derive(Clone, Debug)]
pub struct Dense {
    pub inputs: usize,
    pub outputs: usize,
    pub weight: Range<usize>,
    pub bias: Range<usize>,
}

impl Dense {
    /// Adds the layer's tensors; they start as `initial`.
    pub fn declare(
        table: &mut Table,
        name: &str,
        inputs: usize,
        outputs: usize,
        initial: Initial,
    ) -> Self {
        Self {
            inputs,
            outputs,
            weight: table.push(format!("{name}.weight"), &[outputs, inputs], initial),
            bias: table.push(format!("{name}.bias"), &[outputs], initial.of_bias()),
        }
    }

    /// Adds the tensor of a layer without bias.
    pub fn declare_unbiased(
        table: &mut Table,
        name: &str,
        inputs: usize,
        outputs: usize,
        initial: Initial,
    ) -> Self {
        Self {
            inputs,
            outputs,
            weight: table.push(format!("{name}.weight"), &[outputs, inputs], initial),
            bias: 0..0,
        }
    }

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

    /// `dX = dY W`, or `dX += dY W`.
    pub fn input_gradient(&self, params: &[f32], accum: Accum, dy: &[f32], dx: &mut [f32]) {
        let rows = dy.len() / self.outputs;
        let dx = MatMut::from_row_major_slice_mut(dx, rows, self.inputs);
        let dy = MatRef::from_row_major_slice(dy, rows, self.outputs);
        matmul(dx, accum, dy, self.weight(params), 1.0, Par::Seq);
    }

    fn weight<'a>(&self, params: &'a [f32]) -> MatRef<'a, f32> {
        MatRef::from_row_major_slice(&params[self.weight.clone()], self.outputs, self.inputs)
    }
}
