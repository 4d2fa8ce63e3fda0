//! MJCF there and back.

use std::path::Path;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use tdcr_sim::camera::Camera;
use tdcr_sim::dynamics::{Integrator, State, Stepper};
use tdcr_sim::formats::ExportError;
use tdcr_sim::formats::mjcf::{self, ExportOptions, export, export_notes, import, import_text};
use tdcr_sim::render::BaseVisibility;
use tdcr_sim::robot::{
    Backbone, CommandUnit, Loads, MassSpec, Payload, PerDisc, RigidMass, Robot, RobotSpec,
};

use super::{assert_same_robot, random_robot};

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
        ..ExportOptions::default()
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
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/by_hand/robot.xml");
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

/// The 2m robot on a rod of spring steel, 1 mm across, its joints with little armature.
fn on_a_rod() -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::round_rod(
            2e11, 7.7e10, 5e-4, 0.017,
        )));
        module.mass = MassSpec::Rigid(PerDisc::Uniform(RigidMass {
            mass: 2e-3,
            inertia: [3e-7, 3e-7, 5e-7],
            centre_of_mass: [0.0; 3],
        }));
        module.armature = PerDisc::Uniform(1e-7);
        module.damping = PerDisc::Uniform(1e-4);
        module.tendons.as_mut().unwrap().range = [0.0, 0.04];
    }
    spec
}

/// The number that the model has in an attribute.
fn attribute(model: &str, name: &str) -> f64 {
    let start = model.find(&format!("{name}=\"")).unwrap() + name.len() + 2;
    model[start..].split('"').next().unwrap().parse().unwrap()
}

#[test]
fn the_written_time_step_is_stable_and_a_longer_one_is_refused_with_the_limit() {
    let mut spec = on_a_rod();
    for module in &mut spec.modules {
        // Without hinges our steps are MuJoCo's.
        let Some(PerDisc::Uniform(rod)) = &mut module.backbone else {
            panic!("one rod for all discs");
        };
        rod.torsion = rod.bending[0];
    }
    let robot = Robot::new(spec.clone()).unwrap();
    let model = export(&spec, &ExportOptions::default()).unwrap();
    let written = attribute(&model, "timestep");
    assert!(written < 0.002, "{written}");
    for (name, integrator) in [
        (mjcf::Integrator::Euler, Integrator::SemiImplicitEuler),
        (mjcf::Integrator::RungeKutta4, Integrator::RungeKutta4),
    ] {
        let options = |timestep| ExportOptions {
            timestep: Some(timestep),
            integrator: name,
            ..ExportOptions::default()
        };
        let refused = export(&spec, &options(0.002)).unwrap_err();
        let ExportError::Unstable { longest, .. } = refused else {
            panic!("{refused}");
        };
        assert!(export(&spec, &options(0.99 * longest)).is_ok());
        assert!(export(&spec, &options(1.01 * longest)).is_err());
        // Steps shorter than the limit stay near the pose after a push, longer ones leave it. The limit
        // of Runge-Kutta is on the safe side.
        let command = robot.mean_command();
        let fastest = |timestep: f64| {
            let equilibrium = robot.settle(&command, &Loads::default());
            let mut state = State::at_rest(equilibrium.configuration);
            for (joint, rate) in state.velocity.iter_mut().enumerate() {
                *rate = if joint % 2 == 0 { 1e-6 } else { -1e-6 };
            }
            let mut stepper = Stepper::new(&robot, timestep, integrator).unwrap();
            for _ in 0..3_000 {
                if stepper
                    .step(&mut state, &command, &Loads::default())
                    .is_err()
                {
                    return f64::INFINITY;
                }
            }
            state
                .velocity
                .iter()
                .fold(0.0, |most: f64, v| most.max(v.abs()))
        };
        assert!(fastest(0.98 * longest) < 1e-3);
        assert!(fastest(1.25 * longest) > 1e-2);
    }
}

#[test]
fn a_rod_that_bends_unlike_it_twists_goes_out_and_comes_back() {
    let spec = on_a_rod();
    let model = export(&spec, &ExportOptions::default()).unwrap();
    assert!(
        model.contains("<joint type=\"hinge\" axis=\"0 0 1\""),
        "{model}"
    );
    let imported = import_text(&model).unwrap();
    assert!(imported.notes.is_empty(), "{:?}", imported.notes);
    let (ours, theirs) = (
        Robot::new(spec).unwrap(),
        Robot::new(imported.spec).unwrap(),
    );
    assert_same_robot(&ours, &theirs);
}

#[test]
fn the_keyframe_is_the_pose_that_a_command_settles_in() {
    let spec = RobotSpec::standard("2m").unwrap();
    let robot = Robot::new(spec.clone()).unwrap();
    let values = vec![0.01, 0.02, 0.03, 0.0, 0.02, 0.04];
    let with = |command| ExportOptions {
        command: Some(command),
        ..ExportOptions::default()
    };
    let model = export(&spec, &with(values.clone())).unwrap();
    assert!(
        model.contains("ctrl=\"0.01 0.02 0.03 0 0.02 0.04\""),
        "{model}"
    );
    let start = model.find("qpos=\"").unwrap() + 6;
    let qpos = model[start..].split('"').next().unwrap();
    let qpos: Vec<f64> = qpos.split(' ').map(|x| x.parse().unwrap()).collect();
    let command = robot.command(&values).unwrap();
    let settled = robot.settle(&command, &Loads::default()).configuration;
    for (q, numbers) in settled.0.iter().zip(qpos.as_chunks::<4>().0) {
        let [w, i, j, k] = *numbers;
        assert!(w > 0.0);
        let same = (q.w * w + q.i * i + q.j * j + q.k * k).abs();
        assert!((same - 1.0).abs() < 1e-12, "{same}");
    }
    let refused = export(&spec, &with(vec![0.1; 6])).unwrap_err().to_string();
    assert!(refused.contains("command entry 1 is 0.1 m"), "{refused}");
}

/// A model of two discs, each on these joints.
fn on_joints(joints: &str) -> String {
    let disc = |name: &str, within: &str| {
        format!(
            "<body name=\"{name}\" pos=\"0 0 0.02\">{joints}<geom type=\"cylinder\" \
             size=\"0.02 0.005\" contype=\"0\" conaffinity=\"0\"/>{within}</body>"
        )
    };
    let chain = disc("lower", &disc("upper", ""));
    format!(
        "<mujoco><compiler angle=\"radian\"/><worldbody><body mocap=\"true\">{chain}</body>\
         </worldbody></mujoco>"
    )
}

#[test]
fn hinges_at_one_place_are_read_in_their_order() {
    let read = |joints: &str| {
        let imported = import_text(&on_joints(joints)).unwrap();
        let disc = Robot::new(imported.spec).unwrap().discs()[1].clone();
        let notes = imported.notes.iter().map(ToString::to_string);
        (disc, notes.collect::<Vec<_>>().join("\n"))
    };
    let z = "<joint axis=\"0 0 1\" stiffness=\"0.3\" damping=\"0.1\" armature=\"0.02\"/>";
    let x = "<joint axis=\"1 0 0\" stiffness=\"0.1\" damping=\"0.1\"/>";
    let y =
        "<joint axis=\"0 -2 0\" stiffness=\"0.2\" damping=\"0.1\" springref=\"0.3\" ref=\"0.1\"/>";
    let (disc, notes) = read(&format!("{z}{x}{y}"));
    let hinges = disc.hinges.as_ref().unwrap();
    assert_eq!(hinges.count, 3);
    assert_eq!(hinges.axes, [Vector3::z(), Vector3::x(), -Vector3::y()]);
    assert_eq!(hinges.stiffness.as_slice(), [0.3, 0.1, 0.2]);
    assert_eq!(hinges.damping.as_slice(), [0.1; 3]);
    assert_eq!(hinges.armature.as_slice(), [0.02, 0.0, 0.0]);
    assert!((hinges.rest - Vector3::new(0.0, 0.0, 0.2)).norm() < 1e-15);
    assert!(disc.backbone.is_none());
    assert!(!notes.contains("<joint>"), "{notes}");
    assert!(
        notes.contains("<body>: a mocap body: read as fixed"),
        "{notes}"
    );
    // Two, of any directions, and one alone.
    let (disc, _) = read(&format!("{x}<joint axis=\"0.2 1 1\"/>"));
    assert_eq!(disc.hinges.unwrap().count, 2);
    let (disc, _) = read(x);
    assert_eq!(disc.hinges.unwrap().count, 1);

    let refused = |joints: &str| import_text(&on_joints(joints)).unwrap_err().to_string();
    for (joints, expected) in [
        (
            format!("{x}{x}"),
            "parallel to that of hinge 0; expected another direction",
        ),
        (
            format!("{x}{y}{x}"),
            "at the angles 0 the joint is in gimbal lock",
        ),
        (format!("{x}{y}{z}{y}"), "or one to three hinges"),
        (
            format!("{x}{y}<joint type=\"ball\" stiffness=\"0.1\"/>{y}"),
            "hinges about two of",
        ),
        (
            format!("{x}<joint axis=\"0 1 0\" pos=\"0 0 0.01\" damping=\"0.1\"/>"),
            "lies beside the body's first joint",
        ),
        (
            "<joint axis=\"0 1 1\"/><joint type=\"ball\" stiffness=\"0.1\"/>".to_owned(),
            "beside a ball joint: expected an axis along x, y or z",
        ),
        (
            "<joint axis=\"0 0 0\"/>".to_owned(),
            "attribute axis=\"0 0 0\": expected a direction",
        ),
        (
            "<joint axis=\"1 0 0\" range=\"-1 1\"/>".to_owned(),
            "MuJoCo's limits are not springs as they are here",
        ),
        (
            "<joint type=\"slide\"/>".to_owned(),
            "type=\"slide\": expected ball or hinge",
        ),
    ] {
        let said = refused(&joints);
        assert!(said.contains(expected), "{said}\nnot\n{expected}");
    }
}

/// Universal joints about x, then y: at rest MuJoCo 4.0.0 has the tip there.
#[test]
fn universal_joints_settle_where_mujoco_rests() {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/by_hand/universal_joints.xml");
    let imported = import(&path).unwrap();
    let robot = Robot::new(imported.spec).unwrap();
    let command = robot.command(&[0.14, 0.14, 0.18, 0.18]).unwrap();
    let settled = robot.settle(&command, &Loads::default());
    assert!(settled.converged);
    let tip = settled.positions[9];
    let apart = (tip - Vector3::new(0.08587, 0.07468, 0.05242)).amax();
    assert!(apart < 6e-6, "{tip:?}");
    // There and back.
    let text = export(robot.spec(), &ExportOptions::default()).unwrap();
    assert!(export_notes(robot.spec()).unwrap().is_empty());
    let again = Robot::new(import_text(&text).unwrap().spec).unwrap();
    for (a, b) in robot.discs().iter().zip(again.discs()) {
        assert_eq!(a.hinges, b.hinges);
    }
}

/// The camera of a model of two discs where its attributes put it, in MuJoCo's camera frame, and the notes.
fn camera(attributes: &str) -> (Isometry3<f64>, String) {
    let text = on_joints("<joint type=\"ball\"/>");
    let camera = format!("<worldbody><camera {attributes}/>");
    let imported = import_text(&text.replace("<worldbody>", &camera)).unwrap();
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let pose = Camera::placed(&imported.spec.cameras)[0].pose;
    let notes = imported.notes.iter().map(ToString::to_string);
    let notes: Vec<_> = notes.filter(|note| note.contains("<camera")).collect();
    (pose * half_turn, notes.join("\n"))
}

/// The discs' origins are at z = 0.02 and 0.04, their masses alike. MuJoCo's own poses are compared in Python.
#[test]
fn cameras_stand_and_look_as_they_do_in_mujoco_at_the_start() {
    let place = Vector3::new(0.4, 0.0, 0.1);
    let looks_at = |attributes: &str, point: Vector3<f64>| {
        let (pose, notes) = camera(&format!("pos=\"0.4 0 0.1\" {attributes}"));
        assert!((pose.translation.vector - place).norm() < 1e-12);
        let along = pose.rotation * -Vector3::z();
        assert!(
            (along - (point - place).normalize()).norm() < 1e-12,
            "{attributes}: {along}"
        );
        assert!((pose.rotation * Vector3::x()).z.abs() < 1e-12, "level");
        assert!(
            notes.contains("turns after its target in MuJoCo"),
            "{notes}"
        );
    };
    looks_at(
        "mode=\"targetbody\" target=\"upper\"",
        Vector3::new(0.0, 0.0, 0.04),
    );
    looks_at(
        "mode=\"targetbodycom\" target=\"lower\"",
        Vector3::new(0.0, 0.0, 0.03),
    );
    // Where it is, turned as it says.
    for mode in ["fixed", "track", "trackcom"] {
        let (pose, notes) = camera(&format!(
            "pos=\"0.4 0 0.1\" xyaxes=\"0 1 0 0 0 1\" mode=\"{mode}\""
        ));
        assert!((pose.translation.vector - place).norm() < 1e-12);
        assert!((pose.rotation * Vector3::z() - Vector3::x()).norm() < 1e-12);
        assert_eq!(
            notes.contains("follows a centre of mass"),
            mode == "trackcom"
        );
    }
    // From the target's centre of mass, at 0.04, to that of all, at 0.03.
    let (pose, _) = camera("pos=\"0.4 0 0.1\" mode=\"trackcom\" target=\"upper\"");
    assert!((pose.translation.vector - Vector3::new(0.4, 0.0, 0.09)).norm() < 1e-12);
}

#[test]
fn orthographic_cameras_are_left_out_by_name() {
    let text = on_joints("<joint type=\"ball\"/>");
    for attribute in [
        "projection=\"orthographic\" fovy=\"0.2\"",
        "orthographic=\"true\"",
    ] {
        let camera = format!("<worldbody><camera pos=\"0.4 0 0.05\" {attribute}/>");
        let imported = import_text(&text.replace("<worldbody>", &camera)).unwrap();
        let notes = imported.notes.iter().map(ToString::to_string);
        let notes = notes.collect::<Vec<_>>().join("\n");
        assert!(
            notes.contains("<camera>: left out: its projection is orthographic"),
            "{notes}"
        );
        assert!(
            notes.contains("8 around the robot in their place"),
            "{notes}"
        );
    }
    let wrong = text.replace(
        "<worldbody>",
        "<worldbody><camera mode=\"targetbody\" target=\"nobody\"/>",
    );
    let said = import_text(&wrong).unwrap_err().to_string();
    assert!(
        said.contains("target=\"nobody\": expected the name of a body"),
        "{said}"
    );
}

#[test]
fn an_export_of_bending_unlike_torsion_says_so() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    assert!(export_notes(&spec).unwrap().is_empty());
    spec.modules[1].backbone = Some(PerDisc::Uniform(Backbone {
        torsion: 0.15,
        ..Backbone::isotropic(0.05)
    }));
    let notes = export_notes(&spec).unwrap();
    assert!(
        notes[0].contains("differ at 5 joints, by up to 3.000 times"),
        "{notes:?}"
    );
}

#[test]
fn geoms_that_can_touch_are_read_with_a_note() {
    let model = on_joints("<joint type=\"ball\"/>").replace(" contype=\"0\" conaffinity=\"0\"", "");
    let model = model.replace(
        "</worldbody>",
        "</worldbody><contact><pair geom1=\"a\"/></contact>",
    );
    let notes = import_text(&model).unwrap().notes;
    let said: Vec<String> = notes.iter().map(ToString::to_string).collect();
    let expected = "<geom>: contacts are left out, with all 2 geoms that can touch others";
    assert!(said.iter().any(|note| note.contains(expected)), "{said:?}");
}
