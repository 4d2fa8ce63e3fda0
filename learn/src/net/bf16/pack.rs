//! Floats into tiles, and tiles from one arrangement into another.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::tile::{DEPTH, SIDE, Tile, Tiles, round};
use super::transpose::transpose;

/// A row-major matrix of floats whose rows are `stride` numbers apart.
#[derive(Clone, Copy, Debug)]
pub struct Floats<'a> {
    pub numbers: &'a [f32],
    pub columns: usize,
    pub stride: usize,
}

impl<'a> Floats<'a> {
    /// Rows that lie one behind the other.
    pub fn dense(numbers: &'a [f32], columns: usize) -> Self {
        Self {
            numbers,
            columns,
            stride: columns,
        }
    }

    /// The rows, without what lies between them.
    pub fn rows(&self) -> impl Iterator<Item = &'a [f32]> + use<'a> {
        let columns = self.columns;
        self.numbers.chunks(self.stride).map(move |row| &row[..columns])
    }
}

impl Tiles {
    /// Becomes the left matrix `floats`; the inner dimension is its columns.
    pub fn set_left(&mut self, floats: Floats) {
        self.resize(floats.numbers.len().div_ceil(floats.stride), floats.columns);
        for (index, row) in floats.rows().enumerate() {
            let lines = self.row_mut(index);
            Arch::new().dispatch(|| {
                for (line, part) in lines.zip(row.chunks(DEPTH)) {
                    line.iter_mut().zip(part).for_each(|(y, x)| *y = round(*x));
                    line[part.len()..].fill(0);
                }
            });
        }
    }

    /// Becomes the right matrix `floats`; the inner dimension is its rows.
    pub fn set_right(&mut self, floats: Floats) {
        self.resize(floats.columns, floats.numbers.len().div_ceil(floats.stride));
        for (block, tiles) in self.blocks_mut().enumerate() {
            let start = (block * SIDE).min(floats.columns);
            let columns = start..floats.columns.min(start + SIDE);
            Arch::new().dispatch(Pairs {
                tiles,
                floats,
                columns,
            });
        }
    }

    /// Turns the left matrix `B` into the right matrix `B^T`, and a right matrix `B` into the left matrix `B^T`.
    pub fn transpose(&mut self) {
        transpose(self.tiles_mut());
    }

    /// Becomes the left matrix `floats^T`; the inner dimension is the rows of `floats`.
    pub fn set_left_transposed(&mut self, floats: Floats) {
        self.set_right(floats);
        self.transpose();
    }

    /// Becomes the right matrix `floats^T`; the inner dimension is the columns of `floats`.
    pub fn set_right_transposed(&mut self, floats: Floats) {
        self.set_left(floats);
        self.transpose();
    }

    /// Becomes the right matrix of which `left` is the left one: of `rows` rows and `columns` columns, which `left` has as
    /// its inner dimension, and this as its outer one.
    pub fn set_right_from(&mut self, left: &Self, [rows, columns]: [usize; 2]) {
        self.resize(columns, rows);
        for (block, tiles) in self.blocks_mut().enumerate() {
            Arch::new().dispatch(PairsOfTiles {
                tiles,
                lefts: left.tiles(),
                first: block * SIDE / DEPTH,
                step: left.depth(),
                column: block * SIDE % DEPTH,
            });
        }
    }
}

/// One block of a right matrix: these columns of `floats`.
struct Pairs<'a> {
    tiles: &'a mut [Tile],
    floats: Floats<'a>,
    columns: Range<usize>,
}

impl WithSimd for Pairs<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let mut rows = self.floats.rows();
        let zeros = [0.0; SIDE];
        let width = self.columns.len();
        for tile in self.tiles {
            for pair in 0..SIDE {
                let mut next = || {
                    rows.next()
                        .map_or(&zeros[..width], |row| &row[self.columns.clone()])
                };
                let (even, odd) = (next(), next());
                let (line, _) = tile.line_mut(pair).as_chunks_mut::<2>();
                for ((pair, even), odd) in line.iter_mut().zip(even).zip(odd) {
                    *pair = [round(*even), round(*odd)];
                }
            }
        }
    }
}

/// One block of a right matrix, from every `step`-th left tile from the first on, at half a tile's columns from `column`.
struct PairsOfTiles<'a> {
    tiles: &'a mut [Tile],
    lefts: &'a [Tile],
    first: usize,
    step: usize,
    column: usize,
}

impl WithSimd for PairsOfTiles<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let mut lefts = self.lefts.iter().skip(self.first).step_by(self.step);
        for tile in self.tiles {
            // A right tile is as deep as two left tiles are high.
            for half in 0..DEPTH / SIDE {
                let Some(left) = lefts.next() else { return };
                for pair in 0..SIDE / 2 {
                    let line = |row: usize| &left.line(row)[self.column..self.column + SIDE];
                    let (even, odd) = (line(2 * pair), line(2 * pair + 1));
                    let (to, _) = tile.line_mut(half * SIDE / 2 + pair).as_chunks_mut::<2>();
                    for ((pair, even), odd) in to.iter_mut().zip(even).zip(odd) {
                        *pair = [*even, *odd];
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 50;
    const COLUMNS: usize = 37;

    /// Whole numbers, which bfloat16 holds exactly up to 256.
    fn numbers() -> Vec<f32> {
        (0..ROWS * COLUMNS).map(|k| (k * 31 % 256 + 1) as f32).collect()
    }

    /// Number `(outer, inner)` of a left matrix.
    fn left_at(tiles: &Tiles, outer: usize, inner: usize) -> f32 {
        let tile = &tiles.tiles()[outer / SIDE * tiles.depth() + inner / DEPTH];
        super::super::tile::widen(tile.line(outer % SIDE)[inner % DEPTH])
    }

    /// Number `(outer, inner)` of a right matrix.
    fn right_at(tiles: &Tiles, outer: usize, inner: usize) -> f32 {
        let tile = &tiles.tiles()[outer / SIDE * tiles.depth() + inner / DEPTH];
        super::super::tile::widen(tile.line(inner % DEPTH / 2)[outer % SIDE * 2 + inner % 2])
    }

    fn assert_holds(
        tiles: &Tiles,
        at: impl Fn(&Tiles, usize, usize) -> f32,
        [outer, inner]: [usize; 2],
        expected: impl Fn(usize, usize) -> f32,
    ) {
        for row in 0..outer.next_multiple_of(2 * SIDE) {
            for column in 0..inner.next_multiple_of(DEPTH) {
                let inside = row < outer && column < inner;
                let expected = if inside { expected(row, column) } else { 0.0 };
                assert_eq!(at(tiles, row, column), expected, "({row}, {column})");
            }
        }
    }

    #[test]
    fn tiles_hold_the_numbers_and_zeros_about_them() {
        let numbers = numbers();
        let floats = Floats::dense(&numbers, COLUMNS);
        let plain = |row: usize, column: usize| numbers[row * COLUMNS + column];
        let mirrored = |row: usize, column: usize| plain(column, row);
        let (mut left, mut tiles) = (Tiles::default(), Tiles::default());
        left.set_left(floats);
        assert_holds(&left, left_at, [ROWS, COLUMNS], plain);
        tiles.set_right(floats);
        assert_holds(&tiles, right_at, [COLUMNS, ROWS], mirrored);
        tiles.set_left_transposed(floats);
        assert_holds(&tiles, left_at, [COLUMNS, ROWS], mirrored);
        tiles.set_right_transposed(floats);
        assert_holds(&tiles, right_at, [ROWS, COLUMNS], plain);
        tiles.set_right_from(&left, [ROWS, COLUMNS]);
        assert_holds(&tiles, right_at, [COLUMNS, ROWS], mirrored);
    }

    #[test]
    fn a_matrix_may_be_a_part_of_a_wider_one() {
        let numbers = numbers();
        let part = Floats {
            numbers: &numbers,
            columns: 5,
            stride: COLUMNS,
        };
        let mut tiles = Tiles::default();
        tiles.set_left(part);
        assert_holds(&tiles, left_at, [ROWS, 5], |r, c| numbers[r * COLUMNS + c]);
        tiles.set_right(part);
        assert_holds(&tiles, right_at, [5, ROWS], |r, c| numbers[c * COLUMNS + r]);
    }
}
