//! `tdcr deploy`.

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::{refuse, succeed, succeed_json, tdcr, text};

const ROBOT: &str = "examples/three-segments.toml";

/// Points of an arc that bends by 0.8 rad over a length (m).
fn arc(length: f64) -> String {
    let radius = length / 0.8;
    let point = |k: i32| {
        let (sin, cos) = (0.8 * f64::from(k) / 40.0).sin_cos();
        format!("{},0,{}\n", radius * (1.0 - cos), radius * sin)
    };
    (0..=40).map(point).collect()
}

#[test]
fn a_robot_is_deployed_along_a_curve_and_says_how_far_it_is_off() {
    let folder = tempfile::tempdir().unwrap();
    let (curve, table) = (
        folder.path().join("curve.csv"),
        folder.path().join("out.csv"),
    );
    fs::write(&curve, arc(0.16)).unwrap();
    let deploy = [
        "deploy",
        "--robot",
        ROBOT,
        "--along",
        text(&curve),
        "--stages",
        "10",
    ];
    let free = succeed_json(&[&deploy[..], &["--out", text(&table)]].concat());
    let stages = free["stages"].as_array().unwrap();
    assert_eq!(stages.len(), 10);
    assert!(free["relative_deviation"].as_f64().unwrap() < 0.01);
    for stage in stages {
        assert!(stage["tip_error"].as_f64().unwrap() < 1e-9);
    }
    let rows = fs::read_to_string(&table).unwrap();
    assert_eq!(rows.lines().count(), 11);
    assert!(rows.starts_with("c0 (N),"));
    let carriage = succeed_json(&[&deploy[..], &["--base", "carriage"]].concat());
    // Its orientation stays.
    let turns: Vec<_> = (carriage["stages"].as_array().unwrap().iter())
        .map(|stage| stage["base_orientation"].clone())
        .collect();
    assert!(turns.iter().all(|turn| *turn == turns[0]));
    assert!(carriage["relative_deviation"].as_f64().unwrap() < 0.02);
    assert!(succeed(&deploy).contains("10 stages: the body is"));
}

#[test]
fn a_deployment_in_a_scene_touches_what_is_in_its_way() {
    let folder = tempfile::tempdir().unwrap();
    let (curve, scene) = (
        folder.path().join("curve.csv"),
        folder.path().join("scene.toml"),
    );
    fs::write(&curve, arc(0.16)).unwrap();
    // A ball that comes 2 mm into where the discs of the tip would be at the arc's end.
    let ball =
        "[[obstacle]]\nname = 'ball'\nsphere = { radius = 0.02 }\nposition = [0.082, 0.0, 0.142]\n";
    fs::write(&scene, ball).unwrap();
    let deploy = [
        "deploy",
        "--robot",
        ROBOT,
        "--along",
        text(&curve),
        "--stages",
        "10",
    ];
    let free = succeed_json(&deploy);
    let among = succeed_json(&[&deploy[..], &["--scene", text(&scene)]].concat());
    let forces = |deployed: &serde_json::Value| -> Vec<f64> {
        let stages = deployed["stages"].as_array().unwrap().iter();
        stages
            .map(|stage| stage["contact_force"].as_f64().unwrap())
            .collect()
    };
    assert!(forces(&free).iter().all(|force| *force == 0.0));
    let (first, last) = (forces(&among)[0], forces(&among)[9]);
    assert!(first == 0.0 && last > 1e-3, "{:?}", forces(&among));
    // The tip is on the curve until the ball is in its way.
    let off = |stage: usize| among["stages"][stage]["tip_error"].as_f64().unwrap();
    assert!(
        off(0) < 1e-6 && off(9) > 1e-4 && off(9) < 1e-2,
        "{}",
        off(9)
    );
    let said = succeed(&[&deploy[..], &["--scene", text(&scene)]].concat());
    assert!(said.contains("; contacts bear "), "{said}");
}

#[test]
fn a_deployment_that_is_interrupted_leaves_no_table() {
    let folder = tempfile::tempdir().unwrap();
    let (curve, table) = (
        folder.path().join("curve.csv"),
        folder.path().join("out.csv"),
    );
    fs::write(&curve, arc(0.16)).unwrap();
    let deploy = ["deploy", "--robot", ROBOT, "--along", text(&curve)];
    let long = ["--stages", "1000000", "--out", text(&table)];
    let mut child = tdcr(&[&deploy[..], &long].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let begun = lines.next().unwrap().unwrap();
    assert!(begun.contains("deploy: 1000013 steps"), "{begun}");
    // Until the first step asks whether to go on, a signal ends it at once.
    sleep(Duration::from_millis(500));
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-INT", &id]).status();
    assert!(sent.unwrap().success());
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    assert!(
        rest.iter().any(|line| line.contains("interrupted")),
        "{rest:?}"
    );
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(!table.exists());
}

#[test]
fn what_is_no_curve_for_a_robot_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let curve = folder.path().join("curve.csv");
    let deploy = ["deploy", "--robot", ROBOT, "--along", text(&curve)];
    fs::write(&curve, arc(0.3)).unwrap();
    refuse(
        &deploy,
        1,
        "the curve is 0.3000 m long; expected 0.1865 m at most",
    );
    fs::write(&curve, "0,0,0\n").unwrap();
    refuse(
        &deploy,
        1,
        "the curve has 1 points that differ; expected 2 at least",
    );
}
