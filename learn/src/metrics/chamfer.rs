//! Chamfer distance.

use super::kdtree::KdTree;
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
    // Points in tree order are neighbours, so the last answer is a tight first guess of the next.
    let mut nearest = 0;
    let mut sum = 0.0;
    for x in from.points() {
        let (slot, squared) = to.nearest(x, nearest);
        nearest = slot;
        sum += squared;
    }
    sum / from.len() as f64
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cloud(sizes: std::ops::Range<usize>) -> impl Strategy<Value = Vec<[f32; 3]>> {
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
