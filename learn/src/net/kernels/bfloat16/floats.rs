//! Products of tiles on vectors of floats, for processors without bfloat16 instructions.

use faer::Accum;
use pulp::{Arch, Simd, WithSimd};

use super::tile::{SIDE, widen};
use super::unit::{Four, Term, Unit};

/// The processor's vectors of floats.
pub struct Vectors;

impl Unit for Vectors {
    fn multiply(&self, terms: &[Term], four: Four, accum: Accum, c: &mut [f32], stride: usize) {
        let [rows, columns] = four.shape.tiles();
        for tile in 0..rows * columns {
            let at = [tile / columns, tile % columns];
            let c = &mut c[(at[0] * stride + at[1]) * SIDE..];
            if let Accum::Replace = accum {
                c.chunks_mut(stride)
                    .take(SIDE)
                    .for_each(|line| line[..SIDE].fill(0.0));
            }
            for term in terms {
                Arch::new().dispatch(MultiplyAdd {
                    term,
                    at: [four.first[0] + at[0], four.first[1] + at[1]],
                    c,
                    stride,
                });
            }
        }
    }
}

/// One tile of the product.
struct MultiplyAdd<'a> {
    term: &'a Term<'a>,
    at: [usize; 2],
    c: &'a mut [f32],
    stride: usize,
}

impl WithSimd for MultiplyAdd<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Term { left, right } = self.term;
        assert_eq!(left.depth(), right.depth(), "one inner dimension");
        let mut sums = [[0.0f32; SIDE]; SIDE];
        for tile in 0..left.depth() {
            for pair in 0..SIDE {
                let line = right.line(self.at[1], tile, pair);
                let (mut even, mut odd) = ([0.0; SIDE], [0.0; SIDE]);
                for k in 0..SIDE {
                    (even[k], odd[k]) = (widen(line[2 * k]), widen(line[2 * k + 1]));
                }
                for (row, sums) in sums.iter_mut().enumerate() {
                    let numbers = left.line(self.at[0], tile, row);
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
