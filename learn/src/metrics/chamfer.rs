//! Chamfer distance.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::kdtree::{KdTree, LEAF_CAPACITY};
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
///
/// The points of a leaf search together: one descent for all, and their distances to a point in the
/// lanes of vector registers.
fn mean_squared_distance(from: &KdTree, to: &KdTree) -> f64 {
    let arch = Arch::new();
    let mut sum = 0.0;
    for leaf in from.leaves() {
        let points = &from.points()[from.slots(leaf)];
        let mut group = Group::of(points);
        let mut limit = f64::INFINITY;
        let mut scan = |slots: Range<usize>, limit: &mut f64| {
            *limit = arch.dispatch(Approach {
                group: &mut group,
                points: &to.points()[slots],
            });
        };
        // Where boxes overlap, their distances do not tell which half is the better one to begin with.
        scan(
            to.slots(to.leaf_near(&points[points.len() / 2])),
            &mut limit,
        );
        let aabb = &from.boxes()[leaf];
        let bound = |node: usize| to.boxes()[node].squared_gap(aabb);
        to.descend(1, &mut limit, &bound, &mut scan);
        sum += group.squared[..points.len()].iter().sum::<f64>();
    }
    sum / from.len() as f64
}

/// Points of a leaf, axis by axis (m), and their squared distances (m^2) to the nearest point met so
/// far. Where the leaf has fewer points, its last one is repeated.
struct Group {
    axes: [[f64; LEAF_CAPACITY]; 3],
    squared: [f64; LEAF_CAPACITY],
}

impl Group {
    fn of(points: &[[f64; 3]]) -> Self {
        let last = points.len() - 1;
        Self {
            axes: [0, 1, 2].map(|axis| std::array::from_fn(|k| points[k.min(last)][axis])),
            squared: [f64::INFINITY; LEAF_CAPACITY],
        }
    }
}

/// Lets a group meet some points (m); the outcome is the largest squared distance left (m^2).
struct Approach<'a> {
    group: &'a mut Group,
    points: &'a [[f64; 3]],
}

impl WithSimd for Approach<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Group { axes, squared } = self.group;
        let mut least = *squared;
        for y in self.points {
            for k in 0..LEAF_CAPACITY {
                let (dx, dy, dz) = (axes[0][k] - y[0], axes[1][k] - y[1], axes[2][k] - y[2]);
                let squared = dx * dx + dy * dy + dz * dz;
                least[k] = if squared < least[k] {
                    squared
                } else {
                    least[k]
                };
            }
        }
        *squared = least;
        let mut half = LEAF_CAPACITY / 2;
        while half > 0 {
            for k in 0..half {
                least[k] = if least[k] > least[k + half] {
                    least[k]
                } else {
                    least[k + half]
                };
            }
            half /= 2;
        }
        least[0]
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
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
        fn chamfer_is_its_definition(p in cloud(1..60), q in cloud(1..60)) {
            let expected = by_all_pairs(&p, &q);
            prop_assert!((chamfer(&p, &q).unwrap() - expected).abs() <= 1e-14 * expected.max(1.0));
        }

        #[test]
        fn chamfer_is_symmetric(p in cloud(1..60), q in cloud(1..60)) {
            prop_assert_eq!(chamfer(&p, &q), chamfer(&q, &p));
        }
    }
}
