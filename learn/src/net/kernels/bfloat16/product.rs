//! Products of tiled matrices.
//!
//! The right operand stays in the first cache, the left one streams by it, and the output's next rows are fetched meanwhile.
//! Rows that products read and write again are padded, as rows at a power of two of bytes share a few cache lines.

use faer::Accum;

#[cfg(target_arch = "x86_64")]
use super::amx::{self, Amx};
#[cfg(target_arch = "x86_64")]
use super::avx512::{self, Avx512};
use super::floats::Vectors;
use super::tile::{SIDE, Tiles};
use super::unit::{Four, Order, Shape, Term, Unit};

/// Numbers in four tiles.
const FOUR: usize = 4 * SIDE * SIDE;

/// The product: a row-major matrix `(rows, columns)` of floats with a stride.
pub struct Output<'a> {
    pub numbers: &'a mut [f32],
    pub stride: usize,
    pub rows: usize,
    pub columns: usize,
}

impl<'a> Output<'a> {
    /// A matrix whose rows are adjacent.
    pub fn dense(numbers: &'a mut [f32], columns: usize) -> Self {
        Self {
            stride: columns,
            rows: numbers.len() / columns,
            columns,
            numbers,
        }
    }
}

/// Tiles along the inner dimension per pass over the output: a pair of blocks of so many takes two thirds of a first cache.
const CACHED: usize = 16;

/// The fastest that this processor has.
enum Fastest {
    #[cfg(target_arch = "x86_64")]
    Amx(Amx),
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512),
    Vectors(Vectors),
}

impl Fastest {
    /// Ready for products on this thread.
    fn new() -> Self {
        #[cfg(target_arch = "x86_64")]
        if amx::is_available() {
            return Self::Amx(Amx::new());
        } else if let Some(unit) = Avx512::try_new() {
            return Self::Avx512(unit);
        }
        Self::Vectors(Vectors)
    }
}

impl Unit for Fastest {
    fn multiply(&self, terms: &[Term], four: Four, accum: Accum, c: &mut [f32], stride: usize) {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Amx(unit) => unit.multiply(terms, four, accum, c, stride),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(unit) => unit.multiply(terms, four, accum, c, stride),
            Self::Vectors(unit) => unit.multiply(terms, four, accum, c, stride),
        }
    }
}

/// Whether a matrix unit runs the products.
pub fn has_matrix_unit() -> bool {
    #[cfg(target_arch = "x86_64")]
    return amx::is_available();
    #[cfg(not(target_arch = "x86_64"))]
    return false;
}

/// Whether this processor multiplies bfloat16 numbers faster than floats: on a matrix unit, or on AMD's vectors of pairs, which
/// do as many instructions in a cycle as those of floats. Intel's do a quarter as many: half the products.
pub fn is_faster() -> bool {
    #[cfg(target_arch = "x86_64")]
    return has_matrix_unit() || (Avx512::try_new().is_some() && avx512::is_amd());
    #[cfg(not(target_arch = "x86_64"))]
    return false;
}

/// `C = A B`, or `C += A B`, with a `left` and a `right` matrix, in floats.
///
/// # Panics
/// Where the operands do not fit each other or the output.
pub fn multiply(mut output: Output, accum: Accum, left: &Tiles, right: &Tiles) {
    run_cached(&Fastest::new(), &mut output, accum, left, right);
}

/// `C = sum of A B` over all terms, or `C += ...`: all of it stays in registers.
///
/// # Panics
/// Where the operands do not fit each other.
pub fn multiply_terms(mut output: Output, accum: Accum, terms: &[Term]) {
    run(&Fastest::new(), &mut output, accum, terms, Order::AlongRows);
}

fn run_cached(unit: &impl Unit, output: &mut Output, accum: Accum, left: &Tiles, right: &Tiles) {
    assert_eq!(left.depth(), right.depth(), "one inner dimension");
    let depth = left.depth();
    for start in (0..depth).step_by(CACHED) {
        let accum = if start == 0 { accum } else { Accum::Add };
        let part = start..depth.min(start + CACHED);
        let term = Term {
            left: left.panel(part.clone()),
            right: right.panel(part),
        };
        run(unit, output, accum, &[term], Order::AlongColumns);
    }
}

/// Rows of tiles that are multiplied with all columns before the next ones.
const GROUP: usize = 4;

fn run(unit: &impl Unit, output: &mut Output, accum: Accum, terms: &[Term], order: Order) {
    let [rows, columns] = [output.rows, output.columns].map(|len| len.div_ceil(SIDE));
    for Term { left, right } in terms {
        assert!(left.blocks() >= rows, "as many rows as the output");
        assert!(right.blocks() >= columns, "as many columns as the output");
    }
    let [paired_rows, paired_columns] = [rows, columns].map(|tiles| tiles / 2 * 2);
    let [all_rows, all_columns] = [output.rows, output.columns];
    let ends = [all_rows, all_columns];
    let mut four = |first, shape, ends| {
        let four = Four {
            first,
            shape,
            order,
        };
        add_four(unit, output, accum, terms, four, ends);
    };
    if order == Order::AlongColumns {
        for column in (0..paired_columns).step_by(2) {
            for row in (0..paired_rows).step_by(2) {
                four([row, column], Shape::Square, ends);
            }
        }
    }
    for group in (0..rows).step_by(GROUP) {
        if order == Order::AlongRows {
            for row in (group..paired_rows.min(group + GROUP)).step_by(2) {
                for column in (0..paired_columns).step_by(2) {
                    four([row, column], Shape::Square, ends);
                }
            }
        }
        if columns > paired_columns {
            four([group, paired_columns], Shape::Tall, ends);
        }
    }
    if rows > paired_rows {
        // The last column, if it is alone, is done.
        let ends = [all_rows, all_columns.min(paired_columns * SIDE)];
        for column in (0..paired_columns).step_by(4) {
            four([paired_rows, column], Shape::Wide, ends);
        }
    }
}

/// Four tiles of the product, cut off at the row and the column `ends` of the output.
fn add_four(
    unit: &impl Unit,
    output: &mut Output,
    accum: Accum,
    terms: &[Term],
    four: Four,
    ends: [usize; 2],
) {
    let stride = output.stride;
    let [row, column] = four.first.map(|tile| tile * SIDE);
    let [most, widest] = four.shape.tiles().map(|tiles| tiles * SIDE);
    let (height, width) = (most.min(ends[0] - row), widest.min(ends[1] - column));
    let c = &mut output.numbers[row * stride + column..];
    if [height, width] == [most, widest] {
        return unit.multiply(terms, four, accum, c, stride);
    }
    let mut whole = [0.0; FOUR];
    unit.multiply(terms, four, Accum::Replace, &mut whole, widest);
    let lines = c
        .chunks_mut(stride)
        .take(height)
        .map(|line| &mut line[..width]);
    for (line, product) in lines.zip(whole.chunks_exact(widest)) {
        match accum {
            Accum::Replace => line.copy_from_slice(&product[..width]),
            Accum::Add => line.iter_mut().zip(product).for_each(|(c, p)| *c += p),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::pack::Floats;
    use super::*;
    use crate::net::kernels::check::{numbers, single};

    /// Among them such with an odd number of tiles by rows, by columns and by both.
    const SIZES: [[usize; 3]; 8] = [
        [1, 1, 1],
        [32, 32, 32],
        [40, 70, 33],
        [97, 16, 100],
        [80, 80, 40],
        [48, 130, 300],
        [70, 48, 40],
        [112, 112, 70],
    ];

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
            run_cached(
                unit,
                &mut Output::dense(&mut c, columns),
                Accum::Replace,
                &lefts,
                &rights,
            );
            assert_eq!(c, expected, "{sizes:?}");
            run_cached(
                unit,
                &mut Output::dense(&mut c, columns),
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
            assert_multiplies(&Amx::new());
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn vectors_of_pairs_multiply_as_defined_where_there_are_some() {
        if let Some(unit) = Avx512::try_new() {
            assert_multiplies(&unit);
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
