//! Matrices of bfloat16 numbers, cut into tiles as matrix units take them.
//!
//! A product `C = A B` of `(M, K)` and `(K, N)` runs over its inner dimension `K` in pairs. A tile of the *left* matrix is
//! 16 of its rows by 32 along `K`, row by row. A tile of the *right* matrix is 32 along `K` by 16 of its columns: 16 pairs
//! of its rows, and of each pair the 16 columns, both numbers of a column side by side. With a pair as one 32-bit
//! number, a left tile and the right tile of its transpose are 16 x 16 matrices that are transposes of each other.

/// Rows of a left tile, columns of a right one, and rows and columns of the product's tile.
pub const SIDE: usize = 16;

/// Numbers along the inner dimension in a tile.
pub const DEPTH: usize = 32;

/// Rows, or columns, by which matrices grow: products take two tiles by two.
pub const STEP: usize = 2 * SIDE;

/// Numbers of a tile.
const LEN: usize = SIDE * DEPTH;

/// One kilobyte: 16 lines of 32 bfloat16 numbers, of which each is the upper half of a float's bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C, align(64))]
pub struct Tile(pub [u16; LEN]);

impl Tile {
    const ZERO: Self = Self([0; LEN]);

    /// Line `index`.
    #[inline(always)]
    pub fn line(&self, index: usize) -> &[u16; DEPTH] {
        &self.0.as_chunks().0[index]
    }

    /// Line `index`.
    #[inline(always)]
    pub fn line_mut(&mut self, index: usize) -> &mut [u16; DEPTH] {
        &mut self.0.as_chunks_mut().0[index]
    }
}

/// A left or right matrix, padded with zeros: its outer dimension to [`STEP`], the inner one to [`DEPTH`].
#[derive(Clone, Debug, Default)]
pub struct Tiles {
    tiles: Vec<Tile>,
    /// Length of the outer and of the inner dimension, without padding.
    shape: [usize; 2],
}

/// The nearest bfloat16 number, ties away from zero.
///
/// A NaN whose mantissa is all ones becomes a zero; processors make no such NaN.
#[inline(always)]
pub fn round(x: f32) -> u16 {
    (x.to_bits().wrapping_add(0x8000) >> 16) as u16
}

/// The float with the same value.
#[inline(always)]
pub fn widen(x: u16) -> f32 {
    f32::from_bits(u32::from(x) << 16)
}

impl Tiles {
    /// Resizes to `outer` rows of a left matrix, or columns of a right one, and `inner` along the inner dimension. Keeps its
    /// numbers if the shape stays; otherwise all are zero.
    pub fn resize(&mut self, outer: usize, inner: usize) {
        if self.shape != [outer, inner] {
            self.shape = [outer, inner];
            let blocks = outer.next_multiple_of(STEP) / SIDE;
            self.tiles.clear();
            self.tiles.resize(blocks * self.depth(), Tile::ZERO);
        }
    }

    /// Tiles along the inner dimension.
    pub fn depth(&self) -> usize {
        self.shape[1].div_ceil(DEPTH)
    }

    /// All tiles, of each block of [`SIDE`] along the outer dimension [`Tiles::depth`] of them.
    pub fn tiles(&self) -> &[Tile] {
        &self.tiles
    }

    /// The same, to be changed.
    pub fn tiles_mut(&mut self) -> &mut [Tile] {
        &mut self.tiles
    }

    /// The lines of row `row` of a left matrix, [`DEPTH`] numbers each.
    #[inline(always)]
    pub fn row_mut(&mut self, row: usize) -> impl Iterator<Item = &mut [u16; DEPTH]> {
        let depth = self.depth();
        let tiles = &mut self.tiles[row / SIDE * depth..][..depth];
        tiles.iter_mut().map(move |tile| tile.line_mut(row % SIDE))
    }

    /// The blocks of [`SIDE`] along the outer dimension.
    pub fn blocks_mut(&mut self) -> impl Iterator<Item = &mut [Tile]> {
        let depth = self.depth();
        self.tiles.chunks_exact_mut(depth)
    }
}
