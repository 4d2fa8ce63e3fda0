//! A balanced k-d tree over points in space.

use std::ops::Range;

/// Most points in a leaf: few enough to scan, many enough to keep the tree shallow.
const LEAF_CAPACITY: usize = 16;

/// Squared Euclidean distance (m^2).
#[inline]
pub(super) fn squared_distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let (x, y, z) = (a[0] - b[0], a[1] - b[1], a[2] - b[2]);
    x * x + y * y + z * z
}

/// Axis-aligned bounding box (m).
#[derive(Clone, Copy, Debug)]
pub(super) struct Aabb {
    pub(super) min: [f64; 3],
    pub(super) max: [f64; 3],
}

impl Aabb {
    const EMPTY: Self = Self {
        min: [f64::INFINITY; 3],
        max: [f64::NEG_INFINITY; 3],
    };

    pub(super) fn of<'a>(points: impl IntoIterator<Item = &'a [f64; 3]>) -> Self {
        points.into_iter().fold(Self::EMPTY, |aabb, point| Self {
            min: [0, 1, 2].map(|axis| lesser(aabb.min[axis], point[axis])),
            max: [0, 1, 2].map(|axis| greater(aabb.max[axis], point[axis])),
        })
    }

    fn longest_axis(&self) -> usize {
        let extent = |axis: usize| self.max[axis] - self.min[axis];
        (1..3).fold(0, |best, axis| {
            if extent(axis) > extent(best) {
                axis
            } else {
                best
            }
        })
    }

    /// Squared distance (m^2) between the nearest points of two boxes, zero where they meet.
    #[inline]
    pub(super) fn squared_gap(&self, other: &Self) -> f64 {
        let apart = |axis: usize| {
            let gap = greater(
                self.min[axis] - other.max[axis],
                other.min[axis] - self.max[axis],
            );
            greater(gap, 0.0)
        };
        let (dx, dy, dz) = (apart(0), apart(1), apart(2));
        dx * dx + dy * dy + dz * dz
    }

    /// Squared distance (m^2) from `x` to the box, zero inside.
    #[inline]
    pub(super) fn squared_distance(&self, x: &[f64; 3]) -> f64 {
        let outside = |axis: usize| {
            greater(
                greater(self.min[axis] - x[axis], x[axis] - self.max[axis]),
                0.0,
            )
        };
        let (dx, dy, dz) = (outside(0), outside(1), outside(2));
        dx * dx + dy * dy + dz * dz
    }
}

/// `f64::min` of two numbers, in one instruction: NaN is not minded.
#[inline]
pub(super) fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// `f64::max` of two numbers, in one instruction: NaN is not minded.
#[inline]
pub(super) fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The index of a point below a key to sort it by, in one word, which is faster to move and to compare than the point.
/// Keys are coordinates in single precision: a tree is right wherever it is cut. Equal keys are in the order of their
/// indices, of which there are fewer than `2^32` (100 GB of points).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Entry(u64);

impl Entry {
    fn of(index: usize) -> Self {
        Self(index as u64)
    }

    fn index(self) -> usize {
        (self.0 & u64::from(u32::MAX)) as usize
    }

    /// The entry with the key of `coordinate` (m).
    fn keyed(self, coordinate: f64) -> Self {
        let bits = (coordinate as f32).to_bits();
        // Order of the bits as integers is that of the numbers once negative ones are flipped.
        let key = bits ^ ((bits as i32 >> 31) as u32 | 1 << 31);
        Self(u64::from(key) << 32 | self.0 & u64::from(u32::MAX))
    }
}

/// Points sorted into a complete binary tree of tight boxes.
///
/// Node 1 is the root, nodes `2k` and `2k + 1` are the halves of node `k`, and all leaves lie at one
/// depth. A point is named by its *slot*, its place in tree order.
#[derive(Debug)]
pub(super) struct KdTree {
    points: Vec<[f64; 3]>,
    order: Vec<usize>,
    boxes: Vec<Aabb>,
    depth: u32,
}

impl KdTree {
    /// Tree of one or more finite points (m).
    pub(super) fn new(points: &[[f64; 3]]) -> Self {
        let n = points.len();
        let depth = n.div_ceil(LEAF_CAPACITY).next_power_of_two().ilog2();
        let mut entries: Vec<Entry> = (0..n).map(Entry::of).collect();
        let mut boxes = vec![Aabb::EMPTY; 2 << depth];
        for (node, aabb) in boxes.iter_mut().enumerate().skip(1) {
            let entries = &mut entries[slots_below(node, n)];
            *aabb = Aabb::of(entries.iter().map(|entry| &points[entry.index()]));
            if node >> depth == 0 {
                let half = slots_below(2 * node, n).len();
                let axis = aabb.longest_axis();
                for entry in entries.iter_mut() {
                    *entry = entry.keyed(points[entry.index()][axis]);
                }
                entries.select_nth_unstable(half);
            }
        }
        let order: Vec<usize> = entries.iter().map(|entry| entry.index()).collect();
        let points = order.iter().map(|&index| points[index]).collect();
        Self {
            points,
            order,
            boxes,
            depth,
        }
    }

    /// Number of points.
    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// Points in tree order (m).
    pub(super) fn points(&self) -> &[[f64; 3]] {
        &self.points
    }

    /// Index in the original cloud of the point in each slot.
    pub(super) fn order(&self) -> &[usize] {
        &self.order
    }

    /// The root, then every node from 1 on: a table collected over it is indexed by node.
    pub(super) fn nodes(&self) -> impl Iterator<Item = usize> {
        (0..self.boxes.len()).map(|node| node.max(1))
    }

    /// Box of each node, indexed by node.
    pub(super) fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// Slots of the points below `node`.
    #[inline]
    pub(super) fn slots(&self, node: usize) -> Range<usize> {
        slots_below(node, self.points.len())
    }

    /// Branch and bound from `node` down: calls `leaf(slots, limit)` for the leaves whose
    /// `bound(node)` lies below `limit`, the more promising half first. `leaf` lowers `limit`.
    #[inline]
    pub(super) fn descend(
        &self,
        node: usize,
        limit: &mut f64,
        bound: &impl Fn(usize) -> f64,
        leaf: &mut impl FnMut(Range<usize>, &mut f64),
    ) {
        if node >> self.depth == 1 {
            leaf(self.slots(node), limit);
            return;
        }
        let (mut near, mut far) = (
            (2 * node, bound(2 * node)),
            (2 * node + 1, bound(2 * node + 1)),
        );
        if far.1 < near.1 {
            std::mem::swap(&mut near, &mut far);
        }
        for (child, child_bound) in [near, far] {
            if child_bound < *limit {
                self.descend(child, limit, bound, leaf);
            }
        }
    }

    /// The leaves, in the order of their slots.
    pub(super) fn leaves(&self) -> Range<usize> {
        1 << self.depth..2 << self.depth
    }

    /// A leaf near `x`: from node to node, the half whose box is nearer.
    pub(super) fn leaf_near(&self, x: &[f64; 3]) -> usize {
        let mut node = 1;
        while node >> self.depth == 0 {
            let [below, above] =
                [2 * node, 2 * node + 1].map(|child| self.boxes[child].squared_distance(x));
            node = 2 * node + usize::from(above < below);
        }
        node
    }

    /// Slot and squared distance (m^2) of the point nearest to `x`; `guess` is any slot, the nearer
    /// to `x` the faster.
    pub(super) fn nearest(&self, x: &[f64; 3], guess: usize) -> (usize, f64) {
        let mut nearest = guess;
        let mut limit = squared_distance(x, &self.points[guess]);
        self.descend(
            1,
            &mut limit,
            &|node| self.boxes[node].squared_distance(x),
            &mut |slots, limit| {
                for slot in slots {
                    let squared = squared_distance(x, &self.points[slot]);
                    if squared < *limit {
                        *limit = squared;
                        nearest = slot;
                    }
                }
            },
        );
        (nearest, limit)
    }
}

/// Slots of the points below `node` of a tree of `n` points: halves differ by at most one point.
#[inline]
fn slots_below(node: usize, n: usize) -> Range<usize> {
    let level = node.ilog2();
    let place = node - (1 << level);
    (n * place) >> level..(n * (place + 1)) >> level
}
