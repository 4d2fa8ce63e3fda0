//! Products of tiled matrices.

use std::ops::Range;

use faer::Accum;
use pulp::{Arch, Simd, WithSimd};

#[cfg(target_arch = "x86_64")]
use super::amx;
use super::tile::{DEPTH, SIDE, STEP, Tile, Tiles, widen};

/// Two tiles by two, along the inner dimension.
pub struct Block<'a> {
    pub left: [&'a [Tile]; 2],
    pub right: [&'a [Tile]; 2],
}

/// The product, `(rows, columns)` floats of row-major memory whose rows are `stride` numbers apart.
pub struct Output<'a> {
    pub numbers: &'a mut [f32],
    pub stride: usize,
    pub rows: usize,
    pub columns: usize,
}

impl<'a> Output<'a> {
    /// Rows that lie one behind the other.
    pub fn dense(numbers: &'a mut [f32], columns: usize) -> Self {
        Self {
            stride: columns,
            rows: numbers.len() / columns,
            columns,
            numbers,
        }
    }
}

/// Tiles along the inner dimension that are multiplied with all others before the next ones: a pair of blocks of them,
/// left or right, takes a third of a first cache.
const CACHED: usize = 16;

/// What runs the products.
trait Unit {
    /// Puts the product of `block` into the 32 x 32 floats of `c`, whose rows are `stride` numbers apart, or adds it.
    fn multiply(&self, block: &Block, accum: Accum, c: &mut [f32], stride: usize);
}

#[cfg(target_arch = "x86_64")]
impl Unit for amx::Unit {
    fn multiply(&self, block: &Block, accum: Accum, c: &mut [f32], stride: usize) {
        self.multiply_tiles(block, accum, c, stride);
    }
}

/// Whether a matrix unit runs the products, and not vectors of floats.
pub fn has_matrix_unit() -> bool {
    #[cfg(target_arch = "x86_64")]
    return amx::is_available();
    #[cfg(not(target_arch = "x86_64"))]
    return false;
}

/// `C = A B`, or `C += A B`, with a `left` and a `right` matrix, in floats.
///
/// # Panics
/// Where the operands do not fit each other or the output.
pub fn multiply(output: Output, accum: Accum, left: &Tiles, right: &Tiles) {
    #[cfg(target_arch = "x86_64")]
    if amx::is_available() {
        return run(&amx::Unit::new(), output, accum, left, right);
    }
    run(&Vectors, output, accum, left, right);
}

fn run(unit: &impl Unit, output: Output, accum: Accum, left: &Tiles, right: &Tiles) {
    let Output {
        numbers,
        stride,
        rows,
        columns,
    } = output;
    assert_eq!(left.depth(), right.depth(), "one inner dimension");
    let depth = left.depth();
    assert!(
        left.tiles().len() >= rows.div_ceil(STEP) * 2 * depth,
        "as many rows as the output"
    );
    assert!(
        right.tiles().len() >= columns.div_ceil(STEP) * 2 * depth,
        "as many columns as the output"
    );
    for start in (0..depth).step_by(CACHED) {
        let part = start..depth.min(start + CACHED);
        let accum = if start == 0 { accum } else { Accum::Add };
        for column in (0..columns).step_by(STEP) {
            for row in (0..rows).step_by(STEP) {
                let block = Block {
                    left: pair(left, row, &part),
                    right: pair(right, column, &part),
                };
                let (height, width) = (STEP.min(rows - row), STEP.min(columns - column));
                let c = &mut numbers[row * stride + column..];
                if (height, width) == (STEP, STEP) {
                    unit.multiply(&block, accum, c, stride);
                } else {
                    add_edge(unit, &block, accum, c, stride, [height, width]);
                }
            }
        }
    }
}

/// The tiles `part` of the two blocks from row, or column, `first` on.
fn pair<'a>(tiles: &'a Tiles, first: usize, part: &Range<usize>) -> [&'a [Tile]; 2] {
    let depth = tiles.depth();
    let (a, b) = tiles.tiles()[first / SIDE * depth..][..2 * depth].split_at(depth);
    [&a[part.clone()], &b[part.clone()]]
}

/// A block of which only `height` rows and `width` columns are in the output.
fn add_edge(
    unit: &impl Unit,
    block: &Block,
    accum: Accum,
    c: &mut [f32],
    stride: usize,
    [height, width]: [usize; 2],
) {
    let mut whole = [0.0; STEP * STEP];
    unit.multiply(block, Accum::Replace, &mut whole, STEP);
    let lines = c
        .chunks_mut(stride)
        .take(height)
        .map(|line| &mut line[..width]);
    for (line, product) in lines.zip(whole.chunks_exact(STEP)) {
        match accum {
            Accum::Replace => line.copy_from_slice(&product[..width]),
            Accum::Add => line.iter_mut().zip(product).for_each(|(c, p)| *c += p),
        }
    }
}

/// The processor's vectors of floats.
struct Vectors;

impl Unit for Vectors {
    fn multiply(&self, block: &Block, accum: Accum, c: &mut [f32], stride: usize) {
        for (half, left) in block.left.iter().enumerate() {
            for (side, right) in block.right.iter().enumerate() {
                let c = &mut c[half * SIDE * stride + side * SIDE..];
                if let Accum::Replace = accum {
                    c.chunks_mut(stride)
                        .take(SIDE)
                        .for_each(|line| line[..SIDE].fill(0.0));
                }
                Arch::new().dispatch(MultiplyAdd {
                    left,
                    right,
                    c,
                    stride,
                });
            }
        }
    }
}

/// One tile of the product.
struct MultiplyAdd<'a> {
    left: &'a [Tile],
    right: &'a [Tile],
    c: &'a mut [f32],
    stride: usize,
}

impl WithSimd for MultiplyAdd<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let mut sums = [[0.0f32; SIDE]; SIDE];
        for (left, right) in self.left.iter().zip(self.right) {
            for pair in 0..SIDE {
                let line = right.line(pair);
                let (mut even, mut odd) = ([0.0; SIDE], [0.0; SIDE]);
                for k in 0..SIDE {
                    (even[k], odd[k]) = (widen(line[2 * k]), widen(line[2 * k + 1]));
                }
                for (row, sums) in sums.iter_mut().enumerate() {
                    let numbers: &[u16; DEPTH] = left.line(row);
                    let (first, second) = (widen(numbers[2 * pair]), widen(numbers[2 * pair + 1]));
                    for k in 0..SIDE {
                        sums[k] = second.mul_add(odd[k], first.mul_add(even[k], sums[k]));
                    }
                }
            }
        }
        for (line, sums) in self.c.chunks_mut(self.stride).zip(&sums) {
            line[..SIDE]
                .iter_mut()
                .zip(sums)
                .for_each(|(c, sum)| *c += sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::check::{numbers, single};
    use super::super::pack::Floats;
    use super::*;

    const SIZES: [[usize; 3]; 4] = [[1, 1, 1], [32, 32, 32], [40, 70, 33], [97, 16, 100]];

    /// The definition, of numbers that bfloat16 holds exactly.
    fn exact(a: &[f32], b: &[f32], [rows, columns, inner]: [usize; 3]) -> Vec<f32> {
        let dot = |i: usize, j: usize| {
            (0..inner)
                .map(|k| a[i * inner + k] * b[k * columns + j])
                .sum()
        };
        (0..rows * columns)
            .map(|at| dot(at / columns, at % columns))
            .collect()
    }

    fn rounded(seed: u64, len: usize) -> Vec<f32> {
        let numbers = single(&numbers(seed, len));
        numbers
            .into_iter()
            .map(|x| (x * 16.0).round() / 16.0)
            .collect()
    }

    fn assert_multiplies(unit: &impl Unit) {
        for sizes in SIZES {
            let [rows, columns, inner] = sizes;
            let (a, b) = (rounded(1, rows * inner), rounded(2, inner * columns));
            let (mut lefts, mut rights) = (Tiles::default(), Tiles::default());
            lefts.set_left(Floats::dense(&a, inner));
            rights.set_right(Floats::dense(&b, columns));
            let expected = exact(&a, &b, sizes);
            let mut c = vec![1.0; rows * columns];
            run(
                unit,
                Output::dense(&mut c, columns),
                Accum::Replace,
                &lefts,
                &rights,
            );
            assert_eq!(c, expected, "{sizes:?}");
            run(
                unit,
                Output::dense(&mut c, columns),
                Accum::Add,
                &lefts,
                &rights,
            );
            let twice: Vec<f32> = expected.iter().map(|x| 2.0 * x).collect();
            assert_eq!(c, twice, "{sizes:?}, added");
        }
    }

    #[test]
    fn vectors_multiply_as_defined() {
        assert_multiplies(&Vectors);
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn the_matrix_unit_multiplies_as_defined_where_there_is_one() {
        if amx::is_available() {
            assert_multiplies(&amx::Unit::new());
        }
    }

    #[test]
    fn a_stride_leaves_the_numbers_between_rows_alone() {
        let (mut lefts, mut rights) = (Tiles::default(), Tiles::default());
        lefts.set_left(Floats::dense(&[1.0; 33 * 3], 3));
        rights.set_right(Floats::dense(&[1.0; 3 * 34], 34));
        let mut c = vec![7.0; 33 * 36];
        let output = Output {
            numbers: &mut c,
            stride: 36,
            rows: 33,
            columns: 34,
        };
        multiply(output, Accum::Replace, &lefts, &rights);
        for line in c.chunks_exact(36) {
            assert!(line[..34].iter().all(|x| *x == 3.0) && line[34..] == [7.0, 7.0]);
        }
    }
}
