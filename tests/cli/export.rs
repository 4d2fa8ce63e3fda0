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
    for option in [
        &["--base"][..],
        &["--payload", "0.02"],
        &["--dt", "0.001"],
        &["--integrator", "rk4"],
    ] {
        let arguments = [&["export", "--format", "urdf"], option].concat();
        refuse(&arguments, 1, "--attach go with --format mjcf");
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
    fs::write(&file, model.replacen("type=\"ball\"", "type=\"slide\"", 1)).unwrap();
    settle(&format!(
        "{}, line 29, <joint>: attribute type=\"slide\": expected ball or hinge",
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

#[test]
fn a_file_in_the_way_is_replaced_only_with_force() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("keep.toml");
    let own = format!("# mine\n{}", succeed(&["export", "--format", "toml"]));
    fs::write(&file, &own).unwrap();
    let export = [
        "export",
        "--robot",
        text(&file),
        "--format",
        "toml",
        "--out",
        text(&file),
    ];
    refuse(
        &export,
        1,
        "keep.toml is there already; --force replaces it",
    );
    assert_eq!(fs::read_to_string(&file).unwrap(), own);
    succeed(&[&export[..], &["--force"]].concat());
    assert!(!fs::read_to_string(&file).unwrap().contains("# mine"));
}

/// The 2m robot on a rod of steel, in a file.
fn on_a_rod(folder: &std::path::Path) -> std::path::PathBuf {
    let file = folder.join("rod.toml");
    let spec = succeed(&["export", "--format", "toml"]);
    let rod = "armature = 1e-7\nbackbone = { bending = [0.5, 0.5], torsion = 0.385 }";
    let spec = spec
        .replace("armature = 0.01", rod)
        .replace("damping = 0.1", "damping = 1e-4");
    fs::write(&file, spec).unwrap();
    file
}

#[test]
fn a_stiff_rod_gets_a_stable_time_step_or_is_refused_with_the_limit() {
    let folder = tempfile::tempdir().unwrap();
    let file = on_a_rod(folder.path());
    let model = succeed(&["export", "--robot", text(&file)]);
    assert!(
        model.contains("timestep=\"0.0002\" integrator=\"Euler\""),
        "{model}"
    );
    for integrator in ["euler", "implicitfast", "implicit", "rk4"] {
        let options = [
            "export",
            "--robot",
            text(&file),
            "--integrator",
            integrator,
            "--dt",
        ];
        let expected = "a time step of 0.002 s is not stable: with MuJoCo's";
        refuse(&[&options[..], &["0.002"]].concat(), 1, expected);
        let model = succeed(&[&options[..], &["0.0003"]].concat());
        assert!(model.contains("timestep=\"0.0003\""), "{model}");
    }
    let command = ["export", "--command", "0.01,0.02,0.03,0.02,0.02,0.02"];
    let model = succeed(&command);
    assert!(
        model.contains("ctrl=\"0.01 0.02 0.03 0.02 0.02 0.02\""),
        "{model}"
    );
    refuse(
        &["export", "--command", "1,2"],
        1,
        "the command has 2 entries",
    );
}

#[cfg(unix)]
#[test]
fn a_device_is_no_robot_however_it_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let settle = |file: &std::path::Path| {
        let expected = "not a regular file";
        refuse(
            &["settle", "--robot", text(file), "--command", COMMAND],
            1,
            expected,
        );
    };
    for extension in ["toml", "json", "xml", "urdf"] {
        let file = folder.path().join(format!("zero.{extension}"));
        std::os::unix::fs::symlink("/dev/zero", &file).unwrap();
        settle(&file);
    }
    let file = folder.path().join("includes.xml");
    fs::write(&file, "<mujoco><include file=\"/dev/zero\"/></mujoco>").unwrap();
    settle(&file);
    let out = folder.path().join("views");
    let render = [
        "render",
        "--command",
        COMMAND,
        "--base-mesh",
        "/dev/zero",
        "--out",
        text(&out),
    ];
    refuse(&render, 1, "cannot read mesh /dev/zero: not a regular file");
}

#[test]
fn the_help_of_every_robot_option_names_all_kinds_of_files() {
    for command in ["settle", "simulate", "collect", "export", "render"] {
        let help = succeed(&[command, "--help"]);
        for kind in [".toml", ".json", ".xml", ".urdf"] {
            assert!(help.contains(kind), "{command}: {help}");
        }
    }
}

#[test]
fn a_model_with_obstacles_is_read_back_as_robot_and_scene() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let scene = at("scene.toml");
    let obstacles = "[[obstacle]]\nname = \"post\"\ncylinder = { radius = 0.01, length = 0.4 }\nposition = [-0.06, 0.0, 0.25]\n\
                     friction = 0.25\n[[obstacle]]\nname = \"tube\"\npipe = { radius = 0.05, length = 0.1 }\nposition = [0, 0, 0.5]\n";
    fs::write(&scene, obstacles).unwrap();
    let model = at("model.xml");
    let export = [
        "export",
        "--scene",
        text(&scene),
        "--command",
        COMMAND,
        "--out",
        text(&model),
    ];
    let output = tdcr(&export).output().unwrap();
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    for words in [
        "obstacle `tube`: left out: MuJoCo has no pipes",
        "solref and solimp",
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
    // The robot is what it is without obstacles.
    let plain = at("plain.xml");
    succeed(&["export", "--command", COMMAND, "--out", text(&plain)]);
    let robot_of =
        |model: &std::path::Path| succeed(&["export", "--robot", text(model), "--format", "json"]);
    assert_eq!(robot_of(&model), robot_of(&plain));
    let mut settle = tdcr(&["settle", "--robot", text(&model), "--command", COMMAND]);
    let said = stderr(&settle.output().unwrap());
    assert!(
        said.contains("robots here touch with beads of their own, in a scene"),
        "{said}"
    );
    // The obstacle as it was, but for the compliance.
    let read = succeed(&["export", "--robot", text(&model), "--format", "scene"]);
    for line in ["name = \"post\"", "friction = 0.25", "-0.06"] {
        assert!(read.contains(line), "{line}: {read}");
    }
    assert!(!read.contains("tube"));
    let settled = |scene: &std::path::Path| {
        succeed_json(&["settle", "--command", COMMAND, "--scene", text(scene)])
    };
    let (own, by_model) = (settled(&scene), settled(&model));
    assert!(!own["contacts"].as_array().unwrap().is_empty());
    assert_eq!(own["positions"], by_model["positions"]);
    assert_eq!(own["contacts"], by_model["contacts"]);
}

#[test]
fn scenes_go_with_models_of_mujoco_alone() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    fs::write(&scene, "[[obstacle]]\nhalf_space = {}\n").unwrap();
    refuse(
        &["export", "--format", "urdf", "--scene", text(&scene)],
        1,
        "--attach go with --format mjcf",
    );
    refuse(
        &["export", "--format", "scene"],
        1,
        "--robot 2m has no obstacles; expected a MuJoCo model (.xml)",
    );
    let inside =
        "[[obstacle]]\nname = \"ball\"\nsphere = { radius = 0.05 }\nposition = [0, 0, 0.2]\n";
    fs::write(&scene, inside).unwrap();
    refuse(
        &["export", "--scene", text(&scene)],
        1,
        "starts inside obstacle \"ball\"",
    );
}
