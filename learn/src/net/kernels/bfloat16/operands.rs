//! Products over the rows of large matrices, in parallel.

use faer::Accum;
use rayon::prelude::*;

use super::pack::Floats;
use super::product::{Output, multiply_terms};
use super::rows::{Paired, Rows};
use super::tile::Tiles;
use super::unit::Term;
use crate::net::kernels::float32::add;

/// Rows per task of a product.
const TASK: usize = 128;

/// Rows per product of the gradient by a weight, which is read and written once for each.
const CHUNK: usize = 1024;

/// Parts of the rows whose gradients by a weight are summed apart, and then added in order.
const PARTS: usize = 2;

/// Parts of the weights whose gradients are summed apart.
const GROUPS: usize = 9;

/// Weights that act on the rows of a matrix at fixed offsets from the output's row; their products are summed.
pub struct Taps<'a, const N: usize> {
    /// The row that each acts on for the output's first row.
    pub starts: [usize; N],
    /// Adjacent rows that each acts on at once.
    pub adjacent: usize,
    /// Right matrices.
    pub matrices: [&'a Tiles; N],
}

/// An operand, and workspace for the gradient by a weight; kept from call to call.
#[derive(Debug, Default)]
pub struct Operands {
    rows: Rows,
    paired: Paired,
    /// The gradient by the output, transposed, a left matrix per chunk of rows.
    transposed: Vec<Tiles>,
    partials: Vec<f32>,
}

impl Operands {
    /// Rounds the matrix `x`, of `columns` columns, as the left operand of the next products.
    pub fn set_left(&mut self, x: &[f32], columns: usize) {
        self.rows.set(x, columns);
    }

    /// `Y += X W`, or `Y = X W`, with the matrix `X` of [`Operands::set_left`]. `prepare` may write to a part of `y` first, and
    /// says which.
    pub fn multiply<const N: usize>(
        &self,
        taps: &Taps<N>,
        y: &mut [f32],
        columns: usize,
        prepare: impl Fn(&mut [f32]) -> Accum + Sync,
    ) {
        let tasks = y.par_chunks_mut(TASK * columns).enumerate();
        tasks.for_each(|(task, y)| {
            let accum = prepare(y);
            let terms: [Term; N] = std::array::from_fn(|k| {
                let (first, count) = (task * TASK + taps.starts[k], y.len() / columns);
                Term {
                    left: self.rows.panel(first, count, taps.adjacent),
                    right: taps.matrices[k].whole(),
                }
            });
            multiply_terms(Output::dense(y, columns), accum, &terms);
        });
    }

    /// Adds `dY^T X(start..)` for each start, one behind the other, to `gradient`: the matrix `x` has `inputs` columns, `dy`
    /// has `outputs`. `N` is one or a multiple of nine.
    pub fn add_weight_gradient<const N: usize>(
        &mut self,
        starts: [usize; N],
        (x, inputs): (&[f32], usize),
        (dy, outputs): (&[f32], usize),
        gradient: &mut [f32],
    ) {
        // X as right operand, dY^T as left ones, a chunk of rows each.
        self.paired.set(x, inputs);
        let (chunks, size) = (dy.par_chunks(CHUNK * outputs), inputs * outputs);
        let count = chunks.len();
        if self.transposed.len() < count {
            self.transposed.resize_with(count, Tiles::default);
        }
        let transposed = &mut self.transposed[..count];
        (transposed.par_iter_mut().zip(chunks))
            .for_each(|(tiles, dy)| tiles.set_left_transposed(Floats::dense(dy, outputs)));

        // Sums over the chunks of each part of the rows, for groups of starts.
        self.partials.resize(PARTS * N * size, 0.0);
        let group = N.div_ceil(GROUPS);
        let groups = N / group;
        let per_part = count.div_ceil(PARTS);
        let tasks = self.partials.par_chunks_mut(group * size).enumerate();
        tasks.for_each(|(task, partial)| {
            partial.fill(0.0);
            let starts = &starts[task % groups * group..][..group];
            let chunks = transposed.iter().enumerate();
            for (chunk, dy_transposed) in chunks.skip(task / groups * per_part).take(per_part) {
                let first = chunk * CHUNK;
                let rows = CHUNK.min(dy.len() / outputs - first);
                for (dw, start) in partial.chunks_exact_mut(size).zip(starts) {
                    let term = Term {
                        left: dy_transposed.whole(),
                        right: self.paired.panel(first + start, rows),
                    };
                    multiply_terms(Output::dense(dw, inputs), Accum::Add, &[term]);
                }
            }
        });
        // The parts, added in order.
        let gradients = gradient.par_chunks_mut(size).enumerate();
        gradients.for_each(|(index, gradient)| {
            for part in self.partials.chunks_exact(N * size) {
                add(&part[index * size..][..size], gradient);
            }
        });
    }
}
