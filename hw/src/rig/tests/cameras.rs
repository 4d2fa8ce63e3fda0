//! Pictures, and cameras that give one over and over.

use super::*;
use crate::camera::CameraError;
use crate::capture::{CaptureError, Session, SessionSettings};
use crate::rig::file::{CameraLink, ServoLink};
use crate::simulated::camera::CameraFault;

#[test]
fn cameras_see_the_robot_behind_the_servos() {
    let mut rig = rig();
    rig.warm_up().unwrap();
    rig.engage().unwrap();
    let pictures = rig.grab().unwrap();
    assert_eq!(pictures.frames.len(), 4);
    assert!(pictures.skew < Duration::from_millis(34));
    assert!(
        pictures
            .frames
            .iter()
            .all(|f| f.value.depth.iter().any(|&d| d > 0.0))
    );
    rig.release().unwrap();
}

/// The example's rig with two cameras of 160 by 120 pixels, whose noise and direction are as wanted.
fn two_cameras(sensor: &str, south: &str) -> Rig {
    let end = SIMULATED.match_indices("[[cameras]]").nth(2).unwrap().0;
    let text = SIMULATED[..end]
        .replace("[640, 480]", "[160, 120]")
        .replace("sensor = \"d435\"\n", sensor)
        .replacen("aim = { at = [0.0, 0.0, 0.26] }", south, 1);
    Rig::open_file(file(&text).unwrap(), Pace::Computed).unwrap()
}

const NOISE: &str = "sensor = \"d435\"\n";
const AT_THE_ROBOT: &str = "aim = { at = [0.0, 0.0, 0.26] }";

/// From now on.
fn freeze(rig: &Rig, camera: usize) {
    let faults = rig.camera_faults()[camera].as_ref().unwrap();
    let from = rig.clock().now() + Duration::from_nanos(1);
    faults.set_from(from, Some(CameraFault::Frozen));
}

/// Bends the robot by command `index` of a program, from home.
fn bend(rig: &mut Rig, index: u64) {
    let mut program = Program::new(rig.file(), 1).unwrap();
    let (rest, shape) = (program.rest().clone(), program.draw(index).unwrap().shape);
    rig.go_home().unwrap();
    let path = program.path(&rest, &shape).unwrap();
    rig.move_along(&path, &mut || ControlFlow::Continue(()))
        .unwrap();
    (0..20).try_for_each(|_| rig.poll().map(drop)).unwrap();
}

#[test]
fn a_camera_that_shows_a_robot_as_it_was_ends_the_motion_and_is_named() {
    for sensor in [NOISE, ""] {
        let mut rig = two_cameras(sensor, AT_THE_ROBOT);
        rig.engage().unwrap();
        bend(&mut rig, 0);
        rig.grab().unwrap();
        freeze(&rig, 1);
        // What it repeats is still so.
        rig.grab().unwrap();
        rig.grab().unwrap();
        bend(&mut rig, 1);
        let error = rig.grab().unwrap_err();
        assert!(
            matches!(&error, RigError::Camera(CameraError::Frozen { serial, repeats: 3 }) if serial == "east"),
            "{error}"
        );
        assert_eq!(torques(&mut rig), [Some(Torque::Off); 6]);
    }
}

/// A recording shows the robot of its own servos. Beside others it may show one picture for ever.
#[test]
fn a_recording_may_repeat_a_picture_but_beside_its_own_servos() {
    let log = || "log.mcap".into();
    for (servos, is_frozen) in [
        (ServoLink::Serial("/dev/ttyUSB0".into()), false),
        (ServoLink::Simulated, false),
        (ServoLink::Recorded(log()), true),
    ] {
        let mut rig = two_cameras(NOISE, AT_THE_ROBOT);
        rig.file.spec.cameras[1].link = CameraLink::Recorded(log());
        rig.file.spec.servos.link = servos.clone();
        rig.engage().unwrap();
        bend(&mut rig, 0);
        rig.grab().unwrap();
        freeze(&rig, 1);
        rig.grab().unwrap();
        bend(&mut rig, 1);
        let seen = rig.grab().map(drop);
        let frozen = matches!(seen, Err(RigError::Camera(CameraError::Frozen { .. })));
        assert_eq!(frozen, is_frozen, "{servos:?}: {seen:?}");
        assert_eq!(rig.is_engaged(), !is_frozen);
    }
}

/// Without noise, a robot at rest and one out of sight look the same each time.
#[test]
fn cameras_without_noise_may_repeat_what_has_not_changed() {
    let away = "aim = { at = [2.0, 0.0, 0.26] }";
    let mut rig = two_cameras("", away);
    rig.engage().unwrap();
    let mut last: Option<Pictures> = None;
    for index in 0..3 {
        bend(&mut rig, index);
        let [first, second] = [rig.grab().unwrap(), rig.grab().unwrap()];
        for (a, b) in first.frames.iter().zip(&second.frames) {
            assert_eq!(a.value.depth, b.value.depth, "at rest");
        }
        if let Some(before) = last.replace(second) {
            let south = [&before, &first].map(|pictures| &pictures.frames[0].value.depth);
            assert_eq!(south[0], south[1], "out of sight");
        }
    }
    rig.release().unwrap();
}

#[test]
fn a_capture_ends_at_a_frozen_camera() {
    let mut rig = two_cameras(NOISE, AT_THE_ROBOT);
    let settings = SessionSettings {
        seed: 1,
        voxel_size: 0.004,
        ..SessionSettings::default()
    };
    let faults = rig.camera_faults()[0].clone().unwrap();
    let mut go_on = || ControlFlow::Continue(());
    let mut session = Session::begin(&mut rig, &settings, None, &mut go_on).unwrap();
    session.sentinel().unwrap();
    session.sample(0).unwrap();
    let now = session.rig().clock().now() + Duration::from_nanos(1);
    faults.set_from(now, Some(CameraFault::Frozen));
    let ended = session.sample(1).unwrap_err();
    assert!(
        matches!(&ended, CaptureError::Rig(RigError::Camera(CameraError::Frozen { serial, .. })) if serial == "south"),
        "{ended}"
    );
    drop(session);
    assert!(!rig.is_engaged());
}
