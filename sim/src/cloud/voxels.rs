//! Which voxels of a grid hold a point.
//!
//! Occupied voxels are bits of sparse blocks: neighbouring pixels mostly share one block.

use hashbrown::HashMap;

/// A grid of cubes that keeps one point in each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoxelGrid {
    /// Edge of a cube (m), above 0.
    pub size: f64,
    /// A corner of the grid, world frame (m).
    pub origin: [f64; 3],
}

impl VoxelGrid {
    /// Smallest and largest edge (m) of cubes that thin clouds of robots: smaller ones than a depth camera tells apart are not counted
    /// beyond some kilometres, and in larger ones a robot is one point.
    pub const SIZES: [f64; 2] = [1e-6, 1.0];

    /// [`SIZES`](Self::SIZES), for messages.
    pub const EXPECTED_SIZE: &str = "a finite length above 0, from 0.000001 to 1 m";

    /// Whether cubes of this edge (m) thin clouds of robots.
    pub fn is_size(size: f64) -> bool {
        let [smallest, largest] = Self::SIZES;
        (smallest..=largest).contains(&size)
    }

    /// A grid with a corner at the world's origin.
    pub fn new(size: f64) -> Self {
        Self {
            size,
            origin: [0.0; 3],
        }
    }

    /// Number along `axis` of the cube that holds the coordinate `x` (m).
    #[inline(always)]
    pub(super) fn cell(&self, axis: usize, x: f32) -> i32 {
        // `as` saturates: points beyond the grid's range share its outermost cells.
        ((f64::from(x) - self.origin[axis]) / self.size).floor() as i32
    }
}

/// Side of a block of cells, as a power of 2.
const LOG_SIDE: i32 = 3;
/// Cells of a block, a bit for each.
type Block = [u64; 8];

/// A sparse set of cells, in blocks: a surface fills few, and neighbouring points share one.
#[derive(Debug, Default)]
pub(super) struct CellSet {
    blocks: Vec<Block>,
    numbers: HashMap<[i32; 3], usize>,
    /// The block looked up last.
    recent: Option<([i32; 3], usize)>,
}

impl CellSet {
    pub fn clear(&mut self) {
        self.blocks.clear();
        self.numbers.clear();
        self.recent = None;
    }

    /// Adds a cell; whether it was not there before.
    #[inline]
    pub fn insert(&mut self, cell: [i32; 3]) -> bool {
        let place = cell.map(|c| c >> LOG_SIDE);
        let number = match self.recent {
            Some((recent, number)) if recent == place => number,
            _ => self.look_up(place),
        };
        let [x, y, z] = cell.map(|c| (c & ((1 << LOG_SIDE) - 1)) as usize);
        let word = &mut self.blocks[number][x];
        let bit = 1 << (8 * y + z);
        let new = *word & bit == 0;
        *word |= bit;
        new
    }

    fn look_up(&mut self, place: [i32; 3]) -> usize {
        let blocks = &mut self.blocks;
        let number = *self.numbers.entry(place).or_insert_with(|| {
            blocks.push(Block::default());
            blocks.len() - 1
        });
        self.recent = Some((place, number));
        number
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use std::collections::HashSet;

    #[test]
    fn a_cell_is_new_once() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let (mut cells, mut plain) = (CellSet::default(), HashSet::new());
        for round in 0..2 {
            for _ in 0..20_000 {
                let cell = std::array::from_fn(|_| rng.random_range(-20..20) + round);
                assert_eq!(cells.insert(cell), plain.insert(cell), "{cell:?}");
            }
            cells.clear();
            plain.clear();
        }
        let ends = [i32::MIN, -1, 0, i32::MAX];
        let corners = ends
            .iter()
            .flat_map(|&x| ends.iter().map(move |&y| [x, y, x]));
        assert!(
            corners
                .into_iter()
                .all(|cell| cells.insert(cell) && !cells.insert(cell))
        );
    }
}
