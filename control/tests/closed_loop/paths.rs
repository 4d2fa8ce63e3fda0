//! Paths in time.

use nalgebra::{Isometry3, Vector3};
use tdcr_control::tip_path::{Shape, TipPath, TipPathError};

fn closed(shape: Shape) -> TipPath {
    TipPath::closed(shape, &Isometry3::translation(0.1, 0.2, 0.3), 0.06, 20.0).unwrap()
}

#[test]
fn a_circle_keeps_its_distance_and_its_speed() {
    let path = closed(Shape::Circle);
    for k in 0..200 {
        let time = 0.1 * f64::from(k);
        let arm = path.at(time) - Vector3::new(0.1, 0.2, 0.3);
        assert!((arm.norm() - 0.03).abs() < 1e-12 && arm.z == 0.0);
        let step = (path.at(time + 1e-3) - path.at(time)).norm();
        assert!((step - 1e-3 * 0.06 * std::f64::consts::PI / 20.0).abs() < 1e-11);
    }
}

#[test]
fn closed_curves_end_where_they_began_and_are_as_wide_as_asked() {
    for shape in [
        Shape::Circle,
        Shape::Eight,
        Shape::Square,
        Shape::Lissajous([3, 2]),
    ] {
        let path = closed(shape);
        assert!((path.at(0.0) - path.at(20.0)).norm() < 1e-12, "{shape:?}");
        let across: Vec<f64> = (0..=2000).map(|k| path.at(0.01 * f64::from(k)).x).collect();
        let width = across.iter().fold(f64::MIN, |a, &b| a.max(b))
            - across.iter().fold(f64::MAX, |a, &b| a.min(b));
        assert!((width - 0.06).abs() < 1e-6, "{shape:?}: {width}");
    }
}

#[test]
fn a_square_has_constant_speed() {
    let path = closed(Shape::Square);
    for k in 0..190 {
        let time = 0.1 * f64::from(k) + 0.013;
        let step = (path.at(time + 1e-3) - path.at(time)).norm();
        assert!((step - 1e-3 * 0.24 / 20.0).abs() < 1e-10, "{time}: {step}");
    }
}

#[test]
fn a_table_is_followed_by_straight_lines_from_its_first_time_on() {
    let rows = [
        (5.0, Vector3::zeros()),
        (6.0, Vector3::x()),
        (8.0, Vector3::y()),
    ];
    let path = TipPath::table(&rows).unwrap();
    assert_eq!(path.duration(), 3.0);
    assert_eq!(path.at(0.25), Vector3::x() * 0.25);
    assert_eq!(path.at(2.0), (Vector3::x() + Vector3::y()) / 2.0);
    assert_eq!(
        [path.at(-1.0), path.at(9.0)],
        [Vector3::zeros(), Vector3::y()]
    );
}

#[test]
fn what_is_no_path_is_refused_with_its_facts() {
    let row = |time: f64, x: f64| (time, Vector3::new(x, 0.0, 0.0));
    let refused = [
        TipPath::table(&[row(0.0, 0.0)]),
        TipPath::table(&[row(0.0, 0.0), row(0.0, 1.0)]),
        TipPath::table(&[row(0.0, 0.0), row(1.0, f64::NAN)]),
        TipPath::closed(Shape::Circle, &Isometry3::identity(), 0.0, 1.0),
        TipPath::closed(Shape::Lissajous([0, 1]), &Isometry3::identity(), 1.0, 1.0),
    ];
    let expected = [
        "the path has 1 rows; expected two at least",
        "row 1 of the path is at 0 s, and the row before at 0 s; expected times that ascend",
        "row 1 of the path has NaN; expected finite numbers",
        "the diameter (m) is 0; expected a finite number above 0",
        "a Lissajous figure of [0, 1]; expected two whole numbers above 0",
    ];
    for (refused, expected) in refused.into_iter().zip(expected) {
        let error: TipPathError = refused.unwrap_err();
        assert_eq!(error.to_string(), expected);
    }
}
