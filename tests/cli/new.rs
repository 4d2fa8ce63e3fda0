//! `tdcr new`: files that load and settle, what one sees of them, and what it refuses.

use std::fs;

use crate::{refuse, succeed, succeed_json, text};

#[test]
fn robots_of_every_kind_settle_bent_under_the_command_that_their_file_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    let file = text(&path);
    for [backbone, servos] in [
        ["steel", "tension"],
        ["steel", "position"],
        ["nitinol", "tension"],
        ["nitinol", "position"],
    ] {
        let kind = [
            "--backbone",
            backbone,
            "--servos",
            servos,
            "--segments",
            "3",
        ];
        let written = succeed_json(&[&["new", file, "--force"], &kind[..]].concat());
        let command = written["command"].as_array().unwrap();
        let command: Vec<String> = command.iter().map(ToString::to_string).collect();
        assert_eq!(command.len(), 9);
        let settled = succeed_json(&["settle", "--robot", file, "--command", &command.join(",")]);
        assert_eq!(settled["converged"], true, "{backbone} {servos}");
        let discs = settled["positions"].as_array().unwrap();
        assert_eq!(discs.len(), 30);
        let [x, y] = [0, 1].map(|axis| discs[29][axis].as_f64().unwrap());
        // Bent, and not fallen over.
        assert!(
            (0.02..0.28).contains(&x.hypot(y)),
            "{backbone} {servos}: {}",
            discs[29]
        );
    }
}

#[test]
fn what_is_asked_for_is_in_the_file_with_comments_on_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("arm \"1\".toml");
    let file = text(&path);
    // Nobody can answer questions here: what is not given is as the help says.
    let said = succeed(&[
        "new",
        file,
        "--discs",
        "7",
        "--tendons",
        "4",
        "--length",
        "0.08",
    ]);
    assert!(said.contains("tdcr settle --robot"), "{said}");
    let spec: serde_json::Value =
        serde_json::from_str(&succeed(&["export", "--robot", file, "--format", "json"])).unwrap();
    assert_eq!(spec["name"], "arm \"1\"");
    let modules = spec["modules"].as_array().unwrap();
    assert_eq!(modules.len(), 2);
    for module in modules {
        assert_eq!(module["discs"], 7);
        let pitch = module["pitch"].as_f64().unwrap();
        assert!((7.0 * pitch - 0.08).abs() < 1e-4, "{pitch}");
        assert_eq!(module["rod"]["youngs"], 200e9);
    }
    let file = fs::read_to_string(&path).unwrap();
    assert!(
        file.lines().filter(|line| line.contains('#')).count() > 10,
        "{file}"
    );
}

#[test]
fn what_is_no_robot_is_refused_and_no_file_is_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    let file = text(&path);
    let json = folder.path().join("mine.json");
    refuse(&["new", text(&json)], 1, "expected the extension .toml");
    refuse(
        &["new", file, "--segments", "0"],
        1,
        "segments is 0; expected 1 to 20",
    );
    refuse(&["new", file, "--tendons", "13"], 1, "expected 1 to 12");
    refuse(&["new", file, "--length", "20"], 1, "at most 10 m");
    refuse(
        &["new", file, "--radius", "0.02"],
        1,
        "the radius of the backbone (m) is 0.02",
    );
    assert!(!path.exists());
    succeed(&["new", file]);
    let before = fs::read(&path).unwrap();
    refuse(&["new", file, "--discs", "5"], 1, "--force replaces it");
    assert_eq!(fs::read(&path).unwrap(), before);
}
