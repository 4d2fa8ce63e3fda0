use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::super::Shape;
use super::super::tests::points;
use super::*;

fn mesh(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Shape {
    Shape::mesh(vertices, triangles).expect("a mesh")
}

/// Each triangle with vertices of its own, as STL files have them.
fn soup(triangles: &[[[f64; 3]; 3]]) -> Shape {
    let numbers = (0..triangles.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]);
    mesh(triangles.as_flattened(), &numbers.collect::<Vec<_>>())
}

/// The triangles of a rectangle from a corner along two sides, each in `cells` parts.
fn rectangle(
    from: [f64; 3],
    sides: [[f64; 3]; 2],
    cells: u32,
) -> impl Iterator<Item = [[f64; 3]; 3]> {
    let [from, u, v] = [from, sides[0], sides[1]].map(Vector3::from);
    let at = move |i: u32, j: u32| {
        let share = |k: u32| f64::from(k) / f64::from(cells);
        <[f64; 3]>::from(from + u * share(i) + v * share(j))
    };
    (0..cells)
        .flat_map(move |i| (0..cells).map(move |j| (i, j)))
        .flat_map(move |(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
}

/// A box of half its sides, outward normals, each face cut into 2 x 3 x 3 triangles.
pub(in super::super) fn cuboid_mesh(half: [f64; 3]) -> Shape {
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut from = half.map(|h: f64| -h);
            from[axis] = side * half[axis];
            let mut sides = [[0.0; 3]; 2];
            sides[0][next] = 2.0 * half[next];
            sides[1][last] = 2.0 * half[last];
            if side < 0.0 {
                sides.swap(0, 1);
            }
            triangles.extend(rectangle(from, sides, 3));
        }
    }
    soup(&triangles)
}

fn features(shape: &Shape, point: [f64; 3], reach: f64) -> Vec<Nearest> {
    let mut found = Vec::new();
    shape.features(&point.into(), reach, &mut found);
    found
}

#[test]
fn a_box_of_triangles_is_a_box() {
    let half = [0.1, 0.3, 0.2];
    let (triangles, cuboid) = (cuboid_mesh(half), Shape::cuboid(half).expect("a box"));
    let mut outside = 0;
    for point in points(3000, 0.6, 2) {
        let expected = cuboid.nearest(&point);
        assert_eq!(
            triangles.contains(&point),
            expected.distance < 0.0,
            "{point}"
        );
        if expected.distance < 0.0 {
            continue;
        }
        outside += 1;
        let reach = expected.distance + 1e-3;
        let mut found = features(&triangles, point.into(), reach);
        assert_eq!(found.len(), 1, "{point}: {found:?}");
        found.push(triangles.nearest(&point));
        for found in found {
            assert!((found.distance - expected.distance).abs() < 1e-9);
            assert!((found.normal - expected.normal).norm() < 1e-9);
            assert!(
                (found.curvature - expected.curvature).norm() < 1e-6,
                "{point}: {found:?}"
            );
        }
        assert!(features(&triangles, point.into(), expected.distance - 1e-3).is_empty());
    }
    assert!(outside > 2000);
    // Inside, all six faces are local minima.
    assert_eq!(features(&triangles, [0.01, 0.02, 0.03], 1.0).len(), 6);
}

/// Also exactly above edges and vertices of the triangles, and in any position of the plane.
#[test]
fn over_coplanar_triangles_there_is_one_face() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for sides in [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        [[0.6, 0.0, 0.8], [0.48, 0.8, -0.36]],
        [[0.3, 0.1, 0.7], [0.9, -0.5, 0.1]],
    ] {
        let plane = soup(&rectangle([0.1, 0.2, 0.3], sides, 10).collect::<Vec<_>>());
        let [u, v] = sides.map(Vector3::from);
        let normal = u.cross(&v).normalize();
        for round in 0..3000 {
            let mut share = || match round % 3 {
                0 => rng.random_range(0.2..0.8),
                _ => f64::from(rng.random_range(2..8_u32)) / 10.0,
            };
            let (a, b) = (share(), share());
            let b = if round % 3 == 1 { a } else { b };
            let height = [0.05, -0.05, 1e-4, 1e-9][round % 4];
            let point = Vector3::new(0.1, 0.2, 0.3) + u * a + v * b + normal * height;
            let found = features(&plane, point.into(), 0.12);
            assert_eq!(found.len(), 1, "{a} {b} {height}: {found:?}");
            assert!((found[0].distance - height.abs()).abs() < 1e-12);
            assert_eq!(
                found[0].curvature,
                nalgebra::Matrix3::zeros(),
                "{a} {b} {height}"
            );
        }
    }
}

/// A valley of two slopes at an angle (rad) above the horizontal, or for a negative one a ridge, along y.
fn valley(angle: f64) -> Shape {
    let rise = angle.sin();
    let run = angle.cos();
    let slopes = [run, -run].map(|x| rectangle([0.0; 3], [[x, 0.0, rise], [0.0, 1.0, 0.0]], 4));
    soup(&slopes.into_iter().flatten().collect::<Vec<_>>())
}

#[test]
fn in_a_concave_edge_both_faces_are_met() {
    for angle in [0.01, 0.5, 1.2] {
        let found = features(&valley(angle), [0.0005, 0.52, 0.1], 0.3);
        assert_eq!(found.len(), 2, "{found:?}");
        for side in [1.0, -1.0] {
            let normal = Vector3::new(-side * angle.sin(), 0.0, angle.cos());
            let met = |nearest: &&Nearest| (nearest.normal - normal).norm() < 1e-9;
            let nearest = found.iter().find(met).expect("the face");
            let expected = normal.dot(&Vector3::new(0.0005, 0.52, 0.1));
            assert!((nearest.distance - expected).abs() < 1e-12);
        }
    }
}

#[test]
fn over_a_convex_edge_there_is_one_feature_and_its_distance_is_continuous() {
    let ridge = valley(-0.4);
    let mut last: Option<Nearest> = None;
    let mut curved = 0;
    let steps = 4000;
    for step in 0..=steps {
        let x = 0.3 * (2.0 * f64::from(step) / f64::from(steps) - 1.0);
        let found = features(&ridge, [x, 0.51, 0.1], 0.5);
        assert_eq!(found.len(), 1, "{x}: {found:?}");
        if let Some(last) = last {
            assert!((found[0].distance - last.distance).abs() < 0.6 / f64::from(steps));
            assert!((found[0].normal - last.normal).norm() < 1e-2);
        }
        curved += u32::from(found[0].curvature.norm() > 1.0);
        last = Some(found[0]);
    }
    // Over the edge's normal cone, 2 * 0.1 * tan(0.4) wide.
    let expected = 0.2 * 0.4_f64.tan() / 0.6 * f64::from(steps);
    assert!(
        (f64::from(curved) - expected).abs() < 2.0,
        "{curved} {expected}"
    );
}

/// Triangles without area, doubled ones, a T-junction, and an open edge.
#[test]
fn degenerate_triangles_add_no_features() {
    let [a, b, c, d, middle] = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.5, 0.0, 0.0],
    ];
    let below = [0.5, -1.0, 0.0];
    let shape = soup(&[
        [a, b, c],
        [c, b, a],
        [a, c, d],
        [a, a, a],
        [a, c, c],
        [a, middle, b],
        [a, below, middle],
        [middle, below, b],
    ]);
    for point in points(2000, 0.2, 4) {
        let point = point + Vector3::new(0.5, 0.0, 0.0);
        let found = features(&shape, point.into(), 0.25);
        assert_eq!(found.len(), 1, "{point}: {found:?}");
        assert!((found[0].distance - point.z.abs()).abs() < 1e-12);
    }
    // Past the open edge of the square that edge, past its corner that corner.
    let edge = features(&shape, [1.03, 0.5, 0.04], 0.1);
    assert!(matches!(edge[..], [one] if (one.distance - 0.05).abs() < 1e-12));
    assert!((edge[0].curvature.trace() - 1.0 / 0.05).abs() < 1e-6);
    let corner = features(&shape, [1.02, 1.01, 0.02], 0.1);
    assert!(matches!(corner[..], [one] if (one.distance - 0.03).abs() < 1e-12));
    assert!((corner[0].curvature.trace() - 2.0 / 0.03).abs() < 1e-6);
    assert!(!shape.contains(&Vector3::new(0.5, 0.5, 0.0)));
    for (point, reach) in [
        ([f64::NAN; 3], 1.0),
        ([0.5, 0.5, 0.1], f64::NAN),
        ([0.5, 0.5, 0.0], -1.0),
    ] {
        assert!(features(&shape, point, reach).is_empty());
    }
    // A mesh of nothing else.
    let points = soup(&[[a, a, a], [a, middle, b]]);
    let found = features(&points, [0.2, 0.0, 0.1], 0.2);
    assert!(
        matches!(found[..], [one] if (one.distance - 0.1).abs() < 1e-12),
        "{found:?}"
    );
}

/// Triangles of random numbers cut each other: every feature is a local minimum, and the nearest place is one of them.
#[test]
fn of_any_triangles_the_nearest_place_is_a_feature_and_none_is_nan() {
    let corners = points(180, 0.3, 5);
    let triangles: Vec<[[f64; 3]; 3]> = (corners.as_chunks().0.iter())
        .map(|corners: &[Vector3<f64>; 3]| corners.map(Into::into))
        .collect();
    let shape = soup(&triangles);
    for point in points(1000, 0.5, 6) {
        let nearest = shape.nearest(&point);
        let found = features(&shape, point.into(), f64::INFINITY);
        let least = found
            .iter()
            .map(|nearest| nearest.distance)
            .fold(f64::INFINITY, f64::min);
        assert!(
            (least - nearest.distance).abs() < 1e-9,
            "{point}: {least} {nearest:?}"
        );
        for feature in found {
            assert!(feature.curvature.iter().all(|value| value.is_finite()));
            let foot = point - feature.normal * feature.distance;
            assert!(shape.nearest(&foot).distance < 1e-9);
        }
    }
}

#[test]
fn overlapping_parts_are_inside_and_open_meshes_have_no_inside() {
    let face = |x: f64| {
        let far = [x + 1.0, 1.0, 1.0];
        let near = [x, 0.0, 0.0];
        let ([u, v, w], [a, b, c]) = (
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        );
        let faces = [
            (near, [v, u]),
            (near, [w, v]),
            (near, [u, w]),
            (far, [a, b]),
            (far, [b, c]),
            (far, [c, a]),
        ];
        faces
            .into_iter()
            .flat_map(|(from, sides)| rectangle(from, sides, 2))
            .collect::<Vec<_>>()
    };
    let mut triangles = face(0.0);
    triangles.extend(face(0.5));
    let both = soup(&triangles);
    for (x, inside) in [
        (-0.1, false),
        (0.2, true),
        (0.75, true),
        (1.2, true),
        (1.6, false),
    ] {
        assert_eq!(both.contains(&Vector3::new(x, 0.5, 0.5)), inside, "{x}");
    }
    let open = soup(&triangles[1..]);
    assert!(!open.contains(&Vector3::new(0.2, 0.5, 0.5)));
}

/// A wavy sheet of a million triangles.
#[test]
fn a_million_triangles_answer_in_microseconds() {
    let cells = 708_u32;
    let height = |x: f64, y: f64| 0.02 * (20.0 * x).sin() * (15.0 * y).cos();
    let side = cells + 1;
    let vertices: Vec<[f64; 3]> = (0..side * side)
        .map(|k| {
            let [x, y] = [k % side, k / side].map(|k| f64::from(k) / f64::from(cells));
            [x, y, height(x, y)]
        })
        .collect();
    let triangles: Vec<[u32; 3]> = (0..cells * cells)
        .flat_map(|k| {
            let a = k / cells * side + k % cells;
            [[a, a + 1, a + 1 + side], [a, a + 1 + side, a + side]]
        })
        .collect();
    assert!(triangles.len() > 1_000_000);
    let start = Instant::now();
    let shape = mesh(&vertices, &triangles);
    let built = start.elapsed();
    let first = features(&shape, [0.5, 0.5, 0.1], 0.2);
    let first = (start.elapsed() - built, first.len());
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut found = Vec::new();
    let mut mean = |reach: f64, count: u32| {
        let start = Instant::now();
        for _ in 0..count {
            let (x, y) = (rng.random_range(0.1..0.9), rng.random_range(0.1..0.9));
            let point = Vector3::new(x, y, height(x, y) + 0.005);
            found.clear();
            shape.features(&point, reach, &mut found);
            assert!(!found.is_empty(), "{point}");
        }
        start.elapsed() / count
    };
    // About 40 triangles within reach, and 1100.
    let (near, far) = (mean(0.0055, 1000), mean(0.014, 100));
    eprintln!("built in {built:?}, first answer {first:?}, then {near:?} or {far:?} each");
}
