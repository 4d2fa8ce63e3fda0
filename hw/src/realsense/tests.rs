//! The calibration and the alignment alone, and librealsense with a camera whose pictures are rendered.

use std::env;
use std::ffi::CStr;
use std::time::Duration;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use tdcr_sim::camera::{Camera, Distortion, Intrinsics};
use tdcr_sim::geometry::Shape;
use tdcr_sim::render::{RgbdFrame, Visuals};

use super::camera::describe;
use super::handles::now;
use super::library::{RsExtrinsics, RsIntrinsics, VARIABLE};
use super::software::{SoftwareCamera, SoftwareSetup};
use super::*;
use crate::camera::{CameraError, RgbdCamera};
use crate::clock::{Clock, SystemClock};

const NONE: i32 = 0;
const MODIFIED_BROWN_CONRADY: i32 = 1;
const INVERSE_BROWN_CONRADY: i32 = 2;
const BROWN_CONRADY: i32 = 4;

fn factory_lens(width: i32, height: i32, focal: f32, model: i32, coeffs: [f32; 5]) -> RsIntrinsics {
    let middle = |size: i32| size as f32 / 2.0 - 0.5;
    let (ppx, ppy) = (middle(width), middle(height));
    RsIntrinsics {
        width,
        height,
        ppx,
        ppy,
        fx: focal,
        fy: focal,
        model,
        coeffs,
    }
}

/// A depth camera 15 mm beside the colour camera, turned by a degree about each axis.
fn depth_to_color() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::repeat(1_f64.to_radians()));
    Isometry3::from_parts(Translation3::new(0.015, 0.0005, -0.0002), turn)
}

fn as_extrinsics(transform: &Isometry3<f64>) -> RsExtrinsics {
    let rotation = transform.rotation.to_rotation_matrix();
    let mut columns = [0.0; 9];
    for (number, entry) in columns.iter_mut().zip(rotation.matrix().as_slice()) {
        *number = *entry as f32;
    }
    RsExtrinsics {
        rotation: columns,
        translation: transform.translation.vector.map(|x| x as f32).into(),
    }
}

/// A slanted wall with a ball and a rod before it, as cameras with z ahead see them.
fn visuals() -> Visuals {
    let mut visuals = Visuals::default();
    let turn = UnitQuaternion::from_euler_angles(0.2, -0.15, 0.0);
    let shapes = [
        (
            Shape::cuboid([1.0, 1.0, 0.01]),
            Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.8), turn),
            [180, 170, 160],
        ),
        (
            Shape::sphere(0.05),
            Translation3::new(0.08, 0.02, 0.5).into(),
            [200, 40, 30],
        ),
        (
            Shape::cylinder(0.02, 0.2),
            Isometry3::from_parts(Translation3::new(-0.1, 0.0, 0.45), turn),
            [30, 60, 190],
        ),
    ];
    for (shape, pose, color) in shapes {
        visuals.add_obstacle(shape.expect("sizes above 0"), pose, color);
    }
    visuals
}

/// That nearly all pixels have a depth, half of them within 0.5 mm of the truth, and all but those at edges and on steep
/// slopes within `tolerance` (m).
fn assert_depths_agree(found: &[f32], truth: &RgbdFrame, tolerance: f32) {
    let pixels = found.iter().zip(&truth.depth).filter(|(z, _)| **z > 0.0);
    let mut errors: Vec<f32> = pixels.map(|(z, truth)| (z - truth).abs()).collect();
    errors.sort_by(f32::total_cmp);
    let seen = errors.len() as f64 / found.len() as f64;
    assert!(seen > 0.93, "{seen}");
    let [median, most] = [0.5, 0.97].map(|share| errors[(share * errors.len() as f64) as usize]);
    assert!(median < 5e-4 && most < tolerance, "{median} m, {most} m");
}

#[test]
fn calibrations_become_ours_or_are_refused() {
    let read =
        |model, coeffs| lens::intrinsics("colour", &factory_lens(640, 480, 600.0, model, coeffs));
    let some = [0.1, -0.2, 0.003, -0.004, 0.05];
    let plain = read(NONE, [0.0; 5]).expect("a pinhole");
    assert_eq!(
        (plain.width, plain.fx, plain.cx, plain.distortion),
        (640, 600.0, 319.5, None)
    );
    // What D435s report.
    assert_eq!(
        read(INVERSE_BROWN_CONRADY, [0.0; 5]).expect("no distortion"),
        plain
    );
    let brown = read(BROWN_CONRADY, some)
        .expect("our model")
        .distortion
        .expect("distorted");
    let expected = some.map(f64::from);
    assert_eq!(brown.coefficients(), expected);
    let radial = [0.1, -0.2, 0.0, 0.0, 0.05];
    let modified =
        read(MODIFIED_BROWN_CONRADY, radial).expect("the same without tangential coefficients");
    assert_eq!(
        modified.distortion.map(|d: Distortion| d.coefficients()),
        Some(radial.map(f64::from))
    );
    for (model, coeffs) in [
        (MODIFIED_BROWN_CONRADY, some),
        (INVERSE_BROWN_CONRADY, some),
        (3, some),
        (77, [0.0; 5]),
    ] {
        let error = read(model, coeffs).expect_err("not our model").to_string();
        assert!(
            error.contains("colour") && error.contains("expected none, or Brown-Conrady"),
            "{error}"
        );
    }
    for broken in [
        factory_lens(0, 480, 600.0, NONE, [0.0; 5]),
        factory_lens(640, -1, 600.0, NONE, [0.0; 5]),
        factory_lens(640, 480, f32::NAN, NONE, [0.0; 5]),
    ] {
        assert!(lens::intrinsics("colour", &broken).is_err(), "{broken:?}");
    }
    let transform = depth_to_color();
    let back = lens::depth_to_color(&as_extrinsics(&transform)).expect("a rigid motion");
    assert!((back.translation.vector - transform.translation.vector).norm() < 1e-9);
    assert!(back.rotation.angle_to(&transform.rotation) < 1e-6);
    let mut mirrored = as_extrinsics(&transform);
    mirrored.rotation[..3].iter_mut().for_each(|x| *x = -*x);
    assert!(lens::depth_to_color(&mirrored).is_err());
    assert!(lens::depth_to_color(&RsExtrinsics::default()).is_err());
}

#[test]
fn aligned_depth_is_what_the_other_camera_would_measure() {
    let transform = depth_to_color();
    let distortion = Distortion {
        k1: 0.05,
        k2: -0.04,
        p1: 0.001,
        p2: -0.001,
        k3: 0.0,
    };
    let color = Intrinsics {
        distortion: Some(distortion),
        ..Intrinsics::from_fovy(320, 180, 0.73)
    };
    // Of more, of equal and of fewer pixels, with a wider field of view.
    for [width, height] in [[424, 240], [320, 180], [212, 120]] {
        let depth = Intrinsics::from_fovy(width, height, 1.0);
        // The world is the colour camera's frame.
        let seen = visuals().render(&Camera {
            intrinsics: depth,
            pose: transform,
        });
        let truth = visuals().render(&Camera {
            intrinsics: color,
            pose: Isometry3::identity(),
        });
        let aligned = Aligner::new(depth, color, transform).align(&seen.depth);
        // Half a depth pixel on the slanted wall.
        assert_depths_agree(&aligned, &truth, 1.5e-3);
    }
}

#[test]
fn alignment_to_itself_changes_nothing_and_bad_pixels_are_none() {
    let camera = Intrinsics::from_fovy(64, 48, 0.8);
    let aligner = Aligner::new(camera, camera, Isometry3::identity());
    let mut depth: Vec<f32> = (0..64 * 48).map(|k| 0.3 + 1e-4 * k as f32).collect();
    depth[5] = 0.0;
    assert_eq!(aligner.align(&depth), depth);
    let bad = [f32::NAN, f32::INFINITY, -1.0];
    assert_eq!(aligner.align(&bad), vec![0.0; 64 * 48]);
}

#[test]
fn a_library_that_is_not_there_is_said_with_what_would_be_right() {
    let error = RealSense::load_from(&["no/such/librealsense2.so".into()])
        .map(|_| ())
        .expect_err("no library");
    let text = error.to_string();
    assert!(
        text.contains("no/such/librealsense2.so") && text.contains("pyrealsense2"),
        "{text}"
    );
    assert!(RealSense::load_from(&[]).is_err());
}

/// librealsense, where the environment names one.
fn library() -> Option<RealSense> {
    if env::var_os(VARIABLE).is_none_or(|list| list.is_empty()) {
        // Shown by `cargo test -- --nocapture`, and by `make test` itself.
        eprintln!(
            "skipped: {VARIABLE} names no librealsense (scripts/realsense_library.py finds that of pyrealsense2)"
        );
        return None;
    }
    Some(RealSense::load().expect("the library that the environment names"))
}

const DEPTH_UNITS: f32 = 1e-4;

fn software(library: &RealSense, usb: &'static CStr) -> SoftwareCamera {
    let setup = SoftwareSetup {
        serial: c"817612071234",
        usb,
        depth: factory_lens(212, 120, 110.0, BROWN_CONRADY, [0.0; 5]),
        color: factory_lens(320, 180, 230.0, INVERSE_BROWN_CONRADY, [0.0; 5]),
        depth_to_color: as_extrinsics(&depth_to_color()),
        depth_units: DEPTH_UNITS,
    };
    SoftwareCamera::new(library.calls(), &setup).expect("a software device")
}

#[test]
fn librealsense_gives_our_frames_with_the_right_distances() {
    let Some(library) = library() else { return };
    let mut software = software(&library, c"2.1");
    let device = software.device().expect("a device");
    let info = describe(&device).expect("what it says of itself");
    assert_eq!(
        (info.serial.as_str(), info.name.as_str()),
        ("817612071234", "Software D435")
    );
    let warning = info.usb.and_then(|usb| usb.warning(&info.serial));
    assert!(warning.is_some_and(|warning| warning.contains("USB 2.1")));

    let clock = std::sync::Arc::new(SystemClock::new());
    let setup = RealSenseSetup {
        depth: [212, 120],
        color: [320, 180],
        ..RealSenseSetup::d435(info.serial.clone(), Isometry3::translation(0.0, 0.0, 0.1))
    };
    // A size that it has not is refused, with what was asked for; nothing of it stays open.
    let wrong = RealSenseSetup {
        depth: [848, 480],
        ..setup.clone()
    };
    for _ in 0..3 {
        let device = software.device().expect("a device");
        let error = library
            .start(device, info.clone(), &wrong, clock.clone())
            .expect_err("no such stream");
        let text = error.to_string();
        assert!(
            text.contains("depth at 848 x 480") && text.contains("USB 3 port"),
            "{text}"
        );
    }

    let mut camera = library
        .start(device, info, &setup, clock.clone())
        .expect("streams");
    let transform = camera.depth_to_color();
    assert!((transform.translation.vector - depth_to_color().translation.vector).norm() < 1e-7);
    let intrinsics = camera.camera().intrinsics;
    assert_eq!(
        (intrinsics.width, intrinsics.fx, intrinsics.cx),
        (320, 230.0, 159.5)
    );

    // Nothing is there yet, and the wait is bounded.
    let patience = Duration::from_millis(30);
    let start = clock.now();
    assert!(matches!(
        camera.grab(patience),
        Err(CameraError::NoFrame { .. })
    ));
    let waited = clock.now() - start;
    assert!(
        waited >= patience && waited < Duration::from_secs(5),
        "{waited:?}"
    );

    // What both cameras would see; the world is the colour camera's frame here.
    let seen = visuals().render(&Camera {
        intrinsics: *camera.depth_intrinsics(),
        pose: transform,
    });
    let truth = visuals().render(&Camera {
        intrinsics,
        pose: Isometry3::identity(),
    });
    let depth: Vec<u16> = seen
        .depth
        .iter()
        .map(|z| (z / DEPTH_UNITS).round() as u16)
        .collect();
    let asked = clock.now();
    let mut times = Vec::new();
    for number in 1..=4 {
        // Longer than the two clocks' readings can be apart on a busy machine.
        std::thread::sleep(Duration::from_millis(5));
        let stamp = now(library.calls()).expect("a time").0;
        software
            .take(number, stamp, &depth, &truth.color)
            .expect("pictures are taken");
        let frame = camera
            .grab_after(asked, clock.now() + Duration::from_secs(5))
            .expect("a picture");
        assert_eq!(frame.value.color, truth.color);
        assert_eq!(frame.value.camera.pose, setup.pose);
        assert_depths_agree(&frame.value.depth, &truth, 3e-3);
        let late = clock.now().saturating_sub(frame.time);
        assert!(
            frame.time >= asked && late < Duration::from_secs(2),
            "{late:?}"
        );
        times.push(frame.time);
    }
    assert!(times.is_sorted_by(|a, b| a < b), "{times:?}");
    // Pictures of before the call are passed over.
    let stamp = now(library.calls()).expect("a time").0 - 500.0;
    software
        .take(5, stamp, &depth, &truth.color)
        .expect("pictures are taken");
    assert!(matches!(
        camera.grab(patience),
        Err(CameraError::NoFrame { .. })
    ));
}

#[test]
fn librealsense_lists_cameras_and_says_which_is_missing() {
    let Some(library) = library() else { return };
    let cameras = library.cameras().expect("a list");
    let clock = std::sync::Arc::new(SystemClock::new());
    let setup = RealSenseSetup::d435("000000000000", Isometry3::identity());
    let error = library
        .open(&setup, clock)
        .map(|_| ())
        .expect_err("no such camera")
        .to_string();
    assert!(
        error.contains("no RealSense camera with the serial number 000000000000"),
        "{error}"
    );
    assert!(
        cameras.iter().all(|camera| error.contains(&camera.serial)) || error.contains("none"),
        "{error}"
    );
}
