//! Row-major bfloat16 matrices that are operands from any row on, without repacking.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::panel::{Panel, Strides};
use super::tile::{DEPTH, SIDE, round};

/// Rows of zeros after the last: products take rows by tiles.
const BEHIND: usize = 4 * SIDE;

/// Rows, or pairs of them, that a task takes.
const TASK: usize = 128;

/// Stride of a row of `columns` numbers, padded with zeros: rows start at multiples of half a cache line.
pub fn padded(columns: usize) -> usize {
    columns.next_multiple_of(SIDE)
}

/// A buffer that starts at a cache line.
#[derive(Debug, Default)]
struct Aligned {
    numbers: Vec<u16>,
    start: usize,
}

impl Aligned {
    const LINE: usize = 64;

    /// `len` zeros.
    fn reset(&mut self, len: usize) {
        self.numbers.clear();
        self.numbers.resize(len + Self::LINE / size_of::<u16>(), 0);
        self.start = self.numbers.as_ptr().align_offset(Self::LINE);
    }

    fn numbers(&self) -> &[u16] {
        &self.numbers[self.start..]
    }

    fn numbers_mut(&mut self) -> &mut [u16] {
        &mut self.numbers[self.start..]
    }
}

/// A row-major matrix, its rows padded with zeros: a left matrix from any row on.
#[derive(Debug, Default)]
pub struct Rows {
    numbers: Aligned,
    columns: usize,
    rows: usize,
}

impl Rows {
    /// Rounds `floats`, of `columns` columns, in parallel.
    pub fn set(&mut self, floats: &[f32], columns: usize) {
        let (stride, rows) = (padded(columns), floats.len() / columns);
        if [self.columns, self.rows] != [columns, rows] {
            [self.columns, self.rows] = [columns, rows];
            self.numbers.reset((rows + BEHIND) * stride);
        }
        let numbers = &mut self.numbers.numbers_mut()[..rows * stride];
        let tasks = numbers
            .par_chunks_mut(TASK * stride)
            .zip(floats.par_chunks(TASK * columns));
        tasks.for_each(|(numbers, floats)| {
            Arch::new().dispatch(|| {
                let rows = numbers
                    .chunks_exact_mut(stride)
                    .zip(floats.chunks_exact(columns));
                for (row, floats) in rows {
                    row.iter_mut().zip(floats).for_each(|(y, x)| *y = round(*x));
                }
            });
        });
    }

    /// The left matrix of `count` rows from row `first` on, each with the numbers of `following` rows from there on as its
    /// inner dimension.
    pub fn panel(&self, first: usize, count: usize, following: usize) -> Panel<'_> {
        let stride = padded(self.columns);
        let strides = Strides {
            line: stride,
            inner: DEPTH,
            outer: SIDE * stride,
        };
        let size = [count.div_ceil(SIDE), (following * stride).div_ceil(DEPTH)];
        Panel::of_rows(self.numbers.numbers(), first * stride, strides, size)
    }
}

/// Pairs of adjacent rows, number by number: a right matrix from any row on, whose inner dimension is the rows.
///
/// Both ways to pair them are there, with an even and with an odd row as the first of each pair.
#[derive(Debug, Default)]
pub struct Paired {
    numbers: [Aligned; 2],
    columns: usize,
    rows: usize,
}

impl Paired {
    /// Rounds and pairs the rows of `floats`, of `columns` columns, in parallel.
    pub fn set(&mut self, floats: &[f32], columns: usize) {
        let (stride, rows) = (padded(columns), floats.len() / columns);
        if [self.columns, self.rows] != [columns, rows] {
            [self.columns, self.rows] = [columns, rows];
            let all = (rows + BEHIND) * stride;
            self.numbers
                .iter_mut()
                .for_each(|numbers| numbers.reset(all));
        }
        for (odd, numbers) in self.numbers.iter_mut().enumerate() {
            let floats = &floats[(odd * columns).min(floats.len())..];
            let tasks = numbers.numbers_mut().par_chunks_mut(TASK * 2 * stride);
            let tasks = tasks.zip(floats.par_chunks(TASK * 2 * columns));
            tasks.for_each(|(numbers, floats)| {
                Arch::new().dispatch(Pairs {
                    numbers,
                    floats,
                    columns,
                });
            });
        }
    }

    /// The right matrix of `count` rows, and up to 31 further ones, from row `first` on.
    pub fn panel(&self, first: usize, count: usize) -> Panel<'_> {
        let stride = padded(self.columns);
        let strides = Strides {
            line: 2 * stride,
            inner: DEPTH * stride,
            outer: DEPTH,
        };
        let size = [stride / SIDE, count.div_ceil(DEPTH)];
        let (pair, odd) = (first / 2, first % 2);
        Panel::of_rows(
            self.numbers[odd].numbers(),
            pair * 2 * stride,
            strides,
            size,
        )
    }
}

/// Pairs of rows; the last may be without its second row.
struct Pairs<'a> {
    numbers: &'a mut [u16],
    floats: &'a [f32],
    columns: usize,
}

impl WithSimd for Pairs<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let (columns, stride) = (self.columns, padded(self.columns));
        let lines = self.numbers.chunks_exact_mut(2 * stride);
        for (line, rows) in lines.zip(self.floats.chunks(2 * columns)) {
            let (first, second) = rows.split_at(columns);
            let (pairs, _) = line.as_chunks_mut::<2>();
            if second.is_empty() {
                pairs
                    .iter_mut()
                    .zip(first)
                    .for_each(|(pair, x)| *pair = [round(*x), 0]);
            }
            for ((pair, first), second) in pairs.iter_mut().zip(first).zip(second) {
                *pair = [round(*first), round(*second)];
            }
        }
    }
}
