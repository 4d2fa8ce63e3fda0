//! The pose of a board from one image of it.
//!
//! A homography between the board's plane and the undistorted image gives a first pose (Hartley and Zisserman, Multiple View
//! Geometry, 2nd edition, alg. 4.2 and sec. 8.1.1), by random sample consensus so that wrong corners do no harm; least squares
//! on the reprojection errors refine it. A board seen from far away looks nearly the same when it is mirrored across the plane
//! through its centre that faces the camera (Schweighofer and Pinz, Robust pose estimation from a planar target, 2006): both
//! poses are tried.

use nalgebra::{
    DMatrix, Isometry3, Matrix2, Matrix3, Point2, Point3, Rotation3, Translation3, UnitQuaternion,
    Vector2, Vector3,
};
use rand::SeedableRng;
use rand::seq::index::sample;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::camera::Intrinsics;

use super::adjust::{Fixed, Loss, Observation, Poses, adjust};

/// Samples of four corners: of corners a third of which are wrong, one in five samples has none.
const SAMPLES: usize = 60;
/// Farthest that a right corner is from where the homography of four others has it (pixels): noise of half a pixel, enlarged.
const NEAR: f64 = 4.0;
/// A second pose whose reprojection errors are at most so many times the first's may be the true one.
const CLEARLY_WORSE: f64 = 2.0;
/// Points are on a line that spread across it by less than this share of their spread along it: a board seen at half a degree.
const FLAT: f64 = 0.01;
/// Reprojection errors below this are all the same (pixels).
const NOISE: f64 = 0.05;

/// A board's pose from one image.
#[derive(Clone, Debug)]
pub(super) struct PlanarPose {
    /// Pose of the board in the camera's frame (m).
    pub pose: Isometry3<f64>,
    /// Variance of another camera's position that is known through this board (m²) per px² of noise.
    pub variance: f64,
}

/// Variances of poses that may be mirrored count so many times more.
const AMBIGUOUS: f64 = 1e4;

/// The pose of a board with corners at these points of its plane and these pixels; `None` where they do not determine one.
pub(super) fn planar_pose(
    intrinsics: &Intrinsics,
    corners: &[(Point3<f64>, Vector2<f64>)],
) -> Option<PlanarPose> {
    let plane: Vec<Point2<f64>> = corners.iter().map(|(point, _)| point.xy()).collect();
    let seen: Vec<Vector2<f64>> = corners
        .iter()
        .map(|(_, p)| intrinsics.normalised(p.x, p.y))
        .collect();
    let focal = intrinsics.fx.max(intrinsics.fy);
    let right = consensus(&plane, &seen, NEAR / focal)?;
    let pick = |index: &usize| (plane[*index], seen[*index]);
    let (on_plane, in_image): (Vec<_>, Vec<_>) = right.iter().map(pick).unzip();
    let first = decompose(&homography(&on_plane, &in_image)?)?;
    let centre = on_plane
        .iter()
        .fold(Vector2::zeros(), |sum, p| sum + p.coords)
        / on_plane.len() as f64;
    let second = mirrored(&first, &Point3::new(centre.x, centre.y, 0.0));
    let observations: Vec<Observation> = right
        .iter()
        .map(|&index| Observation {
            camera: 0,
            placement: 0,
            point: corners[index].0,
            pixel: corners[index].1,
        })
        .collect();
    let refine = |start: Isometry3<f64>| {
        let start = Poses {
            cameras: vec![Isometry3::identity()],
            placements: vec![start],
        };
        let fit = adjust(
            &[*intrinsics],
            &observations,
            start,
            Fixed::Cameras,
            Loss::Squares,
        )?;
        let rms = (fit.squares() / observations.len() as f64).sqrt();
        Some((rms, fit))
    };
    let mut found: Vec<_> = [first, second].into_iter().filter_map(refine).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (rms, best) = found.first()?;
    let pose = best.poses.placements[0];
    let other = found.get(1).is_some_and(|(second, fit)| {
        let apart = fit.poses.placements[0].rotation.angle_to(&pose.rotation) > 1e-3;
        apart && *second < CLEARLY_WORSE * rms.max(NOISE)
    });
    let covariance = best.placement_covariance(0)?;
    let distance = pose.translation.vector.norm();
    let variance =
        (0..3).map(|k| covariance[(k, k)] + distance.powi(2) * covariance[(k + 3, k + 3)]);
    let variance: f64 = variance.sum();
    Some(PlanarPose {
        pose,
        variance: if other {
            AMBIGUOUS * variance
        } else {
            variance
        },
    })
}

/// The corners that agree with one homography within `near` (normalised coordinates), at least four.
fn consensus(plane: &[Point2<f64>], seen: &[Vector2<f64>], near: f64) -> Option<Vec<usize>> {
    if plane.len() < 4 {
        return None;
    }
    // The same corners always give the same pose.
    let mut rng = ChaCha8Rng::seed_from_u64(plane.len() as u64);
    let mut best: Vec<usize> = Vec::new();
    for _ in 0..SAMPLES {
        let chosen = sample(&mut rng, plane.len(), 4).into_vec();
        let (points, images): (Vec<_>, Vec<_>) =
            chosen.iter().map(|&k| (plane[k], seen[k])).unzip();
        let Some(h) = homography(&points, &images) else {
            continue;
        };
        let agrees = |k: &usize| (map(&h, &plane[*k]) - seen[*k]).norm() < near;
        let right: Vec<usize> = (0..plane.len()).filter(agrees).collect();
        if right.len() > best.len() {
            best = right;
        }
        if best.len() == plane.len() {
            break;
        }
    }
    (best.len() >= 4).then_some(best)
}

fn map(h: &Matrix3<f64>, point: &Point2<f64>) -> Vector2<f64> {
    let p = h * point.to_homogeneous();
    p.xy() / p.z
}

/// The homography that maps points of the plane to image points, by the normalised direct linear transform; `None` where the
/// points are (almost) on a line.
fn homography(plane: &[Point2<f64>], seen: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let points: Vec<Vector2<f64>> = plane.iter().map(|p| p.coords).collect();
    let (from, to) = (normalising(&points)?, normalising(seen)?);
    let mut rows = DMatrix::zeros(2 * plane.len().max(5), 9);
    for (index, (point, image)) in plane.iter().zip(seen).enumerate() {
        let p = from * point.to_homogeneous();
        let q = to * image.push(1.0);
        for axis in 0..2 {
            for k in 0..3 {
                rows[(2 * index + axis, 3 * axis + k)] = p[k];
                rows[(2 * index + axis, 6 + k)] = -q[axis] * p[k];
            }
        }
    }
    let svd = rows.svd(false, true);
    // Two vanishing singular values: more than one homography fits.
    let mut order: Vec<usize> = (0..svd.singular_values.len()).collect();
    order.sort_by(|&a, &b| svd.singular_values[b].total_cmp(&svd.singular_values[a]));
    if svd.singular_values[order[7]] < 1e-6 * svd.singular_values[order[0]] {
        return None;
    }
    let null = svd.v_t?.row(order[8]).transpose();
    let h = Matrix3::from_row_iterator(null.iter().copied());
    Some(to.try_inverse()? * h * from)
}

/// The similarity that moves points to mean 0 and mean distance √2; `None` where they are (almost) on a line.
fn normalising(points: &[Vector2<f64>]) -> Option<Matrix3<f64>> {
    let count = points.len() as f64;
    let mean = points.iter().sum::<Vector2<f64>>() / count;
    let spread = points.iter().map(|p| (p - mean).norm()).sum::<f64>() / count;
    let about = |p: &Vector2<f64>| (p - mean) * (p - mean).transpose();
    let widths = points
        .iter()
        .map(about)
        .sum::<Matrix2<f64>>()
        .symmetric_eigenvalues();
    let spread_out = widths.min() > FLAT.powi(2) * widths.max();
    if !spread_out {
        return None;
    }
    let scale = 2f64.sqrt() / spread;
    let shift = -mean * scale;
    Some(Matrix3::new(
        scale, 0.0, shift.x, 0.0, scale, shift.y, 0.0, 0.0, 1.0,
    ))
}

/// The pose of a plane of which `h` is the image in normalised coordinates: its columns are, up to a factor, the plane's x and y
/// axes and its origin in the camera's frame.
fn decompose(h: &Matrix3<f64>) -> Option<Isometry3<f64>> {
    let scale = (h.column(0).norm() * h.column(1).norm()).sqrt();
    // The plane is before the camera.
    let h = h * (h[(2, 2)].signum() / scale);
    let (x, y) = (h.column(0).into_owned(), h.column(1).into_owned());
    let svd = Matrix3::from_columns(&[x, y, x.cross(&y)]).svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let rotation = Rotation3::from_matrix_unchecked(u * sign * v_t);
    let translation = Translation3::from(h.column(2).into_owned());
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    let finite = translation
        .vector
        .iter()
        .chain(rotation.coords.iter())
        .all(|x| x.is_finite());
    finite.then(|| Isometry3::from_parts(translation, rotation))
}

/// The pose that looks alike from far away: mirrored across the plane through the board's `centre` that faces the camera.
fn mirrored(pose: &Isometry3<f64>, centre: &Point3<f64>) -> Isometry3<f64> {
    let at = (pose * centre).coords;
    let sight = at.normalize();
    let mirror = Matrix3::identity() - 2.0 * sight * sight.transpose();
    let axes = pose.rotation.to_rotation_matrix();
    let (x, y) = (
        mirror * axes.matrix().column(0),
        mirror * axes.matrix().column(1),
    );
    let rotation = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let translation = at - rotation * centre.coords;
    Isometry3::from_parts(Translation3::from(translation), rotation)
}
