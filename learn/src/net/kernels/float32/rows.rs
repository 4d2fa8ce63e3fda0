//! Which rows of a matrix are real, and how work on them is divided.

use std::ops::Range;

use pulp::Arch;
use rayon::prelude::*;

use super::loops::sum_rows;

/// Rows per block where rows are points.
const POINTS: usize = 256;

/// A row-major matrix in blocks of rows, the unit of parallel work. A block holds lines of real rows with padding
/// between them: for points one line without padding, for a grid of voxels a plane's lines.
///
/// Blocks do not depend on the number of threads, so neither do sums over them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rows {
    /// Rows per block; the last block of points may have fewer.
    pub block: usize,
    /// Lines per block.
    pub lines: usize,
    /// Real rows per line.
    pub line: usize,
    /// Rows from one line's start to the next's.
    pub step: usize,
    /// Real rows in all.
    pub count: usize,
}

impl Rows {
    /// `count` points.
    pub fn points(count: usize) -> Self {
        Self {
            block: POINTS,
            lines: 1,
            line: POINTS,
            step: POINTS,
            count,
        }
    }

    /// The lines in a block of `len` numbers, `columns` a row, as ranges of numbers.
    pub fn lines(self, len: usize, columns: usize) -> impl Iterator<Item = Range<usize>> {
        (0..self.lines).map(move |line| {
            let start = line * self.step * columns;
            start..(start + self.line * columns).min(len)
        })
    }
}

/// Sums over rows, and their parts, kept from call to call.
#[derive(Clone, Debug, Default)]
pub struct Sums {
    partials: Vec<f32>,
    /// One sum per column.
    pub total: Vec<f64>,
}

impl Sums {
    /// Sums what `add(block, partial)` adds for every block, by index, to its zeroed partial sums of length `width`.
    pub fn over_blocks(
        &mut self,
        blocks: usize,
        width: usize,
        add: impl Fn(usize, &mut [f32]) + Sync,
    ) -> &[f64] {
        self.partials.clear();
        self.partials.resize(blocks * width, 0.0);
        self.partials
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(block, partial)| add(block, partial));
        self.add_up(width)
    }

    /// As [`Sums::over_blocks`], where the sums come with a change of `matrix`, a block at a time.
    pub fn while_changing(
        &mut self,
        matrix: &mut [f32],
        block: usize,
        width: usize,
        change: impl Fn(usize, &mut [f32], &mut [f32]) + Sync,
    ) -> &[f64] {
        self.partials.clear();
        self.partials
            .resize(matrix.len().div_ceil(block) * width, 0.0);
        self.partials
            .par_chunks_mut(width)
            .zip(matrix.par_chunks_mut(block))
            .enumerate()
            .for_each(|(index, (partial, block))| change(index, block, partial));
        self.add_up(width)
    }

    /// Sum of every column of `matrix`, whose padding is zero.
    pub fn columns(&mut self, matrix: &[f32], rows: Rows, columns: usize) -> &[f64] {
        let len = rows.block * columns;
        self.over_blocks(matrix.len().div_ceil(len), columns, |block, partial| {
            sum_rows(
                &matrix[block * len..matrix.len().min((block + 1) * len)],
                partial,
            );
        })
    }

    /// Adds the sum of every column of `matrix`, whose padding is zero, to `total`.
    pub fn add_columns(&mut self, matrix: &[f32], rows: Rows, total: &mut [f32]) {
        let sums = self.columns(matrix, rows, total.len());
        total
            .iter_mut()
            .zip(sums)
            .for_each(|(t, s)| *t += *s as f32);
    }

    fn add_up(&mut self, width: usize) -> &[f64] {
        self.total.clear();
        self.total.resize(width, 0.0);
        let total = &mut self.total[..];
        Arch::new().dispatch(|| {
            for partial in self.partials.chunks_exact(width) {
                total
                    .iter_mut()
                    .zip(partial)
                    .for_each(|(t, p)| *t += f64::from(*p));
            }
        });
        &self.total
    }
}
