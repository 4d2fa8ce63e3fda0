//! URDF there and back.

use proptest::prelude::*;
use tdcr_sim::formats::urdf::{export, import_text};
use tdcr_sim::robot::{Backbone, Limit, PerDisc, Robot, RobotSpec};

use crate::{assert_same_chain, random_robot};

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
            "<joint name=\"disc0_y\">: expected the axes x, y and z",
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
