use std::f64::consts::PI;

use super::super::distance::tests::{check_derivatives, points};
use super::*;

fn bent() -> Pipe {
    let path = [
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 0.4],
        [0.3, 0.0, 0.5],
        [0.3, 0.4, 0.5],
        [0.3, 0.7, 0.5],
        [0.1, 0.9, 0.8],
    ];
    Pipe::along(0.08, &path).expect("a pipe")
}

#[test]
fn a_straight_pipe_has_its_closed_forms() {
    let pipe = Pipe::straight(0.1, 1.0).expect("a pipe");
    let across = |t: Vector3<f64>, radius: f64| t * t.transpose() / radius;
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    let cases = [
        // Inside, in the wall, and in the block closer to its end than to the hole.
        ([0.06, 0.0, 0.2], 0.04, -x, -across(y, 0.06)),
        ([0.12, 0.0, 0.2], -0.02, -x, -across(y, 0.12)),
        ([0.15, 0.0, 0.49], -0.01, z, Matrix3::zeros()),
        // Beyond an end: before the block, and before the hole, 3 cm from the rim inward and 4 cm away.
        ([0.15, 0.0, -0.53], 0.03, -z, Matrix3::zeros()),
        (
            [0.07, 0.0, 0.54],
            0.05,
            z * 0.8 - x * 0.6,
            across(x * 0.8 + z * 0.6, 0.05) - across(y, 0.07) * 0.6,
        ),
    ];
    for (point, distance, normal, curvature) in cases {
        let found = pipe.nearest(&point.into());
        assert!(
            (found.distance - distance).abs() < 1e-12,
            "{point:?}: {found:?}"
        );
        assert!(
            (found.normal - normal).norm() < 1e-12,
            "{point:?}: {found:?}"
        );
        assert!(
            (found.curvature - curvature).norm() < 1e-9,
            "{point:?}: {found:?}"
        );
    }
    // On the axis, before it and on the rim: finite.
    for point in [
        [0.0, 0.0, 0.1],
        [0.0, 0.0, 0.6],
        [0.1, 0.0, 0.5],
        [0.0, 0.0, 0.5],
    ] {
        let found = pipe.nearest(&point.into());
        assert!(found.curvature.iter().all(|value| value.is_finite()));
        assert!((found.normal.norm() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn a_corner_becomes_an_arc_of_the_half_segments() {
    let path = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.4], [1.0, 0.0, 0.4]];
    let pipe = Pipe::along(0.1, &path).expect("a pipe");
    // From 0.2 m before the corner to 0.2 m after, a quarter of a circle.
    assert!((pipe.axis_length() - (0.2 + 0.2 * PI / 2.0 + 0.8)).abs() < 1e-12);
    let (middle, along) = pipe.axis_at(0.2 + 0.2 * PI / 4.0);
    let diagonal = std::f64::consts::FRAC_1_SQRT_2;
    let expected = Vector3::new(0.2 - 0.2 * diagonal, 0.0, 0.2 + 0.2 * diagonal);
    assert!((middle - expected).norm() < 1e-12);
    assert!((along - Vector3::new(diagonal, 0.0, diagonal)).norm() < 1e-12);
    // A torus: 3 cm from the axis towards the arc's centre, the surface bends about that at 17 cm, the other way.
    let outward = Vector3::new(-diagonal, 0.0, diagonal);
    let found = pipe.nearest(&(middle - outward * 0.03));
    assert!((found.distance - 0.07).abs() < 1e-12);
    assert!((found.normal - outward).norm() < 1e-12);
    let y = Vector3::y();
    let expected = along * along.transpose() / 0.17 - y * y.transpose() / 0.03;
    assert!((found.curvature - expected).norm() < 1e-9, "{found:?}");
}

#[test]
fn normals_and_curvatures_are_the_derivatives_of_a_pipes_distance() {
    let pipe = bent();
    let mut near = points(3000, 0.1, 1);
    for (index, point) in near.iter_mut().enumerate() {
        let share = index as f64 / 3000.0;
        *point += pipe.axis_at(share * pipe.axis_length()).0;
    }
    near.extend(points(1000, 0.15, 2));
    let smooth = check_derivatives(|point| pipe.nearest(point), &near);
    assert!(smooth > 3500, "{smooth}");
}

#[test]
fn distance_and_normal_are_continuous_along_a_pipe() {
    let pipe = bent();
    let steps = 20_000;
    let length = pipe.axis_length();
    let mut side = Vector3::x();
    let mut last: Option<(Vector3<f64>, Nearest)> = None;
    for step in 0..=steps {
        let (middle, along) = pipe.axis_at(length * f64::from(step) / f64::from(steps));
        side = (side - along * along.dot(&side)).normalize();
        let point = middle + side * 0.05;
        let found = pipe.nearest(&point);
        assert!((found.distance - 0.03).abs() < 1e-9 && (found.normal + side).norm() < 1e-6);
        if let Some((before, nearest)) = last {
            assert!((point - before).norm() < 2.0 * length / f64::from(steps));
            assert!((found.normal - nearest.normal).norm() < 1e-2);
        }
        last = Some((point, found));
    }
}

#[test]
fn a_pipes_mesh_lies_on_its_wall() {
    let pipe = bent();
    let mesh = pipe.mesh();
    for point in points(500, 0.03, 3) {
        let share = (point.x + 0.03) / 0.06;
        let point = point + pipe.axis_at(pipe.axis_length() * (0.2 + 0.6 * share)).0;
        let expected = pipe.nearest(&point).distance;
        let found = mesh.nearest(&point).distance;
        // Chords of 32 to a circle, and of 128 to the arcs'.
        let sag = 0.08 * (1.0 - (PI / 32.0).cos()) + 2e-4;
        assert!(
            (found - expected).abs() < sag,
            "{point}: {found} {expected}"
        );
    }
}

#[test]
fn paths_of_no_pipe_are_refused_with_what_is_wrong() {
    let refuse = |radius: f64, path: &[[f64; 3]]| Pipe::along(radius, path).expect_err("no pipe");
    let (a, b) = ([0.0, 0.0, 0.0], [0.0, 0.0, 0.4]);
    let position = [0.0, f64::NAN, 0.0];
    assert!(matches!(
        refuse(0.1, &[a, position]),
        ShapeError::PathPoint { index: 1, .. }
    ));
    assert!(matches!(
        refuse(0.1, &[a, [1e200; 3]]),
        ShapeError::PathPoint { index: 1, .. }
    ));
    assert_eq!(refuse(0.1, &[a]), ShapeError::Path { count: 1 });
    assert_eq!(refuse(0.1, &[]), ShapeError::Path { count: 0 });
    assert_eq!(
        refuse(0.1, &[a, b, b]),
        ShapeError::PathRepeats { index: 2 }
    );
    assert_eq!(refuse(0.1, &[a, b, a]), ShapeError::PathFolds { index: 1 });
    assert!(matches!(
        refuse(0.0, &[a, b]),
        ShapeError::Length { what: "radius", .. }
    ));
    assert!(matches!(
        refuse(f64::NAN, &[a, b]),
        ShapeError::Length { what: "radius", .. }
    ));
    assert!(matches!(
        Pipe::straight(0.1, -1.0).expect_err("no pipe"),
        ShapeError::Length { what: "length", .. }
    ));
    // The segment that it names is the least that will do.
    let narrow = |length: f64| Pipe::along(0.3, &[a, [0.0, 0.0, length], [0.7, 0.0, length]]);
    let ShapeError::Bend {
        index,
        bend,
        radius,
        segment,
    } = narrow(0.4).expect_err("too narrow")
    else {
        panic!("another error");
    };
    assert_eq!((index, radius), (1, 0.3));
    assert!((bend - 0.2).abs() < 1e-12 && (segment - 0.6).abs() < 1e-12);
    assert!(narrow(segment - 1e-6).is_err() && narrow(segment + 1e-6).is_ok());
}

#[test]
fn straight_corners_and_long_paths_are_pipes() {
    let path: Vec<[f64; 3]> = (0..50).map(|k| [0.1 * f64::from(k), 0.0, 0.0]).collect();
    let pipe = Pipe::along(0.3, &path).expect("a pipe");
    assert!((pipe.axis_length() - 4.9).abs() < 1e-12);
    let found = pipe.nearest(&Vector3::new(2.0, 0.1, 0.0));
    assert!((found.distance - 0.2).abs() < 1e-12);
    // Nearly straight corners, above and below the least angle that has an arc.
    for turn in [1e-7, 1e-5] {
        let path = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, turn]];
        let pipe = Pipe::along(0.3, &path).expect("a pipe");
        let found = pipe.nearest(&Vector3::new(1.2, 0.1, 0.0));
        assert!((found.distance - 0.2).abs() < 1e-8, "{found:?}");
        assert!((found.curvature[(2, 2)] + 10.0).abs() < 1e-3, "{found:?}");
    }
}
