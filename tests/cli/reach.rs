//! `tdcr reach`: commands for points.

use std::fs;

use serde_json::Value;

use crate::{COMMAND, refuse, succeed, succeed_json, text};

/// Where the tip comes to rest under a command, with more options.
fn tip(command: &Value, options: &[&str]) -> [f64; 3] {
    let entries = command.as_array().unwrap().iter();
    let command: Vec<String> = entries.map(ToString::to_string).collect();
    let command = command.join(",");
    let settled = succeed_json(&[&["settle", "--command", &command], options].concat());
    std::array::from_fn(|axis| settled["positions"][9][axis].as_f64().unwrap())
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
    squares.sum::<f64>().sqrt()
}

#[test]
fn the_command_for_a_point_brings_the_tip_there() {
    let target = [0.06, 0.03, 0.31];
    for options in [&[][..], &["--payload", "0.01", "--wrench", "tip:0.05,0,0"]] {
        let reach = ["reach", "--tip", "0.06,0.03,0.31"];
        let found = succeed_json(&[&reach, options].concat());
        assert_eq!(found["units"]["error"], "m");
        let found = &found["found"][0];
        assert_eq!(found["reached"], true);
        assert!(distance(tip(&found["command"], options), target) < 1e-6);
    }
    let said = succeed(&["reach", "--tip", "0.06,0.03,0.31"]);
    assert!(said.starts_with("--command 0."), "{said}");
}

#[test]
fn a_path_is_a_table_that_settle_and_simulate_read() {
    let folder = tempfile::tempdir().unwrap();
    let [path, table, settled] =
        ["path.csv", "table.csv", "settled.json"].map(|name| folder.path().join(name));
    let targets: Vec<[f64; 3]> = (0..6)
        .map(|k| [0.06, 0.03 - 0.002 * f64::from(k), 0.31])
        .collect();
    let lines = targets.iter().map(|[x, y, z]| format!("{z},{x},{y}\n"));
    let lines = "z (m),x (m),y (m)\n".to_owned() + &lines.collect::<String>();
    fs::write(&path, lines).unwrap();
    succeed(&["reach", "--path", text(&path), "--out", text(&table)]);
    succeed(&[
        "settle",
        "--commands",
        text(&table),
        "--out",
        text(&settled),
    ]);
    let settled: Value = serde_json::from_slice(&fs::read(&settled).unwrap()).unwrap();
    let settled = settled["settled"].as_array().unwrap();
    assert_eq!(
        settled.len(),
        targets.len(),
        "the robot goes from point to point without detours"
    );
    let header = fs::read_to_string(&table).unwrap();
    assert!(header.contains("reached,arrival\n") && header.contains("true,followed\n"));
    for (row, target) in settled.iter().zip(&targets) {
        let tip = std::array::from_fn(|axis| row["tip_position"][axis].as_f64().unwrap());
        assert!(distance(tip, *target) < 1e-6);
    }
    let change = |pair: &[Value]| {
        let entry = |row: &Value, k: usize| row["command"][k].as_f64().unwrap();
        let changes = (0..6).map(|k| (entry(&pair[0], k) - entry(&pair[1], k)).abs());
        changes.fold(0.0, f64::max)
    };
    for pair in settled.windows(2) {
        assert!(change(pair) < 5e-3, "the commands jump");
    }
    let simulated = succeed_json(&["simulate", "--commands", text(&table)]);
    assert_eq!(simulated["steps"], 6);
}

#[test]
fn a_point_out_of_reach_is_an_error_that_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |arguments: &[&str], expected: &str| {
        let output = crate::tdcr(&[&["reach", "--quiet"], arguments].concat()).output();
        let output = output.unwrap();
        assert_eq!(output.status.code(), Some(1));
        let said = crate::stderr(&output);
        assert!(said.contains(expected), "{said}");
        assert!(!output.stdout.is_empty(), "the nearest command is told");
    };
    refused(
        &["--tip", "0.06,0.03,0.9"],
        "out of reach: tendons are at an end of their range",
    );
    let path = folder.path().join("path.json");
    fs::write(&path, "[[0.06, 0.03, 0.31], [0.06, 0.03, 0.9]]").unwrap();
    refused(&["--path", text(&path)], "1 of 2 points is not reached");
    let wrong = |lines: &str, expected: &str| {
        fs::write(&path, lines).unwrap();
        refuse(&["reach", "--path", text(&path)], 1, expected);
    };
    wrong(
        "[[1, 2]]",
        "path.json entry 0: a point has 3 numbers, found 2",
    );
    wrong("[]", "path.json has no points");
    refuse(&["reach", "--tip", "1,2"], 2, "expected 3 numbers, found 2");
    refuse(&["reach"], 2, "--tip");
}

#[test]
fn a_point_is_reached_among_obstacles_with_the_contacts_there() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    let post = "[[obstacle]]\nname = 'post'\ncylinder = { radius = 0.01, length = 0.4 }\nposition = [-0.06, 0.0, 0.25]\n";
    fs::write(&scene, post).unwrap();
    let place = ["--scene", text(&scene)];
    let settled = succeed_json(&[&["settle", "--command", COMMAND][..], &place].concat());
    let tip = settled["positions"].as_array().unwrap().last().unwrap();
    let tip: Vec<String> = (tip.as_array().unwrap().iter())
        .map(ToString::to_string)
        .collect();
    let tip = tip.join(",");
    let reach = ["reach", "--tip", &tip];
    let found = succeed_json(&[&reach[..], &place].concat());
    let found = &found["found"][0];
    assert_eq!(found["reached"], true);
    let command: Vec<String> = (found["command"].as_array().unwrap().iter())
        .map(ToString::to_string)
        .collect();
    let command = command.join(",");
    let again = succeed_json(&[&["settle", "--command", &command][..], &place].concat());
    let (said, settled) = (&found["contacts"], &again["contacts"]);
    let names = |contacts: &Value| -> Vec<(u64, String)> {
        let contacts = contacts.as_array().unwrap().iter();
        contacts
            .map(|one| (one["disc"].as_u64().unwrap(), one["obstacle"].to_string()))
            .collect()
    };
    assert_eq!(names(said), names(settled));
    let alone = succeed_json(&reach);
    assert!(alone["found"][0].get("contacts").is_none());
}
