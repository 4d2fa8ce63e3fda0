//! Clouds whose points are moved along their surface, so that they cover it more evenly.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::kdtree::KdTree;
use super::{MetricError, NEIGHBOURS, Side, checked, neighbourhoods};

/// How often points are moved, and by what share of what their neighbours ask for.
const TIMES: usize = 5;
const SHARE: f64 = 0.5;

/// How far points repel each other, in radii of the discs of which as many as there are points fill the plane.
const REACH: f64 = 2.5;

/// The largest move at a time, as a share of `r`: points at one place would be thrown far apart.
const LARGEST: f64 = 0.25;

/// The surface about a point, as its 16 nearest tell it, the point itself among them.
struct Neighbourhood {
    /// The others, by slot.
    others: [usize; NEIGHBOURS - 1],
    /// How far they repel it (m).
    reach: f64,
    /// Projects on the tangent plane, times how plane the neighbourhood is.
    tangent: Matrix3<f64>,
}

/// `points` (m), each moved along the surface away from those that crowd it, five times.
///
/// A point moves by `P r / 2 sum_j (1 - d_j / r) u_j`, the sum over those of its 15 nearest at distances `d_j` below `r` in
/// directions `u_j` from them, projected on the plane that fits the 16 best, and by no more than `r / 4`. Here
/// `r = 2.5 sqrt(A / (2 sqrt(3)))` with the area `A` that each of the 16 has, and `P = (l2 - l3) / l1` is the planarity of the
/// 16 (Demantké et al., ISPRS Archives XXXVIII-5/W12, 2011), from the eigenvalues `l1 >= l2 >= l3` of their covariance matrix: points on a
/// wire or within a body, which have no plane to move on, hardly move. Nearest points and planes are those of `points`.
///
/// After sample elimination ([`evenly_spread`](super::evenly_spread)) it takes a quarter off the mean squared distance of a plane's
/// places from the nearest point; what is twice as dense nearly stays so.
///
/// # Errors
/// Fewer than 16 points, or a coordinate that is not finite.
pub fn relaxed(points: &[[f32; 3]]) -> Result<Vec<[f32; 3]>, MetricError> {
    let tree = KdTree::new(&checked(points, Side::First)?);
    let surface: Vec<_> = neighbourhoods(&tree, tree.points(), Side::First)?
        .enumerate()
        .map(|(slot, nearest)| Neighbourhood::new(&tree, slot, nearest))
        .collect();
    let mut places: Vec<_> = tree.points().iter().map(|&x| Vector3::from(x)).collect();
    for _ in 0..TIMES {
        let moved = surface.par_iter().zip(&places);
        places = moved
            .map(|(around, x)| x + around.push(x, &places))
            .collect();
    }
    let mut relaxed = vec![[0.0; 3]; points.len()];
    for (place, &index) in places.iter().zip(tree.order()) {
        relaxed[index] = place.map(|x| x as f32).into();
    }
    Ok(relaxed)
}

impl Neighbourhood {
    /// Of the point in `slot`, from its nearest by squared distance.
    fn new(tree: &KdTree, slot: usize, nearest: [(f64, usize); NEIGHBOURS]) -> Self {
        // At one place with more than 16 others it may be none of the nearest: the last stands for it then.
        let own = (nearest.iter().position(|&(_, other)| other == slot)).unwrap_or(NEIGHBOURS - 1);
        let others = std::array::from_fn(|k| nearest[k + usize::from(k >= own)].1);
        let area = PI * nearest[NEIGHBOURS - 1].0 / (NEIGHBOURS - 1) as f64;
        Self {
            others,
            reach: REACH * (area / (2.0 * 3.0_f64.sqrt())).sqrt(),
            tangent: tangent(nearest.map(|(_, other)| Vector3::from(tree.points()[other]))),
        }
    }

    /// How far the others, which are among `places`, push the point away that is at `x` (m).
    fn push(&self, x: &Vector3<f64>, places: &[Vector3<f64>]) -> Vector3<f64> {
        let pushes = self.others.iter().map(|&other| {
            let apart = x - places[other];
            let distance = apart.norm();
            if distance > 0.0 && distance < self.reach {
                apart * (1.0 / distance - 1.0 / self.reach)
            } else {
                Vector3::zeros()
            }
        });
        let push = self.tangent * pushes.sum::<Vector3<f64>>() * SHARE;
        push.cap_magnitude(LARGEST) * self.reach
    }
}

/// The projection on the plane that fits `points` best, times their planarity; zero where they are at one place.
fn tangent(points: [Vector3<f64>; NEIGHBOURS]) -> Matrix3<f64> {
    let mean = points.iter().sum::<Vector3<f64>>() / NEIGHBOURS as f64;
    let covariance: Matrix3<f64> = (points.iter())
        .map(|x| (x - mean) * (x - mean).transpose())
        .sum();
    let eigen = covariance.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let [first, second, third] = order.map(|k| eigen.eigenvalues[k]);
    if first <= 0.0 {
        return Matrix3::zeros();
    }
    let normal = eigen.eigenvectors.column(order[2]);
    let planarity = ((second - third) / first).clamp(0.0, 1.0);
    (Matrix3::identity() - normal * normal.transpose()) * planarity
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::super::{evenly_spread, nearest_distances};
    use super::*;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::f64::consts::TAU;

    /// `n` points, `m` of which sample elimination leaves.
    fn spread(
        n: usize,
        m: usize,
        seed: u64,
        point: impl Fn(f32, f32) -> [f32; 3],
    ) -> Vec<[f32; 3]> {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        let drawn: Vec<_> = (0..n).map(|_| point(rng.random(), rng.random())).collect();
        let kept = evenly_spread(&drawn, m).unwrap();
        kept.into_iter().map(|k| drawn[k]).collect()
    }

    fn plane(u: f32, v: f32) -> [f32; 3] {
        [u, v, 0.5 * u]
    }

    /// Mean squared distance (m^2) of places of the plane, away from its edges, from the points.
    fn missed(points: &[[f32; 3]]) -> f64 {
        let rng = &mut ChaCha8Rng::seed_from_u64(9);
        let mut place = || rng.random_range(0.1..0.9);
        let places: Vec<_> = (0..20_000).map(|_| plane(place(), place())).collect();
        let distances = nearest_distances(&places, points).unwrap();
        distances.iter().map(|d| d * d).sum::<f64>() / places.len() as f64
    }

    #[test]
    fn a_plane_is_covered_better_and_not_left() {
        let points = spread(4500, 3000, 1, plane);
        let moved = relaxed(&points).unwrap();
        let share = missed(&moved) / missed(&points);
        assert!(share < 0.8, "{share}");
        let off = moved.iter().map(|[u, _, w]| (w - 0.5 * u).abs());
        assert!(off.fold(0.0, f32::max) < 1e-6);
    }

    /// On a robot 40 mm thick 10,000 points leave the surface by far less than what they are apart.
    #[test]
    fn a_cylinder_is_hardly_left() {
        let cylinder = |u: f32, v: f32| {
            let (sine, cosine) = (f64::from(u) * TAU).sin_cos();
            [0.02 * cosine as f32, 0.02 * sine as f32, 0.1 * v]
        };
        let moved = relaxed(&spread(6000, 4000, 2, cylinder)).unwrap();
        let off = moved.iter().map(|&[x, y, _]| f64::from(x.hypot(y)) - 0.02);
        let rms = (off.map(|d| d * d).sum::<f64>() / moved.len() as f64).sqrt();
        assert!(rms < 3e-5, "{rms}");
    }

    #[test]
    fn where_points_are_twice_as_dense_they_nearly_stay_so() {
        let dense = |u: f32| {
            if u < 2.0 / 3.0 {
                0.75 * u
            } else {
                1.5 * u - 0.5
            }
        };
        let points = spread(4500, 3000, 3, |u, v| plane(dense(u), v));
        let left =
            |points: &[[f32; 3]]| points.iter().filter(|point| point[0] < 0.5).count() as f64;
        let moved = relaxed(&points).unwrap();
        let change = left(&moved) / left(&points);
        assert!((change - 1.0).abs() < 0.01, "{change}");
    }

    #[test]
    fn points_on_a_wire_stay() {
        let wire = spread(300, 200, 4, |u, _| [u, 2.0 * u, 0.3]);
        for (moved, point) in relaxed(&wire).unwrap().iter().zip(&wire) {
            assert!((0..3).all(|k| (moved[k] - point[k]).abs() < 1e-6));
        }
    }

    #[test]
    fn threads_do_not_matter() {
        let points = spread(3000, 2000, 5, plane);
        let [one, three] = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            pool.build().unwrap().install(|| relaxed(&points).unwrap())
        });
        assert_eq!(one, three);
    }

    #[test]
    fn clouds_without_neighbourhoods_are_refused() {
        assert!(relaxed(&[[0.0; 3]; 15]).is_err());
        assert!(relaxed(&[[f32::NAN; 3]; 20]).is_err());
        assert_eq!(relaxed(&[[0.25; 3]; 40]).unwrap(), [[0.25; 3]; 40]);
    }

    proptest! {
        /// Five times a quarter of `r`, which is 0.615 of the distance of the 15th neighbour.
        #[test]
        fn no_point_leaves_its_neighbours(
            points in prop::collection::vec(prop::array::uniform3(-1.0f32..1.0), 16..60),
            flat in prop::bool::ANY,
        ) {
            let points: Vec<_> = points.iter().map(|&[x, y, z]| [x, y, if flat { 0.0 } else { z }]).collect();
            for (moved, point) in relaxed(&points).unwrap().iter().zip(&points) {
                let far = |other: &[f32; 3]| {
                    (0..3).map(|k| f64::from(other[k] - point[k]).powi(2)).sum::<f64>().sqrt()
                };
                let mut distances: Vec<_> = points.iter().map(far).collect();
                distances.sort_by(f64::total_cmp);
                prop_assert!(far(moved) <= 0.77 * distances[NEIGHBOURS - 1] + 1e-6);
            }
        }
    }
}
