//! Floats into tiles, and tiles from one layout into another.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::shuffle::{Turn, transpose, turn};
use super::tile::{DEPTH, SIDE, Tile, Tiles, round};

/// A row-major matrix of floats with a stride.
#[derive(Clone, Copy, Debug)]
pub struct Floats<'a> {
    pub numbers: &'a [f32],
    pub columns: usize,
    pub stride: usize,
}

impl<'a> Floats<'a> {
    /// A matrix whose rows are adjacent.
    pub fn dense(numbers: &'a [f32], columns: usize) -> Self {
        Self {
            numbers,
            columns,
            stride: columns,
        }
    }

    /// The rows, without the padding between them.
    pub fn rows(&self) -> impl Iterator<Item = &'a [f32]> + use<'a> {
        let columns = self.columns;
        self.numbers
            .chunks(self.stride)
            .map(move |row| &row[..columns])
    }
}

impl Tiles {
    /// Packs `floats` as a left matrix; the inner dimension is its columns.
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

    /// Packs `floats` as a right matrix; the inner dimension is its rows.
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

    /// Transposes in place: a left matrix `B` becomes the right matrix `B^T`, a right matrix `B` the left matrix `B^T`.
    pub fn transpose(&mut self) {
        transpose(self.tiles_mut());
    }

    /// Packs `floats^T` as a left matrix; the inner dimension is the rows of `floats`.
    pub fn set_left_transposed(&mut self, floats: Floats) {
        self.set_right(floats);
        self.transpose();
    }

    /// Packs `floats^T` as a right matrix; the inner dimension is the columns of `floats`.
    pub fn set_right_transposed(&mut self, floats: Floats) {
        self.set_left(floats);
        self.transpose();
    }

    /// Repacks the left matrix `left`, of `rows` rows and `columns` columns, as a right matrix. Its columns are the inner
    /// dimension of `left`, and the outer one here.
    pub fn set_right_from(&mut self, left: &Self, shape: [usize; 2]) {
        self.set_turned(Turn::Right, left, shape);
    }

    /// Repacks the transpose of the left matrix `left`, of `rows` rows and `columns` columns, as a left matrix.
    pub fn set_left_transposed_from(&mut self, left: &Self, shape: [usize; 2]) {
        self.set_turned(Turn::LeftTransposed, left, shape);
    }

    fn set_turned(&mut self, way: Turn, left: &Self, [rows, columns]: [usize; 2]) {
        self.resize(columns, rows);
        let depth = self.depth();
        let bands = left.tiles().chunks_exact(2 * left.depth());
        for (band, lefts) in bands.enumerate() {
            let (upper, lower) = lefts.split_at(left.depth());
            for (column, (upper, lower)) in upper.iter().zip(lower).enumerate() {
                let first = 2 * column * depth + band;
                let to = self.tiles_mut().get_disjoint_mut([first, first + depth]);
                turn(way, [upper, lower], to.expect("tiles of two blocks"));
            }
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

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: usize = 50;
    const COLUMNS: usize = 37;

    /// Whole numbers, which bfloat16 holds exactly up to 256.
    fn numbers() -> Vec<f32> {
        (0..ROWS * COLUMNS)
            .map(|k| (k * 31 % 256 + 1) as f32)
            .collect()
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
        tiles.set_left_transposed_from(&left, [ROWS, COLUMNS]);
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
