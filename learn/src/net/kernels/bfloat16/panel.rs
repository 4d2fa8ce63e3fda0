//! Operands of products: their layout in memory, as strides.

use std::ops::Range;

use super::tile::{DEPTH, SIDE, Tile, Tiles};

/// Memory of an operand.
#[derive(Clone, Copy, Debug)]
enum Numbers<'a> {
    Tiles(&'a [Tile]),
    Rows(&'a [u16]),
}

impl Numbers<'_> {
    fn len(self) -> usize {
        match self {
            Self::Tiles(tiles) => tiles.len() * SIDE * DEPTH,
            Self::Rows(numbers) => numbers.len(),
        }
    }
}

/// Strides (in numbers): from one line of a tile to the next, and from a tile to the next along the inner and along the outer
/// dimension.
#[derive(Clone, Copy, Debug)]
pub struct Strides {
    pub line: usize,
    pub inner: usize,
    pub outer: usize,
}

/// A left or right matrix whose tiles' lines have fixed strides, which may be shorter than the lines.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a> {
    numbers: Numbers<'a>,
    first: usize,
    strides: Strides,
    blocks: usize,
    depth: usize,
}

impl Tiles {
    /// The whole matrix.
    pub fn whole(&self) -> Panel<'_> {
        self.panel(0..self.depth())
    }

    /// The tiles `part` along the inner dimension, of all blocks.
    pub fn panel(&self, part: Range<usize>) -> Panel<'_> {
        let tile = SIDE * DEPTH;
        let strides = Strides {
            line: DEPTH,
            inner: tile,
            outer: self.depth() * tile,
        };
        let size = [self.tiles().len() / self.depth(), part.len()];
        Panel::new(
            Numbers::Tiles(self.tiles()),
            part.start * tile,
            strides,
            size,
        )
    }
}

impl<'a> Panel<'a> {
    /// `blocks` by `depth` tiles from number `first` on.
    pub fn of_rows(numbers: &'a [u16], first: usize, strides: Strides, size: [usize; 2]) -> Self {
        Self::new(Numbers::Rows(numbers), first, strides, size)
    }

    /// # Panics
    /// Where a tile's line lies outside of the numbers: what multiplies them reads unchecked.
    fn new(
        numbers: Numbers<'a>,
        first: usize,
        strides: Strides,
        [blocks, depth]: [usize; 2],
    ) -> Self {
        assert!(blocks > 0 && depth > 0, "an empty operand");
        let last =
            (blocks - 1) * strides.outer + (depth - 1) * strides.inner + (SIDE - 1) * strides.line;
        assert!(
            first + last + DEPTH <= numbers.len(),
            "an operand within its numbers"
        );
        Self {
            numbers,
            first,
            strides,
            blocks,
            depth,
        }
    }

    /// Blocks along the outer dimension.
    pub fn blocks(&self) -> usize {
        self.blocks
    }

    /// Tiles along the inner dimension.
    pub fn depth(&self) -> usize {
        self.depth
    }

    /// Strides of lines and tiles.
    pub fn strides(&self) -> Strides {
        self.strides
    }

    /// The first line of block `block`, or of the last one if there are fewer: of it and its following tiles, all lines may
    /// be read.
    pub fn pointer(&self, block: usize) -> *const u16 {
        let start = match self.numbers {
            Numbers::Tiles(tiles) => tiles.as_ptr().cast::<u16>(),
            Numbers::Rows(numbers) => numbers.as_ptr(),
        };
        start.wrapping_add(self.start(block))
    }

    /// A line of a tile of block `block`, or of the last one if there are fewer.
    #[inline(always)]
    pub fn line(&self, block: usize, tile: usize, line: usize) -> &'a [u16; DEPTH] {
        let at = self.start(block) + tile * self.strides.inner + line * self.strides.line;
        match self.numbers {
            Numbers::Tiles(tiles) => tiles[at / (SIDE * DEPTH)].line(at / DEPTH % SIDE),
            Numbers::Rows(numbers) => numbers[at..]
                .first_chunk()
                .expect("a line within the numbers"),
        }
    }

    fn start(&self, block: usize) -> usize {
        self.first + block.min(self.blocks - 1) * self.strides.outer
    }
}
