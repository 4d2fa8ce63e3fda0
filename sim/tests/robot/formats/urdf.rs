//! URDF there and back.

use proptest::prelude::*;
use tdcr_sim::formats::urdf::{export, import_text};
use tdcr_sim::robot::{Backbone, Limit, MassSpec, PerDisc, RigidMass, Robot, RobotSpec};

use super::{assert_same_chain, random_robot};

/// The text without the element that holds what URDF cannot say.
fn links_alone(text: &str) -> String {
    let (start, end) = (text.find("<tdcr>").unwrap(), text.find("</tdcr>").unwrap());
    format!("{}{}", &text[..start], &text[end + "</tdcr>".len()..])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn random_robots_come_back_as_the_same_specification(seed: u64) {
        let robot = random_robot(seed);
        let imported = import_text(&export(robot.spec()).unwrap()).unwrap();
        prop_assert_eq!(&imported.spec, robot.spec());
        prop_assert!(imported.notes.is_empty());
    }

    #[test]
    fn links_and_joints_alone_come_back_as_the_same_chain(seed: u64) {
        let robot = random_robot(seed);
        let imported = import_text(&links_alone(&export(robot.spec()).unwrap())).unwrap();
        let chain = Robot::new(imported.spec).unwrap();
        assert_same_chain(&robot, &chain);
        prop_assert_eq!(chain.tendons().len(), 0);
        prop_assert!(imported.notes[0].to_string().contains("the robot has no tendons"));
    }
}

#[test]
fn what_only_the_extension_holds_comes_back() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.modules[0].backbone = Some(PerDisc::Uniform(Backbone::round_rod(1e9, 4e8, 1e-3, 0.017)));
    spec.modules[1].limit = Some(PerDisc::Uniform(Limit {
        angle: 0.5,
        stiffness: 2.0,
    }));
    assert_eq!(import_text(&export(&spec).unwrap()).unwrap().spec, spec);
}

#[test]
fn the_mass_of_a_rod_comes_back_with_the_links_that_carry_it() {
    let file = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../examples/three-segments.toml"
    );
    let robot = Robot::load(file).unwrap();
    let text = export(robot.spec()).unwrap();
    assert_eq!(&import_text(&text).unwrap().spec, robot.spec());
    let chain = Robot::new(import_text(&links_alone(&text)).unwrap().spec).unwrap();
    assert_same_chain(&robot, &chain);
}

#[test]
fn links_that_disagree_with_the_extension_are_named() {
    let spec = RobotSpec::standard("2m").unwrap();
    let text = export(&spec).unwrap();
    let said = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        let changed = text.replacen(from, to, 1);
        import_text(&changed).unwrap_err().to_string()
    };
    let message = said("xyz=\"0 0 0.00895\"", "xyz=\"0 0 0.009\"");
    assert!(
        message.contains("link `disc0` or a joint below it is not what <tdcr> says"),
        "{message}"
    );
    let message = said("xyz=\"0 0 0.174\"", "xyz=\"0 0 0.2\"");
    assert!(
        message.contains("the pose of link `base` is not what <tdcr> says"),
        "{message}"
    );
}

#[test]
fn what_is_no_chain_of_discs_is_named() {
    let spec = RobotSpec::standard("2m").unwrap();
    let text = links_alone(&export(&spec).unwrap());
    for (from, to, expected) in [
        (
            "<axis xyz=\"0 1 0\"",
            "<axis xyz=\"1 0 0\"",
            "<joint name=\"disc0_y\">: its axis is 1 0 0; expected the axes x, y and z",
        ),
        (
            "type=\"revolute\"",
            "type=\"prismatic\"",
            "<joint name=\"disc0_x\">: expected a revolute or continuous joint",
        ),
        (
            "damping=\"0.1\"",
            "damping=\"0.2\"",
            "<joint name=\"disc0_z\">: expected the same damping",
        ),
        (
            "<child link=\"disc0_x\"",
            "<child link=\"disc1_x\"",
            "expected a link of the robot as its parent, and a child of its own",
        ),
        ("</robot>", "", "the text is not a robot description (URDF)"),
    ] {
        assert!(text.contains(from), "{from}");
        let message = import_text(&text.replacen(from, to, 1))
            .unwrap_err()
            .to_string();
        assert!(message.contains(expected), "{message}\nnot\n{expected}");
    }
}

/// A chain of links on triples of joints, each disc with these elements, each link between with those.
fn chain(discs: usize, disc: &str, between: &str) -> String {
    let mut text = String::from("<robot name=\"r\"><link name=\"base\"/>");
    let mut below = "base".to_owned();
    for d in 0..discs {
        for (axis, vector, height) in [
            ("x", "1 0 0", 0.03),
            ("y", "0 1 0", 0.0),
            ("", "0 0 1", 0.0),
        ] {
            let (name, own) = (
                format!("d{d}{axis}"),
                if axis.is_empty() { disc } else { between },
            );
            text += &format!(
                "<link name=\"{name}\">{own}</link><joint name=\"j{name}\" type=\"continuous\"><parent link=\"{below}\"/>\
                 <child link=\"{name}\"/><origin xyz=\"0 0 {height}\"/><axis xyz=\"{vector}\"/>\
                 <dynamics damping=\"0.01\"/></joint>"
            );
            below = name;
        }
    }
    text + "</robot>"
}

const SEEN: &str =
    "<visual><geometry><cylinder radius=\"0.02\" length=\"0.008\"/></geometry></visual>";
const HEAVY: &str = "<inertial><mass value=\"0.01\"/><inertia ixx=\"2e-6\" iyy=\"2e-6\" izz=\"3e-6\" ixy=\"0\" ixz=\"0\" \
                     iyz=\"0\"/></inertial>";

#[test]
fn links_that_weigh_nothing_are_named_in_a_note() {
    let imported = import_text(&chain(2, SEEN, "")).unwrap();
    let notes: Vec<String> = imported.notes.iter().map(ToString::to_string).collect();
    assert_eq!(notes.len(), 2, "{notes:?}");
    assert!(
        notes[1].contains("`d0`, `d1` (links): no mass"),
        "{notes:?}"
    );
    let robot = Robot::new(imported.spec).unwrap();
    assert!(robot.discs().iter().all(|disc| disc.mass == 0.0));
    // With masses nothing is said of them, but of moments that only links between joints have.
    let solid = format!("{SEEN}{HEAVY}");
    assert_eq!(import_text(&chain(2, &solid, "")).unwrap().notes.len(), 1);
    let turning = HEAVY.replace("0.01", "1e-9");
    let notes = import_text(&chain(1, &solid, &turning)).unwrap().notes;
    assert!(
        notes[1]
            .to_string()
            .contains("`d0x`, `d0y` (links): the moments of inertia"),
        "{notes:?}"
    );
}

#[test]
fn numbers_that_no_robot_has_are_refused_where_they_stand() {
    let solid = format!("{SEEN}{HEAVY}");
    let good = chain(1, &solid, "");
    import_text(&good).unwrap();
    for (from, to, expected) in [
        (
            "mass value=\"0.01\"",
            "mass value=\"NaN\"",
            "<link name=\"d0\">: the mass is NaN; expected finite",
        ),
        (
            "mass value=\"0.01\"",
            "mass value=\"inf\"",
            "<link name=\"d0\">: the mass is inf; expected finite",
        ),
        (
            "mass value=\"0.01\"",
            "mass value=\"-1\"",
            "<link name=\"d0\">: the mass is -1; expected 0",
        ),
        (
            "ixx=\"2e-6\"",
            "ixx=\"-2e-6\"",
            "<link name=\"d0\">: a moment of inertia is -0.000002",
        ),
        (
            "ixx=\"2e-6\"",
            "ixx=\"6e-6\"",
            "<link name=\"d0\">: the moments of inertia are 0.000006",
        ),
        (
            "ixy=\"0\"",
            "ixy=\"nan\"",
            "<link name=\"d0\">: the inertia is NaN",
        ),
        (
            "radius=\"0.02\"",
            "radius=\"0\"",
            "<link name=\"d0\">: the cylinder's radius is 0; expected",
        ),
        (
            "length=\"0.008\"",
            "length=\"-1\"",
            "<link name=\"d0\">: the cylinder's length is -1; expected",
        ),
        (
            "damping=\"0.01\"",
            "damping=\"-0.01\"",
            "<joint name=\"jd0x\">: the damping is -0.01; expected 0",
        ),
        (
            "damping=\"0.01\"",
            "damping=\"nan\"",
            "<joint name=\"jd0x\">: the damping is NaN",
        ),
        (
            "xyz=\"0 0 0.03\"",
            "xyz=\"0 nan 0.03\"",
            "<joint name=\"jd0x\">: the origin xyz is NaN",
        ),
        (
            "xyz=\"0 0 0.03\"",
            "xyz=\"0 0 inf\"",
            "<joint name=\"jd0x\">: the origin xyz is inf",
        ),
        (
            "xyz=\"1 0 0\"",
            "xyz=\"2 0 0\"",
            "<joint name=\"jd0x\">: its axis is 2 0 0; expected",
        ),
        (
            "xyz=\"1 0 0\"",
            "xyz=\"nan 0 0\"",
            "<joint name=\"jd0x\">: the axis xyz is NaN",
        ),
        (
            "link name=\"d0x\"",
            "link name=\"d0y\"",
            "<link name=\"d0y\">: there are two of this name",
        ),
    ] {
        assert!(good.contains(from), "{from}");
        let message = import_text(&good.replacen(from, to, 1))
            .unwrap_err()
            .to_string();
        assert!(message.contains(expected), "{message}\nnot\n{expected}");
    }
    for none in [
        "<robot name=\"r\"><link name=\"base\"/></robot>",
        &chain(0, "", ""),
    ] {
        let message = import_text(none).unwrap_err().to_string();
        assert!(
            message.contains("<robot name=\"r\">: no joint turns; expected three"),
            "{message}"
        );
    }
    // A mass in the wrong place: the disc's link is named, and the one that has it.
    let message = import_text(&chain(1, SEEN, HEAVY)).unwrap_err().to_string();
    let expected =
        "<link name=\"d0\">: it has no mass, and link `d0x` between its joints has 0.01 kg";
    assert!(message.contains(expected), "{message}");
    let message = import_text(&chain(1, &solid, HEAVY))
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("<link name=\"d0x\">: its mass is 0.01 kg; expected almost none"),
        "{message}"
    );
}

/// What is written can be read again, or is not written.
#[test]
fn moments_of_inertia_that_no_body_has_are_not_written() {
    let mut spec = RobotSpec::standard("2m").unwrap();
    spec.modules[0].mass = MassSpec::Rigid(PerDisc::Uniform(RigidMass {
        mass: 0.01,
        inertia: [1e-6, 1e-6, 3e-6],
        ..RigidMass::default()
    }));
    let message = export(&spec).unwrap_err().to_string();
    assert!(message.contains("mass of disc 0"), "{message}");
}
