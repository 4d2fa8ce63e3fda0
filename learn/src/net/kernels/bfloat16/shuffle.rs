//! Tiles from one layout into another.

#[cfg(target_arch = "x86_64")]
use pulp::x86::V4;

use super::tile::{DEPTH, SIDE, Tile};

/// A tile as a 16 x 16 matrix of pairs of numbers.
type Pairs = [[u32; SIDE]; SIDE];

/// What two tiles of a left matrix are repacked as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// The same matrix, as a right one.
    Right,
    /// Its transpose, a left one.
    LeftTransposed,
}

/// Transposes every tile, as a matrix of pairs.
pub fn transpose(tiles: &mut [Tile]) {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = V4::try_new() {
        return simd.vectorize(wide::Transpose { simd, tiles });
    }
    tiles.iter_mut().for_each(plain_transpose);
}

/// Two left tiles, one above the other, become two tiles, one beside the other in a right matrix, or one above the other
/// in a left one.
pub fn turn(turn: Turn, from: [&Tile; 2], to: [&mut Tile; 2]) {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = V4::try_new() {
        return simd.vectorize(wide::PairRows {
            simd,
            turn,
            from,
            to,
        });
    }
    plain_turn(turn, from, to);
}

fn plain_transpose(tile: &mut Tile) {
    let lines: &mut Pairs = pulp::bytemuck::cast_mut(&mut tile.0);
    let before = *lines;
    for (row, line) in lines.iter_mut().enumerate() {
        for (number, before) in line.iter_mut().zip(&before) {
            *number = before[row];
        }
    }
}

fn plain_turn(turn: Turn, from: [&Tile; 2], to: [&mut Tile; 2]) {
    for (side, to) in to.into_iter().enumerate() {
        for row in 0..DEPTH {
            let numbers = from[row / SIDE].line(row % SIDE);
            let line = to.line_mut(row / 2);
            for (column, number) in numbers[side * SIDE..][..SIDE].iter().enumerate() {
                line[2 * column + row % 2] = *number;
            }
        }
        if turn == Turn::LeftTransposed {
            plain_transpose(to);
        }
    }
}

/// With a line in a register of AVX-512.
#[cfg(target_arch = "x86_64")]
mod wide {
    use std::arch::x86_64::__m512i;

    use pulp::NullaryFnOnce;

    use super::*;

    pub struct Transpose<'a> {
        pub simd: V4,
        pub tiles: &'a mut [Tile],
    }

    impl NullaryFnOnce for Transpose<'_> {
        type Output = ();

        #[inline(always)]
        fn call(self) {
            for tile in self.tiles {
                let lines: &mut Pairs = pulp::bytemuck::cast_mut(&mut tile.0);
                let mut registers = [pulp::cast([0u32; SIDE]); SIDE];
                for (register, line) in registers.iter_mut().zip(&*lines) {
                    *register = pulp::cast(*line);
                }
                let transposed = transposed(self.simd, registers);
                for (line, register) in lines.iter_mut().zip(transposed) {
                    *line = pulp::cast(register);
                }
            }
        }
    }

    pub struct PairRows<'a> {
        pub simd: V4,
        pub turn: Turn,
        pub from: [&'a Tile; 2],
        pub to: [&'a mut Tile; 2],
    }

    impl NullaryFnOnce for PairRows<'_> {
        type Output = ();

        #[inline(always)]
        fn call(self) {
            /// Half a row's numbers, each with its neighbour of the next row.
            const fn pairs(half: usize) -> [u16; DEPTH] {
                let mut places = [0; DEPTH];
                let mut k = 0;
                while k < SIDE {
                    places[2 * k] = (half * SIDE + k) as u16;
                    places[2 * k + 1] = (DEPTH + half * SIDE + k) as u16;
                    k += 1;
                }
                places
            }
            let unit = self.simd.avx512bw;
            for (places, to) in const { [pairs(0), pairs(1)] }.into_iter().zip(self.to) {
                let places: __m512i = pulp::cast(places);
                let mut lines = [places; SIDE];
                for (k, line) in lines.iter_mut().enumerate() {
                    let from = self.from[2 * k / SIDE];
                    let even = pulp::cast(*from.line(2 * k % SIDE));
                    let odd = pulp::cast(*from.line((2 * k + 1) % SIDE));
                    *line = unit._mm512_permutex2var_epi16(even, places, odd);
                }
                if self.turn == Turn::LeftTransposed {
                    lines = transposed(self.simd, lines);
                }
                for (k, line) in lines.into_iter().enumerate() {
                    *to.line_mut(k) = pulp::cast(line);
                }
            }
        }
    }

    /// 1 x 1, 2 x 2, 4 x 4 and 8 x 8 blocks change places.
    #[inline(always)]
    fn transposed(simd: V4, mut a: [__m512i; SIDE]) -> [__m512i; SIDE] {
        let unit = simd.avx512f;
        let mut b = a;
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
        a
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(start: u16) -> Tile {
        Tile(std::array::from_fn(|k| start + k as u16))
    }

    #[test]
    fn shuffles_transpose_as_plain_loops_do() {
        let tile = tile(0);
        let (mut shuffled, mut expected) = ([tile; 3], tile);
        transpose(&mut shuffled);
        plain_transpose(&mut expected);
        assert_eq!(shuffled, [expected; 3]);
        assert_eq!(expected.line(3)[10..12], tile.line(5)[6..8]);
    }

    #[test]
    fn shuffles_turn_tiles_as_plain_loops_do() {
        let from = [tile(0), tile(1000)];
        for way in [Turn::Right, Turn::LeftTransposed] {
            let (mut shuffled, mut expected) = ([tile(0); 2], [tile(0); 2]);
            turn(way, from.each_ref(), shuffled.each_mut());
            plain_turn(way, from.each_ref(), expected.each_mut());
            assert_eq!(shuffled, expected);
        }
    }
}
