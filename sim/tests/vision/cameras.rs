//! What cameras promise: lenses, and places in the world.

use std::path::Path;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector2, Vector3};
use proptest::prelude::*;
use tdcr_sim::camera::{Camera, Distortion, Intrinsics};
use tdcr_sim::formats::RobotFileError;
use tdcr_sim::robot::{Aim, CameraSpec, Cameras, Lens, PinholeSpec, RobotSpec};

/// Lenses from strong barrel to strong pincushion, for a picture 60 degrees wide.
fn lenses() -> impl Strategy<Value = Distortion> {
    (
        -0.2..0.2,
        -0.05..0.05,
        -0.01..0.01,
        -0.01..0.01,
        -0.01..0.01,
    )
        .prop_map(|(k1, k2, p1, p2, k3)| Distortion { k1, k2, p1, p2, k3 })
}

proptest! {
    #[test]
    fn projection_undoes_back_projection_through_any_lens(
        lens in lenses(),
        u in 0.0..1280.0,
        v in 0.0..720.0,
        depth in 0.05..5.0,
        turn in prop::array::uniform3(-3.0..3.0),
    ) {
        let mut intrinsics = Intrinsics::from_fovy(1280, 720, 0.6);
        intrinsics.distortion = Some(lens);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
        let pose = Isometry3::from_parts(Vector3::new(0.3, -0.2, 0.5).into(), turn);
        let camera = Camera { intrinsics, pose };
        let (u2, v2, depth2) = camera.project(&camera.back_project(u, v, depth)).unwrap();
        prop_assert!((u - u2).abs() <= 1e-9 && (v - v2).abs() <= 1e-9, "{} {}", u - u2, v - v2);
        prop_assert!((depth - depth2).abs() <= 1e-12);
    }
}

/// OpenCV's documentation of `projectPoints`, in its own words: with `r^2 = x'^2 + y'^2`,
/// `x'' = x' (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + ..) + 2 p1 x' y' + p2 (r^2 + 2 x'^2)`,
/// `y'' = y' (..) + p1 (r^2 + 2 y'^2) + 2 p2 x' y'`, `u = fx x'' + cx`, `v = fy y'' + cy`, and the
/// coefficients in the order `(k1, k2, p1, p2, k3)`.
fn opencv(coefficients: [f64; 5], focal: [f64; 2], center: [f64; 2], p: Vector3<f64>) -> [f64; 2] {
    let [k1, k2, p1, p2, k3] = coefficients;
    let (x, y) = (p.x / p.z, p.y / p.z);
    let r = x.hypot(y);
    let radial = 1.0 + k1 * r.powi(2) + k2 * r.powi(4) + k3 * r.powi(6);
    let seen_x = x * radial + 2.0 * p1 * x * y + p2 * (r.powi(2) + 2.0 * x.powi(2));
    let seen_y = y * radial + p1 * (r.powi(2) + 2.0 * y.powi(2)) + 2.0 * p2 * x * y;
    [focal[0] * seen_x + center[0], focal[1] * seen_y + center[1]]
}

#[test]
fn lenses_distort_as_opencv_documents() {
    let coefficients = [-0.12, 0.03, 0.004, -0.002, 0.005];
    let [k1, k2, p1, p2, k3] = coefficients;
    let camera = Camera {
        intrinsics: Intrinsics {
            width: 640,
            height: 480,
            fx: 600.0,
            fy: 610.0,
            cx: 322.0,
            cy: 238.0,
            distortion: Some(Distortion { k1, k2, p1, p2, k3 }),
        },
        pose: Isometry3::identity(),
    };
    for point in [
        [0.1, -0.2, 0.7],
        [-0.3, 0.25, 0.9],
        [0.0, 0.0, 0.4],
        [0.5, 0.4, 1.0],
    ] {
        let point = Vector3::from(point);
        let (u, v, _) = camera.project(&point.into()).unwrap();
        let [x, y] = opencv(coefficients, [600.0, 610.0], [322.0, 238.0], point);
        assert!(
            (u - x).abs() < 1e-9 && (v - y).abs() < 1e-9,
            "{u} {v} {x} {y}"
        );
    }
}

#[test]
fn a_lens_without_coefficients_is_a_pinhole() {
    let mut intrinsics = Intrinsics::from_fovy(640, 480, 0.8);
    let pinhole = intrinsics;
    intrinsics.distortion = Some(Distortion::default());
    assert_eq!(
        intrinsics.normalised(17.0, 401.0),
        pinhole.normalised(17.0, 401.0)
    );
    let point = Vector2::new(0.3, -0.1);
    assert_eq!(intrinsics.pixel(point), pinhole.pixel(point));
}

fn free(position: [f64; 3], aim: Aim) -> CameraSpec {
    CameraSpec {
        position,
        aim,
        lens: Lens::Fovy(40.0),
        resolution: [320, 240],
        distortion: None,
    }
}

#[test]
fn a_free_camera_looks_where_it_is_told_with_a_level_horizon() {
    let target = Point3::new(0.1, 0.2, 0.3);
    let aim = Aim::At(target.coords.into());
    for position in [
        [1.0, 0.0, 0.5],
        [-0.3, 0.4, 0.1],
        [0.1, 0.2, 1.0],
        [0.1, 0.2, -1.0],
    ] {
        let camera = Camera::free(&free(position, aim));
        let (u, v, depth) = camera.project(&target).unwrap();
        assert!((u - 159.5).abs() < 1e-9 && (v - 119.5).abs() < 1e-9);
        let distance = (target - Point3::from(position)).norm();
        assert!((depth - distance).abs() < 1e-12);
        let right = camera.pose.rotation * Vector3::x();
        assert!(right.z.abs() < 1e-12, "the horizon is level");
        let up = camera.pose.rotation * -Vector3::y();
        assert!(up.z > -1e-12, "up is up");
    }
    let turned = Camera::free(&free([0.0; 3], Aim::Orientation([2.0, 0.0, 0.0, 0.0])));
    assert_eq!(turned.pose, Isometry3::identity());
}

const FREE: &str = "
[[cameras]]
position = [0.4, 0.0, 0.3]
aim = { at = [0.0, 0.0, 0.2] }
lens = { fovy = 40.0 }
resolution = [320, 240]

[[cameras]]
position = [0.0, 0.5, 0.3]
aim = { orientation = [0.5, 0.5, -0.5, 0.5] }
lens = { pixels = { focal = [500.0, 501.0], principal = [319.0, 240.0] } }
resolution = [640, 480]
distortion = { k1 = 0.1 }
";

fn robot_with(cameras: &str) -> Result<RobotSpec, RobotFileError> {
    let text = include_str!("../../robots/2m.toml");
    let ring = text.find("[cameras]").unwrap();
    RobotSpec::from_toml(
        &format!("{}{cameras}", &text[..ring]),
        Path::new("robot.toml"),
    )
}

#[test]
fn free_cameras_are_read_and_written() {
    let spec = robot_with(FREE).unwrap();
    spec.validate().unwrap();
    assert_eq!(
        RobotSpec::from_toml(&spec.to_toml().unwrap(), Path::new("robot.toml")).unwrap(),
        spec
    );
    let json = serde_json::to_string(&spec).unwrap();
    assert_eq!(serde_json::from_str::<RobotSpec>(&json).unwrap(), spec);
    let [first, second] = &Camera::placed(&spec.cameras)[..] else {
        panic!("{} cameras", spec.cameras.count());
    };
    assert_eq!((first.intrinsics.width, first.intrinsics.cx), (320, 159.5));
    let k = &second.intrinsics;
    assert_eq!((k.fx, k.fy, k.cx, k.cy), (500.0, 501.0, 319.0, 240.0));
    assert_eq!(
        k.distortion.unwrap().coefficients(),
        [0.1, 0.0, 0.0, 0.0, 0.0]
    );
}

#[test]
fn a_wrong_camera_field_is_named_with_its_value_and_what_is_expected() {
    for (from, to, expected) in [
        (
            "fovy = 40.0",
            "fovy = 180.0",
            "`cameras[0].lens.fovy` is 180; expected degrees",
        ),
        (
            "[320, 240]",
            "[320, 0]",
            "`cameras[0].resolution` is [320, 0]; expected [width, height]",
        ),
        (
            "[0.0, 0.0, 0.2]",
            "[0.4, 0.0, 0.3]",
            "`cameras[0].aim.at` is [0.4, 0.0, 0.3]; expected a point away",
        ),
        (
            "[0.5, 0.5, -0.5, 0.5]",
            "[0.0, 0.0, 0.0, 0.0]",
            "`cameras[1].aim.orientation` is [0.0, 0.0, 0.0, 0.0]",
        ),
        (
            "[500.0, 501.0]",
            "[500.0, -1.0]",
            "`cameras[1].lens.pixels.focal` is -1; expected a finite number above 0",
        ),
        (
            "k1 = 0.1",
            "k1 = -3.0",
            "`cameras[1].distortion` is [-3.0, 0.0, 0.0, 0.0, 0.0]; expected k1, k2, p1, p2, k3",
        ),
        (
            "k1 = 0.1",
            "k2 = nan",
            "`cameras[1].distortion` is NaN; expected finite numbers",
        ),
        (
            "[0.0, 0.5, 0.3]",
            "[0.0, inf, 0.3]",
            "`cameras[1].position` is inf",
        ),
    ] {
        assert!(FREE.contains(from), "{from}");
        let read = robot_with(&FREE.replacen(from, to, 1));
        let message = read.unwrap_err().to_string();
        assert!(
            message.contains(expected),
            "{message} does not contain {expected}"
        );
    }
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.cameras = Cameras::Free(Vec::new());
    let message = spec.validate().unwrap_err().to_string();
    assert!(
        message.contains("`cameras` is a list of 0; expected 1 to 1000 cameras"),
        "{message}"
    );
}

#[test]
fn a_wrong_ring_field_is_named_with_its_value_and_what_is_expected() {
    let text = include_str!("../../robots/2m.toml");
    for (from, to, expected) in [
        (
            "fovy = 45.0",
            "fovy = 180.0",
            "`cameras.fovy` is 180; expected degrees between 0 and 180",
        ),
        (
            "[1280, 720]",
            "[0, 720]",
            "`cameras.resolution` is [0, 720]",
        ),
        (
            "count = 8",
            "count = 0",
            "`cameras.count` is 0; expected 1 to 1000",
        ),
    ] {
        assert!(text.contains(from), "{from}");
        let read = RobotSpec::from_toml(&text.replacen(from, to, 1), Path::new("robot.toml"));
        let message = read.unwrap_err().to_string();
        assert!(
            message.contains(expected),
            "{message} does not contain {expected}"
        );
    }
}

#[test]
fn an_unknown_camera_field_is_named() {
    for (cameras, expected) in [
        (FREE.replacen("fovy", "fov", 1), "unknown variant `fov`"),
        (
            FREE.replacen("position", "place", 1),
            "unknown field `place`",
        ),
        (
            "[cameras]\ncount = 8\nradios = 0.5\n".to_owned(),
            "unknown field `radios`",
        ),
        (
            "[cameras]\ncount = 8\n".to_owned(),
            "lacks `radius`, `height`",
        ),
    ] {
        let message = robot_with(&cameras).unwrap_err().to_string();
        assert!(
            message.contains(expected),
            "{message} does not contain {expected}"
        );
    }
}

#[test]
fn a_calibrated_pinhole_has_the_focal_lengths_of_its_calibration() {
    let lens = Lens::Pixels(PinholeSpec {
        focal: [500.0, 510.0],
        principal: [320.0, 240.0],
    });
    let intrinsics = lens.intrinsics([640, 480], None);
    assert_eq!(intrinsics.pixel(Vector2::new(0.1, -0.1)), (370.0, 189.0));
    assert_eq!(intrinsics.normalised(370.0, 189.0), Vector2::new(0.1, -0.1));
}
