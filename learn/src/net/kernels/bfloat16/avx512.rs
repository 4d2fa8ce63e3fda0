//! Products of tiles on vectors that multiply and add pairs of bfloat16 numbers (AVX-512 BF16): Intel's Software Developer's
//! Manual, volume 2, VDPBF16PS.
//!
//! This pays on AMD's processors alone: there these instructions, of twice the products, are as many in a cycle as those of
//! floats. On an Intel Xeon they were a quarter as many (83 GF/s a core beside 167, the kernel at 75).
#![allow(
    unsafe_code,
    reason = "the instruction is to be had by its intrinsic alone, which reads and writes no memory but is not there on every processor"
)]

use std::arch::x86_64::{
    __cpuid, __m512, _mm512_dpbf16_ps, _mm512_loadu_ps, _mm512_set1_epi32, _mm512_setzero_ps,
    _mm512_storeu_ps, CpuidResult,
};

use faer::Accum;

use super::tile::{DEPTH, SIDE};
use super::unit::{Four, Term, Unit};

/// The vectors, found on this processor.
#[derive(Clone, Copy, Debug)]
pub struct Avx512(());

/// Whether AMD made the processor.
pub fn is_amd() -> bool {
    // The vendor's name in three registers of CPUID's leaf 0.
    let CpuidResult { ebx, ecx, edx, .. } = __cpuid(0);
    [ebx, edx, ecx].map(u32::to_le_bytes).concat() == b"AuthenticAMD"
}

/// Rows whose sums are in registers at once: with two tiles of columns, 16 sums hide how long each product takes.
const ROWS: usize = SIDE / 2;

impl Avx512 {
    /// The vectors, where the processor has them.
    pub fn try_new() -> Option<Self> {
        let present = is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512bf16");
        present.then_some(Self(()))
    }
}

impl Unit for Avx512 {
    /// # Panics
    /// Where `c` is too short or two matrices differ in their inner dimension.
    fn multiply(&self, terms: &[Term], four: Four, accum: Accum, c: &mut [f32], stride: usize) {
        let [rows, columns] = four.shape.tiles();
        assert!(stride >= columns * SIDE && c.len() >= (rows * SIDE - 1) * stride + columns * SIDE);
        for Term { left, right } in terms {
            assert_eq!(left.depth(), right.depth(), "one inner dimension");
        }
        for row in (0..rows * SIDE).step_by(ROWS) {
            for column in (0..columns).step_by(2) {
                let strip = Strip {
                    block: four.first[0] + row / SIDE,
                    row: row % SIDE,
                    column: four.first[1] + column,
                };
                let c = &mut c[row * stride + column * SIDE..];
                // SAFETY: the processor has the instructions, as `self` shows. The operands have one inner dimension, and `c`
                // has the rows and columns of the strip, as seen above.
                unsafe {
                    if columns == 1 {
                        strip.multiply::<1>(terms, accum, c.as_mut_ptr(), stride);
                    } else {
                        strip.multiply::<2>(terms, accum, c.as_mut_ptr(), stride);
                    }
                }
            }
        }
    }
}

/// [`ROWS`] rows of the product by one tile of columns, or two.
#[derive(Clone, Copy)]
struct Strip {
    /// The block of the left matrix, and the first row in it.
    block: usize,
    row: usize,
    /// The first block of the right matrix.
    column: usize,
}

impl Strip {
    /// As [`Unit::multiply`], for these rows and `COLUMNS` tiles of columns.
    ///
    /// # Safety
    /// Each term's matrices must have one inner dimension; at `c`, [`ROWS`] rows `stride` numbers apart of `COLUMNS` tiles each
    /// are read and written.
    #[target_feature(enable = "avx512f,avx512bf16")]
    unsafe fn multiply<const COLUMNS: usize>(
        self,
        terms: &[Term],
        accum: Accum,
        c: *mut f32,
        stride: usize,
    ) {
        let mut sums = [[_mm512_setzero_ps(); COLUMNS]; ROWS];
        if let Accum::Add = accum {
            for (row, sums) in sums.iter_mut().enumerate() {
                for (column, sum) in sums.iter_mut().enumerate() {
                    // SAFETY: a row of a tile of the output.
                    *sum = unsafe { _mm512_loadu_ps(c.add(row * stride + column * SIDE)) };
                }
            }
        }
        for term in terms {
            // SAFETY: the caller's.
            unsafe { self.add(term, &mut sums) };
        }
        for (row, sums) in sums.iter().enumerate() {
            for (column, sum) in sums.iter().enumerate() {
                // SAFETY: a row of a tile of the output.
                unsafe { _mm512_storeu_ps(c.add(row * stride + column * SIDE), *sum) };
            }
        }
    }

    /// Adds a term's products to `sums`.
    ///
    /// # Safety
    /// The term's matrices must have one inner dimension.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bf16")]
    unsafe fn add<const COLUMNS: usize>(
        self,
        Term { left, right }: &Term,
        sums: &mut [[__m512; COLUMNS]; ROWS],
    ) {
        let (left_strides, right_strides) = (left.strides(), right.strides());
        let mut rows = left
            .pointer(self.block)
            .wrapping_add(self.row * left_strides.line);
        let mut columns = [right.pointer(self.column); COLUMNS];
        if let Some(second) = columns.get_mut(1) {
            *second = right.pointer(self.column + 1);
        }
        for _ in 0..left.depth() {
            for pair in 0..DEPTH / 2 {
                let mut numbers = [_mm512_setzero_ps(); COLUMNS];
                for (numbers, column) in numbers.iter_mut().zip(columns) {
                    // SAFETY: a line of a tile of the right matrix.
                    *numbers = unsafe {
                        _mm512_loadu_ps(column.wrapping_add(pair * right_strides.line).cast())
                    };
                }
                for (row, sums) in sums.iter_mut().enumerate() {
                    let at = rows.wrapping_add(row * left_strides.line + 2 * pair);
                    // SAFETY: two numbers of a line of a tile of the left matrix.
                    let factors = _mm512_set1_epi32(unsafe { at.cast::<i32>().read_unaligned() });
                    for (sum, numbers) in sums.iter_mut().zip(numbers) {
                        *sum = _mm512_dpbf16_ps(*sum, pulp::cast(factors), pulp::cast(numbers));
                    }
                }
            }
            rows = rows.wrapping_add(left_strides.inner);
            for column in &mut columns {
                *column = column.wrapping_add(right_strides.inner);
            }
        }
    }
}
