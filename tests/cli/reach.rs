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

/// A ball beside the robot, and a wall that it can lean on.
const BALL_AND_WALL: &str = "
[[obstacle]]
name = 'ball'
sphere = { radius = 0.02 }
position = [0.075, 0.03, 0.29]

[[obstacle]]
name = 'wall'
box = { size = [0.02, 1.0, 1.0] }
position = [-0.07, 0.0, 0.3]

[[obstacle]]
name = 'toy'
sphere = { radius = 0.01 }
position = [0.0, 0.3, 0.3]
mass = 0.1
";

fn ball_and_wall() -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    fs::write(&scene, BALL_AND_WALL).unwrap();
    let scene = text(&scene).to_owned();
    (folder, scene)
}

/// What the robot touches under a command that was found, as `settle` says it.
fn contacts(found: &Value, scene: &str) -> Vec<Value> {
    let command: Vec<String> = (found["command"].as_array().unwrap().iter())
        .map(ToString::to_string)
        .collect();
    let settled = succeed_json(&["settle", "--command", &command.join(","), "--scene", scene]);
    settled["contacts"].as_array().unwrap().clone()
}

#[test]
fn a_clearance_is_kept_and_what_it_costs_is_said() {
    let (_folder, scene) = ball_and_wall();
    let reach = ["reach", "--scene", &scene, "--tip"];
    let free = [&reach[..], &["0.0,0.06,0.31", "--clearance", "0.004"]].concat();
    let table = succeed_json(&free);
    assert_eq!(
        (&table["clearance"], &table["units"]["clearance"]),
        (&0.004.into(), &"m".into())
    );
    let found = &table["found"][0];
    assert_eq!(found["reached"], true);
    assert!(found["clearance"].as_f64().unwrap() >= 0.004);
    assert!(contacts(found, &scene).is_empty());
    assert!(succeed(&free).contains("; clear by 0.0"));
    // In the ball.
    let blocked = [
        &reach[..],
        &["0.06,0.03,0.31", "--clearance", "0", "--quiet", "--json"],
    ]
    .concat();
    let output = crate::tdcr(&blocked).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = crate::stderr(&output);
    assert!(
        said.contains("the robot keeps clear of \"ball\" (disc "),
        "{said}"
    );
    let table: Value = serde_json::from_slice(&output.stdout).unwrap();
    let found = &table["found"][0];
    assert_eq!(found["nearest"]["obstacle"], "ball");
    assert!(found["clearance"].as_f64().unwrap() >= 0.0 && found["error"].as_f64().unwrap() > 1e-3);
    assert!(contacts(found, &scene).is_empty());
}

#[test]
fn the_robot_presses_with_the_force_that_settling_finds() {
    let (_folder, scene) = ball_and_wall();
    let place = ["--scene", &scene, "--clearance", "0.002"];
    for (press, disc) in [("wall=0.05", None), ("wall=0.02@tip", Some(9))] {
        let arguments = [&["reach", "--press", press], &place[..]].concat();
        let table = succeed_json(&arguments);
        let found = &table["found"][0];
        let pressed = &found["presses"][0];
        assert_eq!(
            (&pressed["obstacle"], &pressed["disc"]),
            (&"wall".into(), &disc.into())
        );
        assert!(found["target"].is_null() && found["error"].is_null());
        let (wanted, force) = (
            pressed["wanted"].as_f64(),
            pressed["force"].as_f64().unwrap(),
        );
        assert!((force - wanted.unwrap()).abs() < 1e-5);
        let touched = contacts(found, &scene);
        assert!(touched.iter().all(|one| one["obstacle"] == "wall"));
        let own = (touched.iter()).filter(|one| disc.is_none_or(|disc| one["disc"] == disc));
        // The wall's normal is x.
        let settled: f64 = own.map(|one| one["force"][0].as_f64().unwrap()).sum();
        assert!((settled - force).abs() < 1e-6 * force, "{settled} {force}");
        assert!(succeed(&arguments).contains("presses on \"wall\" with 0.0"));
    }
}

#[test]
fn contact_that_makes_no_sense_is_refused() {
    let (_folder, scene) = ball_and_wall();
    let scene = ["--scene", &scene];
    let tip = ["reach", "--tip", "0.06,0.03,0.31"];
    for (arguments, code, expected) in [
        (&["--clearance", "0.1"][..], 2, "--scene <FILE>"),
        (&["--press", "wall=1"], 2, "--scene <FILE>"),
        (
            &["--clearance", "-1", scene[0], scene[1]],
            2,
            "expected a finite number of at least 0",
        ),
        (
            &["--clearance", "nan", scene[0], scene[1]],
            2,
            "expected a finite number of at least 0",
        ),
        (
            &["--press", "wall=-1", scene[0], scene[1]],
            2,
            "the force: expected a finite number above 0",
        ),
        (
            &["--press", "wall", scene[0], scene[1]],
            2,
            "expected OBSTACLE=FORCE",
        ),
        (
            &["--press", "wall=1@top", scene[0], scene[1]],
            2,
            "`top` is no disc",
        ),
        (
            &["--press", "wall=1@10", scene[0], scene[1]],
            1,
            "the robot has no such disc",
        ),
        (
            &["--press", "well=1", scene[0], scene[1]],
            1,
            "no obstacle \"well\"; expected one of \"ball\", \"wall\", \"toy\"",
        ),
        (
            &["--press", "toy=1", scene[0], scene[1]],
            1,
            "the obstacle can move",
        ),
    ] {
        refuse(&[&tip[..], arguments].concat(), code, expected);
    }
    let path = [
        "reach",
        "--path",
        "nosuch.csv",
        "--clearance",
        "0",
        scene[0],
        scene[1],
    ];
    refuse(&path, 2, "--path");
}
