//! The operands and the order of a product of tiles, and the trait of what runs it.

use faer::Accum;

use super::panel::Panel;

/// A left and a right matrix, to be multiplied.
#[derive(Clone, Copy, Debug)]
pub struct Term<'a> {
    pub left: Panel<'a>,
    pub right: Panel<'a>,
}

/// Four tiles of a product, for which a matrix unit has registers: by rows and columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// 2 x 2.
    Square,
    /// 4 x 1.
    Tall,
    /// 1 x 4.
    Wide,
}

/// Which blocks of tiles are multiplied one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The same rows with all columns: the left matrix stays in the first cache.
    AlongRows,
    /// The same columns with all rows: the right matrix stays in the first cache, and the left one streams by.
    AlongColumns,
}

/// Four tiles of a product: those from the tile `first` on.
#[derive(Clone, Copy, Debug)]
pub struct Four {
    pub first: [usize; 2],
    pub shape: Shape,
    pub order: Order,
}

impl Shape {
    /// Tiles by rows and by columns.
    pub const fn tiles(self) -> [usize; 2] {
        match self {
            Self::Square => [2, 2],
            Self::Tall => [4, 1],
            Self::Wide => [1, 4],
        }
    }
}

/// What multiplies tiles: a matrix unit, or vectors.
pub trait Unit {
    /// Writes the sum of the products of `terms`, four tiles, to `c`, whose rows have the given stride, or adds it. Where a
    /// matrix has fewer blocks, its last one is taken again.
    fn multiply(&self, terms: &[Term], four: Four, accum: Accum, c: &mut [f32], stride: usize);
}
