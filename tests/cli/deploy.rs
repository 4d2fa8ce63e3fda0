//! `tdcr deploy`.

use std::fs;

use crate::{refuse, succeed, succeed_json, text};

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
