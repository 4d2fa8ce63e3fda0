//! Difference of colours.

use super::kdtree::KdTree;
use super::{MetricError, Side, checked};

/// Points (m) with the colour of each (8-bit RGB), as many of one as of the other.
pub type Colored<'a> = (&'a [[f32; 3]], &'a [[u8; 3]]);

/// Mean absolute colour difference, in [0, 1]: over the points of `p` and the channels, between a point's colour and that
/// of the point of `q` nearest to it. A point with several nearest ones takes the colour of one of them.
///
/// # Errors
/// An empty cloud, or a coordinate that is not finite.
///
/// # Panics
/// Where a cloud has more or fewer colours than points.
pub fn color_error(p: Colored, q: Colored) -> Result<f64, MetricError> {
    let points = checked(p.0, Side::First)?;
    let tree = KdTree::new(&checked(q.0, Side::Second)?);
    for (points, colors) in [p, q] {
        assert_eq!(points.len(), colors.len(), "one colour per point");
    }
    let mut guess = 0;
    let mut sum = 0;
    for (point, color) in points.iter().zip(p.1) {
        (guess, _) = tree.nearest(point, guess);
        let nearest = q.1[tree.order()[guess]];
        let channels = color.iter().zip(nearest);
        sum += channels.map(|(a, b)| u64::from(a.abs_diff(b))).sum::<u64>();
    }
    Ok(sum as f64 / (255 * 3 * points.len()) as f64)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    type Cloud = (Vec<[f32; 3]>, Vec<[u8; 3]>);

    fn cloud(sizes: std::ops::Range<usize>) -> impl Strategy<Value = Cloud> {
        let point = (prop::array::uniform3(-1.0f32..1.0), any::<[u8; 3]>());
        prop::collection::vec(point, sizes).prop_map(|points| points.into_iter().unzip())
    }

    /// The definition, pair by pair.
    fn by_all_pairs(p: &Cloud, q: &Cloud) -> f64 {
        let squared = |a: &[f32; 3], b: &[f32; 3]| -> f64 {
            (0..3)
                .map(|k| (f64::from(a[k]) - f64::from(b[k])).powi(2))
                .sum()
        };
        let difference = |(point, color): (&[f32; 3], &[u8; 3])| -> f64 {
            let distance = |k: &usize| squared(point, &q.0[*k]);
            let order = |a: &usize, b: &usize| distance(a).total_cmp(&distance(b));
            let nearest = q.1[(0..q.0.len()).min_by(order).unwrap()];
            let channel = |k: usize| (f64::from(color[k]) - f64::from(nearest[k])).abs() / 255.0;
            (0..3).map(channel).sum::<f64>() / 3.0
        };
        p.0.iter().zip(&p.1).map(difference).sum::<f64>() / p.0.len() as f64
    }

    proptest! {
        #[test]
        fn the_nearest_point_of_the_other_cloud_tells_the_colour(p in cloud(1..80), q in cloud(1..80)) {
            let error = color_error((&p.0, &p.1), (&q.0, &q.1)).unwrap();
            prop_assert!((error - by_all_pairs(&p, &q)).abs() < 1e-12);
            prop_assert!((0.0..=1.0).contains(&error));
        }
    }

    #[test]
    fn black_and_white_differ_by_one() {
        let points = [[0.0; 3]];
        let error = |a, b| color_error((&points, &[a]), (&points, &[b])).unwrap();
        assert_eq!(error([0; 3], [255; 3]), 1.0);
        assert_eq!(error([10, 20, 30], [10, 20, 30]), 0.0);
        assert_eq!(error([51, 0, 0], [0; 3]), 0.2 / 3.0);
    }

    #[test]
    fn an_empty_cloud_has_no_colour_error() {
        let error = color_error((&[], &[]), (&[[0.0; 3]], &[[0; 3]])).unwrap_err();
        assert_eq!(error, MetricError::EmptyCloud { side: Side::First });
    }
}
