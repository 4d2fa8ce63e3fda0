//! Where a part of one cloud lies in another.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::kdtree::KdTree;
use super::{MetricError, Side, checked};

/// Mean square (m²) of the points' moves below which a motion has been found: moves of 0.1 um.
const STILL: f64 = 1e-14;
/// Steps at the most.
const STEPS: usize = 200;

/// The rigid motion (m) that lays the points of `p` (m) onto the cloud `q` (m), sought from the motion `start`: iterated
/// closest points (Besl and McKay, IEEE PAMI 14, 1992). Each step takes the nearest points of `q` to the moved points, and
/// the motion that brings `p` closest to those, which never increases the mean square distance.
///
/// A local minimum is found, near `start`, to about half the distance between points of `q`, on which those of `p` catch. Where `p` can slide in the surface of `q`, as the wall of a tube without its end
/// can, the motion along it stays about what it is at the start.
///
/// # Errors
/// An empty cloud, or a coordinate that is not finite.
pub fn lay_onto(
    p: &[[f32; 3]],
    q: &[[f32; 3]],
    start: Isometry3<f64>,
) -> Result<Isometry3<f64>, MetricError> {
    let p = checked(p, Side::First)?;
    let q = KdTree::new(&checked(q, Side::Second)?);
    let p: Vec<Point3<f64>> = p.into_iter().map(Point3::from).collect();
    let mut motion = start;
    for _ in 0..STEPS {
        let mut guess = 0;
        let nearest = p.iter().map(|point| {
            let moved = (motion * point).into();
            guess = q.nearest(&moved, guess).0;
            Point3::from(q.points()[guess])
        });
        let nearest: Vec<Point3<f64>> = nearest.collect();
        let next = rigid_motion(&p, &nearest);
        let moves = p
            .iter()
            .map(|point| (next * point - motion * point).norm_squared());
        let still = moves.sum::<f64>() < STILL * p.len() as f64;
        motion = next;
        if still {
            break;
        }
    }
    Ok(motion)
}

/// The rigid motion that brings points `from` closest to their partners `to`, in the mean square (Kabsch, Acta
/// Crystallographica A 32, 1976).
///
/// # Panics
/// For lists of different lengths, and without points.
pub fn rigid_motion(from: &[Point3<f64>], to: &[Point3<f64>]) -> Isometry3<f64> {
    assert!(from.len() == to.len() && !from.is_empty(), "partners");
    let mean = |points: &[Point3<f64>]| {
        points
            .iter()
            .map(|point| point.coords)
            .sum::<Vector3<f64>>()
            / points.len() as f64
    };
    let [centre, target] = [mean(from), mean(to)];
    let pairs = from.iter().zip(to);
    let covariance: Matrix3<f64> = pairs
        .map(|(a, b)| (a.coords - centre) * (b.coords - target).transpose())
        .sum();
    let svd = covariance.svd(true, true);
    let rotation = match (svd.u, svd.v_t) {
        (Some(u), Some(v_t)) => {
            // The least singular value's axis is turned around where that makes a rotation of a reflection.
            let sign = (v_t.transpose() * u.transpose()).determinant().signum();
            let turned = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign));
            let matrix = v_t.transpose() * turned * u.transpose();
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
        }
        _ => UnitQuaternion::identity(),
    };
    Isometry3::from_parts(Translation3::from(target - rotation * centre), rotation)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    /// Points on the wall and the upper end of a tube along z: radius 20 mm, up to the height 0.
    fn tube(phase: f64) -> Vec<[f32; 3]> {
        let mut points = Vec::new();
        // Even and without rows on which another cloud's points would catch (Roberts' sequence, 2018).
        for k in 0..3600 {
            let share = |step: f64| (phase + step * f64::from(k)).fract();
            let (sin, cos) = (std::f64::consts::TAU * share(0.754_877_666)).sin_cos();
            points.push([0.02 * cos, 0.02 * sin, -0.12 * share(0.569_840_291)].map(|x| x as f32));
        }
        for k in 0..300 {
            // Sunflower points (Vogel, 1979).
            let (radius, angle) = (
                0.02 * (f64::from(k) / 300.0).sqrt(),
                2.4 * f64::from(k) + phase,
            );
            points.push([radius * angle.cos(), radius * angle.sin(), 0.0].map(|x| x as f32));
        }
        points
    }

    #[test]
    fn the_end_of_a_tube_is_found_where_it_went() {
        let end: Vec<_> = tube(0.5).into_iter().filter(|p| p[2] > -0.017).collect();
        for (shift, turn) in [
            ([0.0, 0.0, 0.004], [0.0; 3]),
            ([0.003, -0.002, -0.003], [0.1, 0.0, 0.0]),
            ([0.006, 0.0, 0.0], [0.0, -0.2, 0.0]),
        ] {
            let moved = Isometry3::new(Vector3::from(shift), Vector3::from(turn));
            let there: Vec<[f32; 3]> = (tube(0.0).iter())
                .map(|p| {
                    (moved * Point3::from(p.map(f64::from)))
                        .map(|x| x as f32)
                        .into()
                })
                .collect();
            let found = lay_onto(&end, &there, Isometry3::identity()).unwrap();
            let [tip, expected] = [found, moved].map(|motion| motion * Point3::origin());
            // Half of the points' distance.
            assert!((tip - expected).norm() < 1e-3, "{moved:?}: {found:?}");
        }
    }

    #[test]
    fn a_rigid_motion_is_found_from_pairs_of_points() {
        let motion = Isometry3::new(Vector3::new(0.3, -2.0, 1.0), Vector3::new(0.5, 1.5, -0.4));
        // In space, and in a plane, where a reflection would do as well.
        for height in [1.0, 0.0] {
            let from: Vec<Point3<f64>> = (0..9)
                .map(|k| {
                    let k = f64::from(k);
                    Point3::new(k.sin(), (2.3 * k).cos(), height * (1.7 * k).sin())
                })
                .collect();
            let to: Vec<Point3<f64>> = from.iter().map(|point| motion * point).collect();
            let found = rigid_motion(&from, &to);
            assert!((found.to_homogeneous() - motion.to_homogeneous()).norm() < 1e-12);
        }
    }
}
