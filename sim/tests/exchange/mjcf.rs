//! MJCF there and back.

use std::path::Path;

use nalgebra::Vector3;
use proptest::prelude::*;
use tdcr_sim::camera::Camera;
use tdcr_sim::mjcf::{ExportOptions, export, import, import_text};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{CommandUnit, Payload, Robot, RobotSpec};

use crate::{assert_same_robot, random_robot};

fn robot_of(model: &str) -> Robot {
    Robot::new(import_text(model).unwrap().spec).unwrap()
}

#[test]
fn the_standard_robots_come_back_as_the_same_specification() {
    for name in RobotSpec::STANDARD {
        let spec = RobotSpec::standard(name).unwrap();
        let imported = import_text(&export(&spec, &ExportOptions::default()).unwrap()).unwrap();
        assert_eq!(imported.spec, spec);
        assert_eq!(imported.payload, Payload::default());
        assert!(imported.notes.is_empty(), "{:?}", imported.notes);
    }
}

#[test]
fn base_and_payload_stand_in_the_model_beside_the_robot() {
    let spec = RobotSpec::standard("3m").unwrap();
    let payload = Payload {
        mass: 0.02,
        offset: [0.001, -0.002, 0.01],
    };
    let options = ExportOptions {
        base: BaseVisibility::Shown,
        payload,
    };
    let model = export(&spec, &options).unwrap();
    // A column, and three layers of a plate and three servos.
    assert_eq!(model.matches("class=\"visual\"").count(), 1 + 13);
    let imported = import_text(&model).unwrap();
    assert_eq!((imported.spec, imported.payload), (spec, payload));
    let [note] = imported.notes.as_slice() else {
        panic!("{:?}", imported.notes);
    };
    assert!(
        note.to_string().contains("13 geoms that stand still"),
        "{note}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn random_robots_come_back_as_the_same_robot(seed: u64) {
        let robot = random_robot(seed);
        let model = export(robot.spec(), &ExportOptions::default()).unwrap();
        assert_same_robot(&robot, &robot_of(&model));
    }
}

#[test]
fn a_model_written_by_hand_is_read_as_mujoco_reads_it() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/exchange/by_hand/robot.xml"
    );
    let imported = import(Path::new(path)).unwrap();
    let robot = Robot::new(imported.spec).unwrap();
    let spec = robot.spec();
    let [lower, upper] = robot.discs() else {
        panic!("{} discs", robot.discs().len());
    };
    // Turned upside down: 0.1 m along the stand's z axis is 0.1 m down.
    let [_, _, height] = spec.base.position;
    assert!((height - 0.2).abs() < 1e-12, "{height}");
    assert!((spec.base.orientation[1].abs() - 1.0).abs() < 1e-12);
    assert_eq!(spec.base.hole_height, -0.01);
    // The disc is where its mass is, 5 mm above its joint.
    assert!((lower.offset.z - 0.025).abs() < 1e-12 && (lower.origin.z - 0.005).abs() < 1e-12);
    assert!((lower.joint_offset.z - 0.02).abs() < 1e-12);
    let volume = std::f64::consts::PI * 0.02 * 0.02 * 0.008;
    assert!((lower.mass - 1200.0 * volume - 0.001).abs() < 1e-12);
    assert_eq!((lower.damping, lower.armature), (0.01, 0.002));
    assert_eq!(lower.backbone.unwrap().torsion, 0.5);
    assert!((upper.mass - 0.014).abs() < 1e-12);
    assert_eq!((upper.radius, upper.half_height), (0.015, 0.005));
    let [camera] = &Camera::placed(&spec.cameras)[..] else {
        panic!("{} cameras", spec.cameras.count());
    };
    assert_eq!(camera.pose.translation.vector, Vector3::new(0.2, -1.0, 0.3));
    assert!((camera.pose.rotation * Vector3::z() - Vector3::y()).norm() < 1e-12);
    assert!((camera.pose.rotation * Vector3::y() + Vector3::z()).norm() < 1e-12);
    let tendon = &robot.tendons()[0];
    assert_eq!(
        (tendon.range, tendon.unit()),
        ([0.0, 5.0], CommandUnit::Newton)
    );
    let notes: Vec<String> = imported.notes.iter().map(ToString::to_string).collect();
    for expected in [
        "<geom>: left out, with all 1 geoms that stand still",
        "<motor name=\"pull\">: a command is the tension (N), -1 ctrl + 0",
        "<key name=\"start\">: left out",
        "<body name=\"upper\">: drawn as one upright cylinder",
    ] {
        assert!(
            notes.iter().any(|note| note.contains(expected)),
            "{expected}\n{notes:#?}"
        );
    }
}
