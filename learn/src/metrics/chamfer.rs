//! Chamfer distance.

use pulp::{Arch, Simd, WithSimd};

use super::kdtree::{Aabb, KdTree, greater, lesser};
use super::{MetricError, Side, checked};

/// Chamfer distance (m^2) between `p` and `q`, positions (m) of any two numbers of points:
/// `CD = 1/|P| sum_p min_q |p - q|^2 + 1/|Q| sum_q min_p |q - p|^2`
/// (Fan, Su and Guibas, CVPR 2017, averaged over the points of each cloud).
///
/// # Errors
/// An empty cloud, or a coordinate that is not finite.
pub fn chamfer(p: &[[f32; 3]], q: &[[f32; 3]]) -> Result<f64, MetricError> {
    let p = KdTree::new(&checked(p, Side::First)?);
    let q = KdTree::new(&checked(q, Side::Second)?);
    Ok(mean_squared_distance(&p, &q) + mean_squared_distance(&q, &p))
}

/// Mean squared distance (m^2) from the points of `from` to their nearest points of `to`.
fn mean_squared_distance(from: &KdTree, to: &KdTree) -> f64 {
    let search = Search {
        points: from.points(),
        tree: to,
    };
    Arch::new().dispatch(search) / from.len() as f64
}

/// Sums the squared distances (m^2) from points (m), neighbours in order, to the nearest points of a tree.
///
/// Neighbours search together, in groups. What calls what is inlined, so that all of it is compiled for the vector
/// registers of the processor.
struct Search<'a> {
    points: &'a [[f64; 3]],
    tree: &'a KdTree,
}

impl WithSimd for Search<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let mut open = Vec::new();
        let mut sum = 0.0;
        for points in self.points.chunks(LANES * BLOCKS) {
            let mut group = Group::of(points);
            let guess = self.tree.leaf_near(&points[points.len() / 2]);
            group.search(self.tree, guess, &mut open);
            let squared = group.blocks.iter().flat_map(|block| block.squared);
            sum += squared.take(points.len()).sum::<f64>();
        }
        sum
    }
}

/// Points of a block, one to a lane of a few vector registers.
const LANES: usize = 16;

/// Blocks of a group.
const BLOCKS: usize = 4;

/// Points that go down a tree together.
struct Group {
    blocks: [Block; BLOCKS],
    aabb: Aabb,
}

impl Group {
    /// The group of some points (m); where they are too few, the last one is repeated.
    #[inline(always)]
    fn of(points: &[[f64; 3]]) -> Self {
        let point = |slot: usize| &points[slot.min(points.len() - 1)];
        Self {
            blocks: std::array::from_fn(|block| Block::of(|lane| point(block * LANES + lane))),
            aabb: Aabb::of(points),
        }
    }

    /// Finds the nearest points of `tree`, from the leaf `guess` on: the nearer to the group, the faster. `open` is empty
    /// before and after.
    #[inline(always)]
    fn search(&mut self, tree: &KdTree, guess: usize, open: &mut Vec<(usize, f64)>) {
        for block in &mut self.blocks {
            block.meet(&tree.points()[tree.slots(guess)]);
        }
        let mut limit = self.limit();
        open.push((1, 0.0));
        while let Some((node, gap)) = open.pop() {
            let aabb = &tree.boxes()[node];
            if gap >= limit {
                continue;
            }
            if tree.leaves().contains(&node) {
                if node != guess {
                    self.meet(&tree.points()[tree.slots(node)], aabb);
                    limit = self.limit();
                }
            } else if self.may_gain(aabb) {
                let [mut near, mut far] = [2 * node, 2 * node + 1]
                    .map(|child| (child, tree.boxes()[child].squared_gap(&self.aabb)));
                if far.1 < near.1 {
                    std::mem::swap(&mut near, &mut far);
                }
                open.extend([far, near]);
            }
        }
    }

    /// Largest squared distance (m^2) from a point to the nearest one met so far.
    #[inline(always)]
    fn limit(&self) -> f64 {
        self.blocks
            .iter()
            .fold(0.0, |limit, block| greater(limit, block.limit))
    }

    /// Whether a point in `aabb` may be nearer to one of the group than all met so far. Of clouds that lie far apart, this
    /// tells far more than the boxes' distance: a group is wider than the distances of its points differ.
    #[inline(always)]
    fn may_gain(&self, aabb: &Aabb) -> bool {
        for block in &self.blocks {
            if block.may_gain(aabb) {
                return true;
            }
        }
        false
    }

    /// Lets the blocks meet the points (m) of `aabb` that may gain by it.
    #[inline(always)]
    fn meet(&mut self, points: &[[f64; 3]], aabb: &Aabb) {
        for block in &mut self.blocks {
            if block.may_gain(aabb) {
                block.meet(points);
            }
        }
    }
}

/// Points, axis by axis (m), and their squared distances (m^2) to the nearest point met so far.
struct Block {
    axes: [[f64; LANES]; 3],
    squared: [f64; LANES],
    /// Largest of `squared`.
    limit: f64,
}

impl Block {
    #[inline(always)]
    fn of<'a>(point: impl Fn(usize) -> &'a [f64; 3]) -> Self {
        Self {
            axes: [0, 1, 2].map(|axis| std::array::from_fn(|lane| point(lane)[axis])),
            squared: [f64::INFINITY; LANES],
            limit: f64::INFINITY,
        }
    }

    /// Whether a point in `aabb` may be nearer to one of the block than all met so far. Rounding does not tell otherwise:
    /// it keeps the order of the distances, axis by axis.
    #[inline(always)]
    fn may_gain(&self, aabb: &Aabb) -> bool {
        let mut any = false;
        for lane in 0..LANES {
            let point = [0, 1, 2].map(|axis| self.axes[axis][lane]);
            any |= aabb.squared_distance(&point) < self.squared[lane];
        }
        any
    }

    /// Meets some points (m).
    #[inline(always)]
    fn meet(&mut self, points: &[[f64; 3]]) {
        let mut least = self.squared;
        for point in points {
            for (lane, least) in least.iter_mut().enumerate() {
                let [dx, dy, dz] = [0, 1, 2].map(|axis| self.axes[axis][lane] - point[axis]);
                *least = lesser(dx * dx + dy * dy + dz * dz, *least);
            }
        }
        self.squared = least;
        self.limit = greatest(least);
    }
}

/// The greatest of a block's numbers, by halves as vector registers take it.
#[inline(always)]
fn greatest(mut numbers: [f64; LANES]) -> f64 {
    let mut half = LANES / 2;
    while half > 0 {
        for lane in 0..half {
            numbers[lane] = greater(numbers[lane], numbers[lane + half]);
        }
        half /= 2;
    }
    numbers[0]
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use std::ops::Range;

    use super::*;
    use proptest::prelude::*;

    fn cloud(sizes: Range<usize>) -> impl Strategy<Value = Vec<[f32; 3]>> {
        prop::collection::vec(prop::array::uniform3(-1.0f32..1.0), sizes)
    }

    /// The definition, pair by pair.
    fn by_all_pairs(p: &[[f32; 3]], q: &[[f32; 3]]) -> f64 {
        let squared = |a: &[f32; 3], b: &[f32; 3]| -> f64 {
            (0..3)
                .map(|k| (f64::from(a[k]) - f64::from(b[k])).powi(2))
                .sum()
        };
        let one_way = |from: &[[f32; 3]], to: &[[f32; 3]]| {
            let nearest = |a| {
                to.iter()
                    .map(|b| squared(a, b))
                    .fold(f64::INFINITY, f64::min)
            };
            from.iter().map(nearest).sum::<f64>() / from.len() as f64
        };
        one_way(p, q) + one_way(q, p)
    }

    #[test]
    fn chamfer_of_equal_clouds_is_zero() {
        let p = [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.1, 0.2, 0.3]];
        assert_eq!(chamfer(&p, &p), Ok(0.0));
    }

    #[test]
    fn chamfer_of_two_points_is_twice_their_squared_distance() {
        assert_eq!(chamfer(&[[0.0, 0.0, 0.0]], &[[1.0, 2.0, 2.0]]), Ok(18.0));
    }

    #[test]
    fn chamfer_averages_over_each_cloud_by_its_own_size() {
        let p = [[0.0, 0.0, 0.0]];
        let q = [[1.0, 0.0, 0.0], [0.0, 3.0, 0.0]];
        assert_eq!(chamfer(&p, &q), Ok(1.0 + (1.0 + 9.0) / 2.0));
    }

    #[test]
    fn chamfer_names_the_cloud_at_fault() {
        let good = [[0.0; 3]; 2];
        assert_eq!(
            chamfer(&good, &[]),
            Err(MetricError::EmptyCloud { side: Side::Second })
        );
        let bad = [[0.0; 3], [0.0, f32::INFINITY, 0.0]];
        let error = MetricError::NonFinite {
            side: Side::First,
            index: 1,
            point: bad[1],
        };
        assert_eq!(chamfer(&bad, &good), Err(error));
        assert_eq!(
            error.to_string(),
            "point 1 of the first cloud is [0.0, inf, 0.0] m; coordinates must be finite"
        );
    }

    proptest! {
        #[test]
        fn chamfer_is_its_definition(p in cloud(1..300), q in cloud(1..300)) {
            let expected = by_all_pairs(&p, &q);
            prop_assert!((chamfer(&p, &q).unwrap() - expected).abs() <= 1e-14 * expected.max(1.0));
        }

        #[test]
        fn chamfer_of_clouds_far_apart_is_its_definition(
            p in cloud(1..300),
            q in cloud(1..300),
            shift in prop::array::uniform3(-30.0f32..30.0),
        ) {
            let q: Vec<_> = q.iter().map(|y| [0, 1, 2].map(|k| y[k] + shift[k])).collect();
            let expected = by_all_pairs(&p, &q);
            prop_assert!((chamfer(&p, &q).unwrap() - expected).abs() <= 1e-14 * expected.max(1.0));
        }

        #[test]
        fn chamfer_is_symmetric(p in cloud(1..60), q in cloud(1..60)) {
            prop_assert_eq!(chamfer(&p, &q), chamfer(&q, &p));
        }
    }
}
