//! What `tdcr settle` says of equilibria.

use std::fs;

use crate::{succeed_json, text};

#[test]
fn a_robot_on_equal_tensions_is_said_to_hang() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("tensions.toml");
    let own = "drive = { gain = 500.0 }, range = [0.0, 0.04]";
    let robot = include_str!("../../sim/robots/2m.toml");
    let pulled = robot.replace(own, "drive = \"tension\", range = [0.0, 20.0]");
    fs::write(&file, pulled).unwrap();
    let settled = succeed_json(&[
        "settle",
        "--robot",
        text(&file),
        "--command",
        "1,1,1,1,1,1",
        "--payload",
        "0.02",
    ]);
    assert_eq!(settled["converged"], true);
    assert_ne!(settled["stability"], "unstable");
    assert!(settled["positions"][9][2].as_f64().unwrap() < 0.174);
}

#[test]
fn a_robot_without_tendons_hangs_in_a_neutral_equilibrium() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("passive.toml");
    let lines = include_str!("one-module.toml").lines();
    let passive: Vec<&str> = lines.filter(|line| !line.starts_with("tendons")).collect();
    fs::write(&file, passive.join("\n")).unwrap();
    let settled = succeed_json(&["settle", "--robot", text(&file), "--command", ""]);
    // Each of its discs may turn about its axis.
    assert_eq!(settled["stability"], "neutral");
    assert!(settled["positions"][3][2].as_f64().unwrap() < 0.1);
}
