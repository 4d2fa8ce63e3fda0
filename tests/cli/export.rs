//! Robots written for other tools, and read back.

use std::fs;

use crate::{COMMAND, refuse, stderr, succeed, succeed_json, tdcr, text};

#[test]
fn every_format_that_is_written_is_read_as_the_same_robot() {
    let folder = tempfile::tempdir().unwrap();
    let expected = succeed_json(&["settle", "--robot", "2m", "--command", COMMAND]);
    for (format, extension) in [
        ("mjcf", "xml"),
        ("urdf", "urdf"),
        ("json", "json"),
        ("toml", "toml"),
    ] {
        let file = folder.path().join(format!("robot.{extension}"));
        let written = succeed_json(&[
            "export",
            "--robot",
            "2m",
            "--format",
            format,
            "--out",
            text(&file),
        ]);
        assert_eq!(written["bytes"], fs::metadata(&file).unwrap().len());
        let printed = succeed(&["export", "--robot", text(&file), "--format", format]);
        assert_eq!(printed, fs::read_to_string(&file).unwrap(), "{format}");
        let settled = succeed_json(&["settle", "--robot", text(&file), "--command", COMMAND]);
        assert_eq!(settled, expected, "{format}");
    }
}

#[test]
fn base_and_payload_go_into_a_model_alone() {
    let model = succeed(&["export", "--robot", "3m", "--base", "--payload", "0.02"]);
    assert!(
        model.contains("<geom class=\"visual\" type=\"box\""),
        "{model}"
    );
    assert!(model.contains("<body name=\"payload\">") && model.contains("mass=\"0.02\""));
    for option in [&["--base"][..], &["--payload", "0.02"]] {
        let arguments = [&["export", "--format", "urdf"], option].concat();
        refuse(&arguments, 1, "--base and --payload go with --format mjcf");
    }
    refuse(
        &["export", "--payload", "-1"],
        1,
        "the payload is -1 kg; expected a finite mass",
    );
}

#[test]
fn a_model_that_is_no_robot_is_named_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("robot.xml");
    let settle = |expected: &str| {
        refuse(
            &["settle", "--robot", text(&file), "--command", COMMAND],
            1,
            expected,
        );
    };
    settle(&format!("cannot read robot file {}", file.display()));
    let model = succeed(&["export", "--payload", "0.02"]);
    fs::write(&file, &model).unwrap();
    settle("`payload` is 0.02 kg; expected none in a robot file");
    fs::write(&file, model.replacen("type=\"ball\"", "type=\"hinge\"", 1)).unwrap();
    settle(&format!(
        "{}, line 29, <joint>: attribute type=\"hinge\": expected ball",
        file.display()
    ));
    fs::write(&file, "<mujoco>").unwrap();
    settle(&format!("{} is not a MuJoCo model (MJCF)", file.display()));
}

#[test]
fn what_is_passed_over_in_a_model_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("robot.xml");
    fs::write(&file, succeed(&["export", "--base"])).unwrap();
    let output = tdcr(&["export", "--robot", text(&file), "--format", "toml"])
        .output()
        .unwrap();
    let said = stderr(&output);
    assert!(
        said.contains("WARN") && said.contains("geoms that stand still"),
        "{said}"
    );
    assert_eq!(
        String::from_utf8(output.stdout).unwrap(),
        succeed(&["export", "--format", "toml"])
    );
}
