//! What `tdcr settle` says of equilibria.

use std::fs;

use crate::{COMMAND, refuse, succeed_json, text};

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
fn a_robot_without_tendons_takes_an_empty_command_or_none() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("passive.toml");
    let lines = include_str!("one-module.toml").lines();
    let passive: Vec<&str> = lines.filter(|line| !line.starts_with("tendons")).collect();
    fs::write(&file, passive.join("\n")).unwrap();
    let settle = ["settle", "--robot", text(&file)];
    let left_out = succeed_json(&settle);
    let empty = succeed_json(&[&settle[..], &["--command", ""]].concat());
    assert_eq!(left_out, empty);
    // It hangs, and each of its discs may turn about its axis.
    assert_eq!(left_out["stability"], "neutral");
    assert!(left_out["positions"][3][2].as_f64().unwrap() < 0.1);
    let given = [&settle[..], &["--command", "0.01"]].concat();
    refuse(&given, 1, "the command has 1 entries");
    refuse(&["settle", "--command", ""], 1, "the command has 0 entries");
    let gap = COMMAND.replacen(',', ",,", 1);
    refuse(
        &["settle", "--command", &gap],
        1,
        "command entry 1 is empty",
    );
}
