//! Cameras in memory, alone and together.

use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};
use tdcr_sim::camera::Intrinsics;
use tdcr_sim::geometry::{Instance, Shape};

use super::*;
use crate::camera::{WarmUp, grab_all};
use crate::clock::{Clock, VirtualClock};

const PATIENCE: Duration = Duration::from_secs(1);
const PERIOD: Duration = Duration::from_nanos(33_333_333);

/// A ball that falls along z from 0.1 m at 1 m/s.
struct FallingBall;

impl Subject for FallingBall {
    fn visuals_at(&mut self, time: Duration) -> Visuals {
        let place = Translation3::new(0.0, 0.0, 0.1 - time.as_secs_f64());
        let mut visuals = Visuals::default();
        let ball = Shape::sphere(0.02).expect("a radius above 0");
        visuals.add_obstacle(ball, place.into(), [200, 40, 40]);
        visuals
    }
}

/// Looks along y from (0, -0.5, 0).
fn camera() -> Camera {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -std::f64::consts::FRAC_PI_2);
    Camera {
        intrinsics: Intrinsics::from_fovy(120, 160, 0.7),
        pose: Isometry3::from_parts(Translation3::new(0.0, -0.5, 0.0), turn),
    }
}

fn watching(setup: CameraSetup, clock: &Arc<VirtualClock>) -> SimulatedCamera {
    SimulatedCamera::new(setup, Box::new(FallingBall), clock.clone())
}

fn ideal(serial: &str) -> CameraSetup {
    CameraSetup::ideal(serial, camera())
}

/// Height of the middle of what is seen (m).
fn height(frame: &RgbdFrame) -> f64 {
    let mut cloud = tdcr_sim::cloud::PointCloud::default();
    cloud.add_frame(frame);
    let low = cloud
        .points
        .iter()
        .map(|p| f64::from(p[2]))
        .fold(f64::INFINITY, f64::min);
    let high = cloud
        .points
        .iter()
        .map(|p| f64::from(p[2]))
        .fold(f64::NEG_INFINITY, f64::max);
    (low + high) / 2.0
}

#[test]
fn a_picture_shows_its_time_of_exposure_and_comes_once() {
    let clock = Arc::new(VirtualClock::new());
    let mut camera = watching(ideal("a"), &clock);
    clock.wait(Duration::from_millis(40));
    let first = camera.grab(PATIENCE).expect("a picture");
    assert_eq!(first.time, 2 * PERIOD);
    assert_eq!(clock.now(), first.time);
    assert!((height(&first.value) - (0.1 - first.time.as_secs_f64())).abs() < 2e-3);
    // The clock stands still, but a picture is not given twice.
    let second = camera.grab(PATIENCE).expect("a picture");
    assert_eq!(second.time, 3 * PERIOD);
    // Nothing of what only simulation knows is given away.
    let known = |mask: &[Instance]| mask.iter().any(|i| matches!(i, Instance::Obstacle(_)));
    assert!(!known(&second.value.mask));
    assert!(camera.truth().is_some_and(|truth| known(&truth.mask)));
    assert!(second.value.mask.contains(&Instance::Unknown));
}

#[test]
fn noise_is_a_function_of_seed_camera_and_picture() {
    let grab = |seed: u64, number: u64, pictures: usize| {
        let clock = Arc::new(VirtualClock::new());
        let setup = CameraSetup {
            seed,
            number,
            ..CameraSetup::d435("a", camera())
        };
        // Nothing moves.
        let visuals = FallingBall.visuals_at(Duration::ZERO);
        let mut camera = SimulatedCamera::new(setup, Box::new(visuals), clock);
        let frames = (0..pictures).map(|_| camera.grab(PATIENCE).expect("a picture").value);
        frames.last().expect("one picture at least")
    };
    let same = |a: &RgbdFrame, b: &RgbdFrame| a.depth == b.depth && a.color == b.color;
    let first = grab(7, 0, 1);
    assert!(same(&first, &grab(7, 0, 1)));
    for other in [grab(8, 0, 1), grab(7, 1, 1), grab(7, 0, 2)] {
        assert!(!same(&first, &other));
    }
}

#[test]
fn the_believed_pose_is_off_by_the_sensors_error_or_what_a_calibration_found() {
    let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
    let truth = camera();
    let open = |setup| SimulatedCamera::new(setup, Box::new(Visuals::default()), clock.clone());
    let mut noisy = open(CameraSetup::d435("a", truth.clone()));
    let off = (noisy.camera().pose.translation.vector - truth.pose.translation.vector).norm();
    assert!(off > 1e-5 && off < 0.01, "{off}");
    let frame = noisy.grab(PATIENCE).expect("a picture").value;
    assert_eq!(frame.camera.pose, noisy.camera().pose);
    let calibrated = open(CameraSetup {
        believed_pose: Some(truth.pose),
        ..CameraSetup::d435("a", truth.clone())
    });
    assert_eq!(calibrated.camera().pose, truth.pose);
}

#[test]
fn pictures_taken_together_are_of_one_moment() {
    let clock = Arc::new(VirtualClock::new());
    clock.wait(Duration::from_secs(1));
    let with_phase = |serial: &str, milliseconds| {
        let phase = Duration::from_millis(milliseconds);
        watching(
            CameraSetup {
                phase,
                ..ideal(serial)
            },
            &clock,
        )
    };
    let mut cameras = [
        with_phase("a", 30),
        with_phase("b", 10),
        with_phase("c", 20),
    ];
    let start = clock.now();
    let together = grab_all(&mut cameras, &*clock, PATIENCE);
    assert!(
        together
            .skew
            .is_some_and(|skew| skew > Duration::ZERO && skew < PERIOD)
    );
    let times: Vec<_> = together
        .frames
        .iter()
        .flatten()
        .map(|frame| frame.time)
        .collect();
    assert_eq!(times.len(), 3);
    let latest = times.iter().max().expect("three times");
    let earliest = times.iter().min().expect("three times");
    assert!(*earliest >= start && together.skew == Some(*latest - *earliest));
    for frame in together.frames.iter().flatten() {
        let expected = 0.1 - frame.time.as_secs_f64();
        // A camera shows its own moment, also where another was waited for before it.
        if expected.abs() < 0.15 {
            assert!((height(&frame.value) - expected).abs() < 2e-3);
        }
    }
    // With a sync cable there is no skew.
    let mut cameras = [with_phase("a", 10), with_phase("b", 10)];
    assert_eq!(
        grab_all(&mut cameras, &*clock, PATIENCE).skew,
        Some(Duration::ZERO)
    );
}

#[test]
fn a_dead_camera_costs_the_others_nothing() {
    for fault in [CameraFault::Unplugged, CameraFault::Stalled] {
        let clock = Arc::new(VirtualClock::new());
        let mut cameras = ["a", "b", "c"].map(|serial| watching(ideal(serial), &clock));
        cameras[1]
            .faults()
            .set_from(Duration::from_millis(90), Some(fault));
        let sound = grab_all(&mut cameras, &*clock, PATIENCE);
        assert_eq!(sound.skew, Some(Duration::ZERO));
        clock.wait_until(Duration::from_millis(95));
        let start = clock.now();
        let together = grab_all(&mut cameras, &*clock, PATIENCE);
        assert_eq!(together.skew, Some(Duration::ZERO), "{fault:?}");
        let error = together.frames[1].as_ref().expect_err("the camera is dead");
        match fault {
            CameraFault::Unplugged => assert!(matches!(error, CameraError::Unplugged { .. })),
            _ => {
                assert!(
                    error
                        .to_string()
                        .contains("camera b gave no picture within 1000 ms")
                );
                assert_eq!(clock.now() - start, PATIENCE);
            }
        }
        // Back again.
        cameras[1].faults().set_from(clock.now(), None);
        let again = grab_all(&mut cameras, &*clock, PATIENCE);
        assert!(again.frames.iter().all(Result::is_ok));
    }
}

#[test]
fn a_wait_ends_at_its_deadline() {
    let clock = Arc::new(VirtualClock::new());
    let mut camera = watching(ideal("a"), &clock);
    camera
        .faults()
        .set_from(Duration::ZERO, Some(CameraFault::Stalled));
    assert!(matches!(
        camera.grab(PATIENCE),
        Err(CameraError::NoFrame { .. })
    ));
    assert_eq!(clock.now(), PATIENCE);
}

#[test]
fn frozen_pictures_come_with_new_times_and_without_new_noise() {
    let clock = Arc::new(VirtualClock::new());
    let visuals = FallingBall.visuals_at(Duration::ZERO);
    let setup = CameraSetup::d435("a", camera());
    let mut camera = SimulatedCamera::new(setup, Box::new(visuals), clock.clone());
    let mut grab = |faults: Option<CameraFault>| {
        let from = clock.now() + Duration::from_nanos(1);
        camera.faults().set_from(from, faults);
        camera.grab(PATIENCE).expect("a picture")
    };
    let [first, second] = [grab(None), grab(None)];
    assert_ne!(first.value.depth, second.value.depth, "noise");
    let frozen = grab(Some(CameraFault::Frozen));
    assert_eq!(frozen.value.depth, second.value.depth);
    assert!(frozen.time > second.time);
}

#[test]
fn a_warm_up_ends_when_exposure_and_depth_are_steady() {
    let warm_up = Duration::from_millis(300);
    let table = table(-0.1).expect("sizes above 0");
    let setup = CameraSetup {
        warm_up,
        surroundings: table,
        ..ideal("a")
    };
    let open = |setup: CameraSetup| {
        SimulatedCamera::new(
            setup,
            Box::new(Visuals::default()),
            Arc::new(VirtualClock::new()),
        )
    };
    let mut camera = open(setup.clone());
    let warmed_up = WarmUp::default()
        .run(&mut camera)
        .expect("it becomes steady");
    let before = camera.grab(PATIENCE).expect("a picture").value;
    camera.clock().wait(10 * warm_up);
    let after = camera.grab(PATIENCE).expect("a picture").value;
    let seen = |frame: &RgbdFrame| frame.depth.iter().filter(|depth| **depth > 0.0).count();
    assert!(
        warmed_up.frames > 15 && warmed_up.took > warm_up,
        "{warmed_up:?}"
    );
    assert!(seen(&before) as f64 > 0.93 * seen(&after) as f64);
    // One that is given too little time says so.
    let hasty = WarmUp {
        patience: warm_up,
        ..WarmUp::default()
    };
    let error = hasty
        .run(&mut open(setup))
        .expect_err("it is not steady yet");
    assert!(matches!(error, CameraError::Unsteady { .. }), "{error}");
    // One that says nothing at all was not there.
    let mut dead = open(ideal("a"));
    dead.faults()
        .set_from(Duration::ZERO, Some(CameraFault::Stalled));
    let error = WarmUp::default().run(&mut dead).expect_err("no pictures");
    assert!(matches!(error, CameraError::NoFrame { .. }), "{error}");
}

#[test]
fn surroundings_are_seen_behind_the_subject() {
    let clock = Arc::new(VirtualClock::new());
    let surroundings = table(-0.1).expect("sizes above 0");
    let mut camera = watching(
        CameraSetup {
            surroundings,
            ..ideal("a")
        },
        &clock,
    );
    let frame = camera.grab(PATIENCE).expect("a picture").value;
    assert!(frame.depth.iter().all(|depth| *depth > 0.0));
    let ball = Point3::new(0.0, -0.02, 0.1);
    let (u, v, depth) = frame.camera.project(&ball).expect("in front of the camera");
    let seen = frame.depth[frame.index(u.round() as u32, v.round() as u32)];
    assert!((f64::from(seen) - depth).abs() < 1e-3);
}
