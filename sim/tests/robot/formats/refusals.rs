//! What cannot be represented, and how it is said.

use tdcr_sim::camera::Distortion;
use tdcr_sim::formats::mjcf::{ExportOptions, export, import_text};
use tdcr_sim::robot::{
    Aim, CameraSpec, Cameras, Drive, Fluid, Friction, Lens, Limit, MassSpec, PerDisc, PinholeSpec,
    Pull, RigidMass, RobotSpec, ServoSpec,
};

fn model() -> String {
    let spec = RobotSpec::standard("2m").unwrap();
    export(&spec, &ExportOptions::default()).unwrap()
}

#[test]
fn a_camera_that_mujoco_cannot_represent_is_named_by_its_field() {
    let camera = CameraSpec {
        position: [0.4, 0.0, 0.3],
        aim: Aim::At([0.0, 0.0, 0.2]),
        lens: Lens::Fovy(40.0),
        resolution: [320, 240],
        distortion: None,
    };
    let pixels = |focal, principal| Lens::Pixels(PinholeSpec { focal, principal });
    let bent = Distortion {
        k1: 0.1,
        ..Distortion::default()
    };
    let cases: [(CameraSpec, &str); 4] = [
        (
            CameraSpec {
                distortion: Some(bent),
                ..camera.clone()
            },
            "`cameras[1].distortion` is [0.1, 0.0, 0.0, 0.0, 0.0]; MuJoCo takes lenses without",
        ),
        (
            CameraSpec {
                resolution: [640, 480],
                ..camera.clone()
            },
            "`cameras[1].resolution` is [640, 480]; MuJoCo takes the same resolution for all",
        ),
        (
            CameraSpec {
                lens: pixels([300.0, 301.0], [159.5, 119.5]),
                ..camera.clone()
            },
            "`cameras[1].lens.pixels.focal` is [300.0, 301.0]; MuJoCo takes equal focal lengths",
        ),
        (
            CameraSpec {
                lens: pixels([300.0, 300.0], [159.5, 120.0]),
                ..camera.clone()
            },
            "`cameras[1].lens.pixels.principal` is [159.5, 120.0]; MuJoCo takes a principal point",
        ),
    ];
    let mut spec = RobotSpec::standard("2m").unwrap();
    for (second, expected) in cases {
        spec.cameras = Cameras::Free(vec![camera.clone(), second]);
        let message = export(&spec, &ExportOptions::default())
            .unwrap_err()
            .to_string();
        assert!(message.contains(expected), "{message}");
    }
    // A centred pinhole is a field of view, and an absent distortion none.
    let centred = CameraSpec {
        lens: pixels([300.0, 300.0], [159.5, 119.5]),
        distortion: Some(Distortion::default()),
        ..camera.clone()
    };
    spec.cameras = Cameras::Free(vec![camera, centred]);
    let model = export(&spec, &ExportOptions::default()).unwrap();
    let fovy = 2.0 * (120.0f64 / 300.0).atan().to_degrees();
    assert!(model.contains(&format!("fovy=\"{fovy}\"")), "{model}");
    let mut spec = RobotSpec::standard("2m").unwrap();
    if let Cameras::Ring(ring) = &mut spec.cameras {
        ring.distortion = Some(bent);
    }
    let message = export(&spec, &ExportOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("`cameras.distortion` is [0.1"),
        "{message}"
    );
}

#[test]
fn what_mujoco_cannot_represent_is_named_by_its_field() {
    type Change = fn(&mut RobotSpec);
    let cases: [(Change, &str); 11] = [
        (
            |s| {
                s.modules[0].limit = Some(PerDisc::Uniform(Limit {
                    angle: 0.3,
                    stiffness: 1.0,
                }));
            },
            "`modules[0].limit` is a spring",
        ),
        (
            |s| {
                s.modules[1].tendons.as_mut().unwrap().friction = Some(Friction {
                    coefficient: 0.1,
                    contact_stiffness: 1e5,
                });
            },
            "`modules[1].tendons.friction` is a coefficient above 0",
        ),
        (
            |s| {
                s.fluid = Some(Fluid {
                    density: 998.0,
                    drag_coefficient: 1.0,
                });
            },
            "`fluid` is a fluid",
        ),
        (
            |s| s.modules[0].tendons.as_mut().unwrap().servo = Some(ServoSpec::default()),
            "`modules[0].tendons.servo` is a servo",
        ),
        (
            |s| s.modules[0].tendons.as_mut().unwrap().drive = Drive::Length,
            "`modules[0].tendons.drive` is `length`; MuJoCo takes an `axial_stiffness` with it",
        ),
        (
            |s| s.modules[0].mass = MassSpec::Density(PerDisc::Each(vec![1.0, 1.0, 0.0, 1.0, 1.0])),
            "`modules[0].mass.density[2]` is 0e0 kg; MuJoCo takes masses of discs above",
        ),
        (
            |s| s.modules[1].mass = MassSpec::Density(PerDisc::Uniform(1e-9)),
            "`modules[1].mass.density` is",
        ),
        (
            |s| {
                s.modules[0].mass = MassSpec::Rigid(PerDisc::Uniform(RigidMass {
                    mass: 0.1,
                    inertia: [1e-6, 1e-6, 3e-6],
                    ..RigidMass::default()
                }));
            },
            "`modules[0].mass.rigid` is 1e-6, 1e-6, 3e-6 kg m2; MuJoCo takes moments",
        ),
        (
            |s| s.name = "bell \u{7}".to_owned(),
            "`name` is \"bell \\u{7}\"; MuJoCo takes text without control characters",
        ),
        (
            |s| s.modules[0].discs = 491,
            "`modules` is 496 discs in all; MuJoCo takes 495 discs at most",
        ),
        (|s| s.modules[0].radius = 0.0, "`modules[0].radius` is 0"),
    ];
    for (change, expected) in cases {
        let mut spec = RobotSpec::standard("2m").unwrap();
        change(&mut spec);
        let message = export(&spec, &ExportOptions::default())
            .unwrap_err()
            .to_string();
        assert!(message.contains(expected), "{message}\nnot\n{expected}");
    }
}

#[test]
fn a_tendon_that_only_pulls_has_a_limit_that_no_pull_reaches() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.tendons.as_mut().unwrap().pull = Pull::TensionOnly;
    }
    let text = export(&spec, &ExportOptions::default()).unwrap();
    assert!(
        text.contains("forcelimited=\"true\" forcerange=\"-1000 0\""),
        "{text}"
    );
    assert_eq!(import_text(&text).unwrap().spec, spec);
    let weak = text.replacen("forcerange=\"-1000 0\"", "forcerange=\"-10 0\"", 1);
    let message = import_text(&weak).unwrap_err().to_string();
    assert!(
        message.contains("<position name=\"tendon0\">: attribute forcerange: limits the pull"),
        "{message}"
    );
}

#[test]
fn what_a_robot_cannot_have_is_named_with_its_line() {
    let text = model();
    let joint = "<joint type=\"ball\" damping=\"0.1\" armature=\"0.01\"/>";
    let line = 1 + text[..text.find(joint).unwrap()].matches('\n').count();
    let slide = text.replacen("type=\"ball\"", "type=\"slide\"", 1);
    let message = import_text(&slide).unwrap_err().to_string();
    let expected =
        format!("line {line}, <joint>: attribute type=\"slide\": expected ball or hinge");
    assert!(message.contains(&expected), "{message}\nnot\n{expected}");

    let free = "<joint type=\"ball\" frictionloss=\"1\"/>";
    let limited = "<joint type=\"ball\" range=\"0 1\"/>";
    let disc = "<geom type=\"cylinder\" size=\"0.02 0.0085\" density=\"25\"";
    for (from, to, expected) in [
        (
            joint,
            free,
            "<joint>: attribute frictionloss=\"1\": robots here have none",
        ),
        (joint, limited, "<joint>: attribute range=\"0 1\""),
        (joint, "<freejoint/>", "<freejoint>: expected a ball joint"),
        (
            disc,
            "<geom type=\"mesh\"",
            "attribute type=\"mesh\": expected sphere, capsule",
        ),
        (
            disc,
            "<geom size=\"-1\"",
            "attribute size=\"-1\": expected 1 numbers above 0",
        ),
        (
            disc,
            "<geom size=\"1 two\"",
            "attribute size=\"1 two\": expected finite numbers",
        ),
        (
            disc,
            "<geom class=\"none\"",
            "there is no default class `none`",
        ),
        (
            disc,
            "<geom colour=\"red\"",
            "attribute colour=\"red\": an attribute that is not known",
        ),
        (
            "name=\"disc3\" pos=\"0 0",
            "name=\"disc3\" pos=\"0.1 0",
            "<body name=\"disc3\">: lies beside",
        ),
        (
            "name=\"disc3\"",
            "name=\"disc3\" quat=\"1 1 0 0\"",
            "<body name=\"disc3\">: turned against",
        ),
        (
            "name=\"disc3_1\" pos=\"-0.00625 0.010825 0\"",
            "name=\"disc3_1\" pos=\"0 0 1\"",
            "<site name=\"disc3_1\">: lies 1 m above",
        ),
        (
            "name=\"disc3_1\"",
            "name=\"disc3_0\"",
            "<site name=\"disc3_0\">: there are two sites",
        ),
        (
            "<site site=\"disc4_0\"/>",
            "<geom geom=\"x\"/>",
            "<geom>: expected <site>: tendons are straight",
        ),
        (
            "<site site=\"disc4_0\"/>",
            "<site site=\"nowhere\"/>",
            "<site>: attribute site=\"nowhere\": expected the name",
        ),
        (
            "<spatial",
            "<spatial stiffness=\"10\"",
            "<spatial name=\"tendon0\">: attribute stiffness=\"10\"",
        ),
        (
            "kp=\"500\"",
            "kp=\"500\" kv=\"1\"",
            "<position name=\"tendon0\">: attribute kv=\"1\"",
        ),
        (
            "kp=\"500\"",
            "kp=\"-500\"",
            "expected a force that changes with ctrl",
        ),
        (
            "ctrllimited=\"true\"",
            "ctrllimited=\"false\"",
            "expected ctrllimited=\"true\"",
        ),
        (
            "ctrlrange=\"0 0.04\"",
            "ctrlrange=\"-1 0.04\"",
            "commands from -1 to 0.04",
        ),
        (
            "tendon=\"tendon1\"",
            "tendon=\"tendon0\"",
            "expected the name of a tendon that no other",
        ),
        (
            "tendon=\"tendon1\"",
            "joint=\"tendon0\"",
            "expected an actuator on a tendon",
        ),
        (
            "<worldbody>",
            "<equality><weld/></equality><worldbody>",
            "<equality>: a section",
        ),
        (
            "integrator=\"Euler\"",
            "density=\"1.2\"",
            "<option>: attribute density=\"1.2\"",
        ),
        (
            "angle=\"radian\"",
            "settotalmass=\"1\"",
            "attribute settotalmass=\"1\": expected -1",
        ),
        (
            "<worldbody>",
            "<include file=\"x.xml\"/><worldbody>",
            "a text cannot include files",
        ),
        ("</mujoco>", "", "the text is not a MuJoCo model (MJCF)"),
        ("mujoco", "robot", "the text is not a MuJoCo model (MJCF)"),
    ] {
        assert!(text.contains(from), "{from}");
        let message = match import_text(&text.replacen(from, to, 1)) {
            Err(error) => error.to_string(),
            Ok(_) => panic!("{to} was read"),
        };
        assert!(message.contains(expected), "{message}\nnot\n{expected}");
    }
}
