//! How far each point of a cloud is from another cloud.

use super::kdtree::KdTree;
use super::{MetricError, Side, checked};

/// Distance (m) of each point of `p` (m) from the nearest point of `q` (m).
///
/// # Errors
/// An empty cloud, or a coordinate that is not finite.
pub fn nearest_distances(p: &[[f32; 3]], q: &[[f32; 3]]) -> Result<Vec<f64>, MetricError> {
    let p = checked(p, Side::First)?;
    let q = KdTree::new(&checked(q, Side::Second)?);
    let mut guess = 0;
    let distances = p.iter().map(|x| {
        let (slot, squared) = q.nearest(x, guess);
        guess = slot;
        squared.sqrt()
    });
    Ok(distances.collect())
}

/// For each point of `p` (m), the index of the point of `q` (m) nearest to it; of points equally far, any.
///
/// # Errors
/// An empty cloud, or a coordinate that is not finite.
pub fn nearest_indices(p: &[[f32; 3]], q: &[[f32; 3]]) -> Result<Vec<usize>, MetricError> {
    let nearest = nearest_points::<1>(p, q)?;
    Ok(nearest.into_iter().map(|[index]| index).collect())
}

/// For each point of `p` (m), the indices of the `K` points of `q` (m) nearest to it, the nearest first; of points equally far, any.
///
/// # Errors
/// An empty cloud, a `q` of fewer than `K` points, or a coordinate that is not finite.
pub(crate) fn nearest_points<const K: usize>(
    p: &[[f32; 3]],
    q: &[[f32; 3]],
) -> Result<Vec<[usize; K]>, MetricError> {
    let p = checked(p, Side::First)?;
    let q = KdTree::new(&checked(q, Side::Second)?);
    if q.len() < K {
        return Err(MetricError::TooFew {
            side: Side::Second,
            found: q.len(),
            expected: K,
        });
    }
    let nearest = |x| (q.k_nearest::<K>(x)).map(|(_, slot)| q.order()[slot]);
    Ok(p.iter().map(nearest).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::super::chamfer;
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn distances_are_those_of_the_points_in_their_order() {
        let (p, q) = (
            [[9.0, 0.0, 0.0], [1.0, 2.0, 2.0]],
            [[0.0; 3], [9.0, 4.0, 0.0]],
        );
        assert_eq!(nearest_distances(&p, &q).unwrap(), [4.0, 3.0]);
    }

    proptest! {
        #[test]
        fn their_mean_squares_are_the_chamfer_distance(
            [p, q] in prop::array::uniform2(prop::collection::vec(prop::array::uniform3(-1.0f32..1.0), 1..60)),
        ) {
            let mean_square = |p: &[_], q: &[_]| {
                let distances = nearest_distances(p, q).unwrap();
                distances.iter().map(|d| d * d).sum::<f64>() / p.len() as f64
            };
            let found = mean_square(&p, &q) + mean_square(&q, &p);
            prop_assert!((found - chamfer(&p, &q).unwrap()).abs() < 1e-13);
        }
    }
}
