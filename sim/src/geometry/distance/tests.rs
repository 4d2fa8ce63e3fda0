use parry3d_f64::shape::{Ball, Capsule, Cuboid, Cylinder, Shape as Theirs};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

/// Step of central differences (m), and how far their errors may go.
const STEP: f64 = 1e-5;
const TOLERANCE: f64 = 1e-5;

/// Checks gradient and Hessian of a distance against central differences at points where it is smooth: where the normal changes over
/// a step by no more than its curvature admits. Returns how many points those were.
pub(in crate::geometry) fn check_derivatives(
    nearest: impl Fn(&Vector3<f64>) -> Nearest,
    points: &[Vector3<f64>],
) -> usize {
    let mut smooth = 0;
    for point in points {
        let found = nearest(point);
        let around = [0, 1, 2].map(|k| {
            let step = Vector3::ith(k, STEP);
            [nearest(&(point + step)), nearest(&(point - step))]
        });
        assert!((found.normal.norm() - 1.0).abs() < 1e-12);
        assert!((found.curvature - found.curvature.transpose()).norm() < 1e-9);
        // A kink lies between the points, or a region's boundary where the curvature jumps.
        let kink = around.iter().flatten().any(|other| {
            (other.normal - found.normal).norm() > 1e-2
                || (other.curvature - found.curvature).norm()
                    > 1e-2 * (1.0 + found.curvature.norm())
        });
        if kink || found.curvature.norm() > 50.0 {
            continue;
        }
        smooth += 1;
        let gradient =
            Vector3::from_fn(|k, _| (around[k][0].distance - around[k][1].distance) / (2.0 * STEP));
        let hessian = Matrix3::from_columns(
            &[0, 1, 2].map(|k: usize| (around[k][0].normal - around[k][1].normal) / (2.0 * STEP)),
        );
        let miss = (gradient - found.normal).norm();
        assert!(miss < TOLERANCE, "{point}: {found:?}, {gradient}");
        let miss = (hessian - found.curvature).norm();
        assert!(
            miss < TOLERANCE * (1.0 + found.curvature.norm()),
            "{point}: {found:?}, {hessian}"
        );
    }
    smooth
}

/// Points in a cube (m) about the origin.
pub(in crate::geometry) fn points(count: usize, half: f64, seed: u64) -> Vec<Vector3<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let point = |_| Vector3::from_fn(|_, _| rng.random_range(-half..half));
    (0..count).map(point).collect()
}

fn primitives() -> [Shape; 4] {
    [
        Shape::cylinder(0.3, 0.1),
        Shape::cuboid([0.1, 0.3, 0.2]),
        Shape::sphere(0.3),
        Shape::capsule(0.2, 0.3),
    ]
    .map(|shape| shape.expect("lengths above 0"))
}

/// parry's cylinders and capsules stand along y: a mirrored point is as far from a mirrored shape.
#[test]
fn the_nearest_surface_is_that_of_parry() {
    let theirs: [Box<dyn Theirs>; 4] = [
        Box::new(Cylinder::new(0.1, 0.3)),
        Box::new(Cuboid::new(Vec3::new(0.1, 0.2, 0.3))),
        Box::new(Ball::new(0.3)),
        Box::new(Capsule::new_y(0.3, 0.2)),
    ];
    for (shape, theirs) in primitives().iter().zip(theirs) {
        for point in points(200, 0.6, 0) {
            let found = shape.nearest(&point);
            let mirrored = Vec3::new(point.x, point.z, point.y);
            let expected = theirs.project_local_point(mirrored, false);
            let surface = point - found.normal * found.distance;
            let miss = surface - Vector3::new(expected.point.x, expected.point.z, expected.point.y);
            assert!(miss.norm() < 1e-9, "{shape:?}, {point}: {miss}");
            assert_eq!(
                found.distance <= 0.0,
                expected.is_inside,
                "{shape:?}, {point}"
            );
            assert_eq!(shape.contains(&point), expected.is_inside);
            assert!((found.normal.norm() - 1.0).abs() < 1e-12);
        }
    }
}

#[test]
fn normals_and_curvatures_are_the_derivatives_of_the_distance() {
    for shape in primitives() {
        let smooth = check_derivatives(|point| shape.nearest(point), &points(2000, 0.6, 1));
        assert!(smooth > 1900, "{shape:?}: {smooth}");
    }
    let mesh = mesh::tests::cuboid_mesh([0.1, 0.3, 0.2]);
    let smooth = check_derivatives(|point| mesh.nearest(point), &points(2000, 0.6, 1));
    assert!(smooth > 1900, "{smooth}");
}

#[test]
fn curvatures_are_those_of_cylinders_balls_and_rims() {
    let [cylinder, cuboid, sphere, capsule] = primitives();
    let across = |t: Vector3<f64>, radius: f64| t * t.transpose() / radius;
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let cases = [
        // Beside the cylinder, above it, and at its rim, 3 mm outward and 4 mm up.
        (&cylinder, [0.5, 0.0, 0.02], across(y, 0.5)),
        (&cylinder, [0.1, 0.0, 0.5], Matrix3::zeros()),
        (&cylinder, [0.25, 0.0, 0.02], across(y, 0.25)),
        (
            &cylinder,
            [0.303, 0.0, 0.104],
            across(x * 0.8 - z * 0.6, 0.005) + across(y, 0.303) * 0.6,
        ),
        // Before a face, an edge along z and a corner of the box.
        (&cuboid, [0.2, 0.1, 0.1], Matrix3::zeros()),
        (&cuboid, [0.13, 0.34, 0.1], across(x * 0.8 - y * 0.6, 0.05)),
        (
            &cuboid,
            [0.1 + 0.02, 0.3 + 0.01, 0.2 + 0.02],
            (Matrix3::identity()
                - (x * 2.0 + y + z * 2.0) * (x * 2.0 + y + z * 2.0).transpose() / 9.0)
                / 0.03,
        ),
        (&sphere, [0.0, 0.0, 0.5], across(x, 0.5) + across(y, 0.5)),
        (&capsule, [0.0, 0.4, 0.1], across(x, 0.4)),
        (&capsule, [0.0, 0.0, 0.7], across(x, 0.4) + across(y, 0.4)),
    ];
    for (shape, point, expected) in cases {
        let found = shape.nearest(&point.into()).curvature;
        assert!(
            (found - expected).norm() < 1e-9,
            "{shape:?}, {point:?}: {found}"
        );
    }
}

/// On axes, centres, faces, edges and corners, and one least number away from them.
#[test]
fn distances_have_finite_derivatives_everywhere() {
    let values = [
        0.0,
        -0.0,
        f64::MIN_POSITIVE,
        1e-200,
        0.1,
        0.2,
        0.3,
        0.3 + 1e-16,
        -0.3,
        1e6,
    ];
    let mut shapes = primitives().to_vec();
    shapes.push(mesh::tests::cuboid_mesh([0.1, 0.3, 0.2]));
    for shape in shapes {
        for x in values {
            for (y, z) in values.iter().flat_map(|&y| values.map(|z| (y, z))) {
                let point = Vector3::new(x, y, z);
                let mut found = vec![shape.nearest(&point)];
                shape.features(&point, 1.0, &mut found);
                for nearest in found {
                    let finite = nearest.curvature.iter().all(|value| value.is_finite());
                    assert!(finite && nearest.distance.is_finite(), "{shape:?}, {point}");
                    assert!(
                        (nearest.normal.norm() - 1.0).abs() < 1e-9,
                        "{shape:?}, {point}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_primitive_has_one_feature_within_reach() {
    let sphere = Shape::sphere(0.3).expect("a radius");
    let point = Vector3::new(0.5, 0.0, 0.0);
    let mut found = Vec::new();
    sphere.features(&point, 0.19, &mut found);
    assert!(found.is_empty());
    sphere.features(&point, 0.21, &mut found);
    assert_eq!(found, [sphere.nearest(&point)]);
}
