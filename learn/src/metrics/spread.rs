//! How far points lie scattered about the surface that they sample: the uncertainty of a prediction.
//!
//! In a flow on single points, clouds from other noise differ as one cloud's points do, and no point has a partner in another
//! cloud to differ from. But the true surface has no thickness, so points before and behind it are points that the network is
//! unsure of: uncertainty is spread normal to the surface. `tdcr eval` compares it with the errors of each network that it
//! scores: for the demo's, the rank correlation with the distance from the true cloud is 0.16 over the points of a command, and
//! with the Chamfer distance 0.70 over the commands. It is no error bar: the edges of a true cloud have some too, and a cloud
//! that is shifted as a whole has none for that.

use rayon::prelude::*;

use super::kdtree::KdTree;
use super::{MetricError, NEIGHBOURS, Side, checked, neighbourhoods};

/// Numbers that a plane is told by, each of which takes a degree of freedom from the residuals.
const PLANE_PARAMETERS: usize = 3;

/// The spread (m) of `pool` normal to its surface, at each of `points` (m): the standard deviation of the 16 points of
/// `pool` nearest to it from the plane that fits them best,
/// `sqrt(16 lambda / (16 - 3))` with the least eigenvalue `lambda` of their covariance matrix.
///
/// It is zero on a plane. On a cylinder of radius `R` that is sampled densely, so that the 16 lie within `r`, it is
/// about `r^2 / (8 R)`; at edges it grows to the size of the neighbourhood. It is no larger than the neighbourhood,
/// so layers further apart than that are not seen as one spread.
///
/// # Errors
/// A pool of fewer than 16 points, or a coordinate that is not finite.
pub fn surface_spread(points: &[[f32; 3]], pool: &[[f32; 3]]) -> Result<Vec<f32>, MetricError> {
    let points = checked(points, Side::First)?;
    let pool = KdTree::new(&checked(pool, Side::Second)?);
    let spread = |nearest: [_; NEIGHBOURS]| {
        deviation_from_plane(&nearest.map(|(_, slot)| pool.points()[slot])) as f32
    };
    let nearest = neighbourhoods(&pool, &points, Side::Second)?;
    Ok(nearest.map(spread).collect())
}

/// How alone each of `points` (m) is: its mean distance (m) from the 15 others nearest to it.
///
/// # Errors
/// Fewer than 16 points, or a coordinate that is not finite.
pub fn isolation(points: &[[f32; 3]]) -> Result<Vec<f32>, MetricError> {
    let points = checked(points, Side::First)?;
    let mean_distance = |nearest: [(f64, _); NEIGHBOURS]| {
        let sum: f64 = nearest.iter().map(|(squared, _)| squared.sqrt()).sum();
        // The point itself is one of them, at no distance.
        (sum / (NEIGHBOURS - 1) as f64) as f32
    };
    let tree = KdTree::new(&points);
    let nearest = neighbourhoods(&tree, &points, Side::First)?;
    Ok(nearest.map(mean_distance).collect())
}

/// Standard deviation (m) of points from the plane that fits them best.
fn deviation_from_plane(points: &[[f64; 3]]) -> f64 {
    let mean = [0, 1, 2].map(|k| points.iter().map(|p| p[k]).sum::<f64>() / points.len() as f64);
    let mut scatter = [[0.0; 3]; 3];
    for point in points {
        let offset = [0, 1, 2].map(|k| point[k] - mean[k]);
        for (row, x) in scatter.iter_mut().zip(offset) {
            row.iter_mut().zip(offset).for_each(|(s, y)| *s += x * y);
        }
    }
    let freedom = points.len() - PLANE_PARAMETERS;
    (least_eigenvalue(&scatter) / freedom as f64)
        .max(0.0)
        .sqrt()
}

/// Least eigenvalue of a symmetric matrix, in closed form (Smith, Communications of the ACM 4, 1961).
fn least_eigenvalue(a: &[[f64; 3]; 3]) -> f64 {
    let third = (a[0][0] + a[1][1] + a[2][2]) / 3.0;
    let [x, y, z] = [0, 1, 2].map(|k| a[k][k] - third);
    let [u, v, w] = [a[0][1], a[0][2], a[1][2]];
    // `p^2` is a sixth of the squared norm of `A - third I`, and `determinant` that matrix's.
    let p = ((x * x + y * y + z * z + 2.0 * (u * u + v * v + w * w)) / 6.0).sqrt();
    if p == 0.0 {
        return third;
    }
    let determinant = x * (y * z - w * w) - u * (u * z - v * w) + v * (u * w - v * y);
    let angle = (0.5 * determinant / (p * p * p)).clamp(-1.0, 1.0).acos() / 3.0;
    third + 2.0 * p * (angle + std::f64::consts::TAU / 3.0).cos()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::seq::SliceRandom;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::f64::consts::TAU;

    type Cloud = Vec<[f32; 3]>;

    fn draw(n: usize, seed: u64, mut point: impl FnMut(&mut ChaCha8Rng) -> [f64; 3]) -> Cloud {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| point(rng).map(|x| x as f32)).collect()
    }

    /// A square of 0.1 m, `thickness` (m) thick, turned out of the axes.
    fn slab(thickness: f64, seed: u64) -> Cloud {
        draw(10_000, seed, |rng| {
            let [u, v, w] = [0.1, 0.1, thickness].map(|size| size * rng.random::<f64>());
            // The columns are orthogonal, each 3 long; the last is normal to the slab.
            let frame = [[2.0, -2.0, 1.0], [1.0, 2.0, 2.0], [2.0, 1.0, -2.0]];
            frame.map(|[a, b, c]| (a * u + b * v + c * w) / 3.0)
        })
    }

    /// The side of a cylinder of a robot's radius, 0.1 m long.
    fn cylinder() -> Cloud {
        draw(8_000, 2, |rng| {
            let angle = TAU * rng.random::<f64>();
            [
                0.02 * angle.cos(),
                0.02 * angle.sin(),
                0.1 * rng.random::<f64>(),
            ]
        })
    }

    fn own_spread(cloud: &Cloud) -> Vec<f32> {
        surface_spread(cloud, cloud).unwrap()
    }

    fn mean_square(values: &[f32]) -> f64 {
        let squares = values.iter().map(|x| f64::from(*x).powi(2));
        squares.sum::<f64>() / values.len() as f64
    }

    #[test]
    fn a_plane_has_no_spread() {
        // Single precision puts the points themselves up to 1e-8 m beside the plane.
        assert!(
            own_spread(&slab(0.0, 1))
                .iter()
                .all(|spread| *spread < 2e-8)
        );
    }

    #[test]
    fn a_slab_has_the_deviation_of_its_thickness() {
        let thickness = 5e-4;
        let expected = thickness * thickness / 12.0;
        let found = mean_square(&own_spread(&slab(thickness, 1)));
        assert!(
            (found / expected - 1.0).abs() < 0.02,
            "{}",
            found / expected
        );
    }

    #[test]
    fn a_cylinder_has_the_spread_that_its_curvature_makes() {
        // 16 of the points fill a disc of radius `r`, where `x^2 / (2 R)` has the deviation `r^2 / (8 R)`.
        let area = 16.0 * TAU * 0.02 * 0.1 / 8_000.0;
        let expected = area / (TAU / 2.0) / (8.0 * 0.02);
        let mut spread = own_spread(&cylinder());
        spread.sort_by(f32::total_cmp);
        let median = f64::from(spread[spread.len() / 2]);
        assert!(median < 1e-4, "{median}");
        assert!(
            (median / expected - 1.0).abs() < 0.25,
            "{median} of {expected}"
        );
    }

    #[test]
    fn samples_that_lie_apart_spread_by_half_their_distance() {
        let (first, second) = (slab(0.0, 1), slab(0.0, 3));
        let apart: Cloud = second.iter().map(|[x, y, z]| [*x, *y, z + 6e-4]).collect();
        let spread = |other: Cloud| {
            let pool = [first.clone(), other].concat();
            mean_square(&surface_spread(&first, &pool).unwrap()).sqrt()
        };
        assert!(spread(second) < 2e-8);
        // The shift has two thirds of its length along the normal.
        let expected = 0.5 * 6e-4 * 2.0 / 3.0;
        assert!((spread(apart) / expected - 1.0).abs() < 0.05);
    }

    #[test]
    fn the_order_of_points_does_not_matter() {
        let cloud = cylinder();
        let mut order: Vec<usize> = (0..cloud.len()).collect();
        order.shuffle(&mut ChaCha8Rng::seed_from_u64(4));
        let spread = own_spread(&cloud);
        let shuffled: Cloud = order.iter().map(|&k| cloud[k]).collect();
        let expected: Vec<f32> = order.iter().map(|&k| spread[k]).collect();
        assert_eq!(own_spread(&shuffled), expected);
    }

    #[test]
    fn threads_do_not_matter() {
        let cloud = cylinder();
        let [one, three] = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            pool.build().unwrap().install(|| own_spread(&cloud))
        });
        assert_eq!(one, three);
    }

    #[test]
    fn too_few_points_have_no_spread() {
        let cloud = vec![[0.0; 3]; 15];
        let error = surface_spread(&cloud, &cloud).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the second cloud holds 15 points, expected at least 16"
        );
        assert_eq!(surface_spread(&cloud, &[[1.0; 3]; 16]).unwrap(), [0.0; 15]);
    }

    proptest! {
        /// The characteristic polynomial vanishes there, and `A - lambda I` has no negative eigenvalue.
        #[test]
        fn the_least_eigenvalue_is_that_of_the_matrix_it_was_made_of(
            eigenvalues in prop::array::uniform3(0.0f64..1.0),
            [a, b] in prop::array::uniform2(0.0..TAU),
        ) {
            let turn = |angle: f64| (angle.cos(), angle.sin());
            let ((c, s), (d, t)) = (turn(a), turn(b));
            // Rows of a rotation about z and then x.
            let rotation = [[c, -s, 0.0], [d * s, d * c, -t], [t * s, t * c, d]];
            let matrix = rotation.map(|p| {
                rotation.map(|q| (0..3).map(|k| p[k] * eigenvalues[k] * q[k]).sum::<f64>())
            });
            let mut eigenvalues = eigenvalues;
            eigenvalues.sort_by(f64::total_cmp);
            let [least, middle, _] = eigenvalues;
            // Where the two least are close, the angle is the arc cosine of nearly 1, and loses digits.
            let most = 1e-14f64.max(1e-15 / (middle - least).max(1e-8));
            prop_assert!((least_eigenvalue(&matrix) - least).abs() < most);
        }
    }
}
