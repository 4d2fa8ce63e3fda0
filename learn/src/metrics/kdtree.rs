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
            min: [0, 1, 2].map(|axis| aabb.min[axis].min(point[axis])),
            max: [0, 1, 2].map(|axis| aabb.max[axis].max(point[axis])),
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

    /// Squared distance (m^2) from `x` to the box, zero inside.
    #[inline]
    pub(super) fn squared_distance(&self, x: &[f64; 3]) -> f64 {
        let outside = |axis: usize| {
            (self.min[axis] - x[axis])
                .max(x[axis] - self.max[axis])
                .max(0.0)
        };
        let (dx, dy, dz) = (outside(0), outside(1), outside(2));
        dx * dx + dy * dy + dz * dz
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
        let depth = points
            .len()
            .div_ceil(LEAF_CAPACITY)
            .next_power_of_two()
            .ilog2();
        let mut entries: Vec<([f64; 3], usize)> =
            points.iter().copied().zip(0..points.len()).collect();
        let mut boxes = vec![Aabb::EMPTY; 2 << depth];
        for (node, aabb) in boxes.iter_mut().enumerate().skip(1) {
            let entries = &mut entries[slots_below(node, points.len())];
            *aabb = Aabb::of(entries.iter().map(|(point, _)| point));
            if node >> depth == 0 {
                let half = slots_below(2 * node, points.len()).len();
                let axis = aabb.longest_axis();
                // Ties by index, so that equal points keep one order.
                entries.select_nth_unstable_by(half, |(a, i), (b, j)| {
                    a[axis].total_cmp(&b[axis]).then(i.cmp(j))
                });
            }
        }
        let (points, order) = entries.into_iter().unzip();
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
