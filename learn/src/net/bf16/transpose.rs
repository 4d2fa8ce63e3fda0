//! Tiles as 16 x 16 matrices of pairs, transposed.

#[cfg(target_arch = "x86_64")]
use pulp::x86::V4;

use super::tile::{SIDE, Tile};

/// A tile's pairs of numbers, line by line.
type Pairs = [[u32; SIDE]; SIDE];

/// Transposes every tile.
pub fn transpose(tiles: &mut [Tile]) {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = V4::try_new() {
        return simd.vectorize(Shuffled { simd, tiles });
    }
    tiles.iter_mut().for_each(plain);
}

/// One tile, pair by pair.
fn plain(tile: &mut Tile) {
    let lines: &mut Pairs = pulp::bytemuck::cast_mut(&mut tile.0);
    for row in 1..SIDE {
        for column in 0..row {
            (lines[row][column], lines[column][row]) = (lines[column][row], lines[row][column]);
        }
    }
}

/// Transposition with a line in a register of AVX-512: 1 x 1, 2 x 2, 4 x 4 and 8 x 8 blocks change places.
#[cfg(target_arch = "x86_64")]
struct Shuffled<'a> {
    simd: V4,
    tiles: &'a mut [Tile],
}

#[cfg(target_arch = "x86_64")]
impl pulp::NullaryFnOnce for Shuffled<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        use std::arch::x86_64::__m512i;

        let unit = self.simd.avx512f;
        let zero: __m512i = pulp::cast([0u64; 8]);
        for tile in self.tiles {
            let lines: &mut Pairs = pulp::bytemuck::cast_mut(&mut tile.0);
            let mut a = [zero; SIDE];
            for k in 0..SIDE {
                a[k] = pulp::cast(lines[k]);
            }
            let mut b = [zero; SIDE];
            for k in (0..SIDE).step_by(2) {
                b[k] = unit._mm512_unpacklo_epi32(a[k], a[k + 1]);
                b[k + 1] = unit._mm512_unpackhi_epi32(a[k], a[k + 1]);
            }
            for k in (0..SIDE).step_by(4) {
                a[k] = unit._mm512_unpacklo_epi64(b[k], b[k + 2]);
                a[k + 1] = unit._mm512_unpackhi_epi64(b[k], b[k + 2]);
                a[k + 2] = unit._mm512_unpacklo_epi64(b[k + 1], b[k + 3]);
                a[k + 3] = unit._mm512_unpackhi_epi64(b[k + 1], b[k + 3]);
            }
            for k in [0, 1, 2, 3, 8, 9, 10, 11] {
                b[k] = unit._mm512_shuffle_i32x4::<0x88>(a[k], a[k + 4]);
                b[k + 4] = unit._mm512_shuffle_i32x4::<0xdd>(a[k], a[k + 4]);
            }
            for k in 0..SIDE / 2 {
                a[k] = unit._mm512_shuffle_i32x4::<0x88>(b[k], b[k + 8]);
                a[k + 8] = unit._mm512_shuffle_i32x4::<0xdd>(b[k], b[k + 8]);
            }
            for k in 0..SIDE {
                lines[k] = pulp::cast(a[k]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shuffles_transpose_as_plain_loops_do() {
        let tile = Tile(std::array::from_fn(|k| k as u16));
        let (mut shuffled, mut expected) = ([tile; 3], tile);
        transpose(&mut shuffled);
        plain(&mut expected);
        assert_eq!(shuffled, [expected; 3]);
        assert_eq!(expected.line(3)[10..12], tile.line(5)[6..8]);
    }
}
