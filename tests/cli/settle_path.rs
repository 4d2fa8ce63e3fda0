//! `tdcr settle --path` and `--base`: a robot led along commands, and one that stands elsewhere.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tdcr::sim::contact::ContactSettler;
use tdcr::sim::robot::{Loads, Robot, RobotSpec};
use tdcr::sim::scene::{Obstacle, Scene};
use tdcr::sim::tendon_friction::ContactPath;

use crate::{COMMAND, refuse, stderr, succeed, succeed_json, tdcr, text};

/// A post that the robot of [`COMMAND`] leans on.
const POST: &str = r#"
[[obstacle]]
name = "post"
cylinder = { radius = 0.01, length = 0.4 }
position = [-0.06, 0.0, 0.25]
"#;

fn file(folder: &Path, name: &str, lines: &str) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, lines).unwrap();
    path
}

fn numbers(value: &Value) -> Vec<f64> {
    let array = value.as_array().unwrap().iter();
    array.map(|number| number.as_f64().unwrap()).collect()
}

/// Where [`out_and_back`] begins (m).
const BEGIN: [f64; 6] = [0.027, 0.012, 0.008, 0.024, 0.016, 0.02];

/// Commands from [`BEGIN`] to [`COMMAND`] and back, each way in four steps.
fn out_and_back() -> Vec<Vec<f64>> {
    let goal = COMMAND.split(',').map(|cell| cell.parse::<f64>().unwrap());
    let goal: Vec<f64> = goal.collect();
    let parts = [0.0, 0.25, 0.5, 0.75, 1.0, 0.75, 0.5, 0.25, 0.0];
    let between = |part: f64| {
        let ways = BEGIN.iter().zip(&goal);
        ways.map(|(from, to)| from + part * (to - from)).collect()
    };
    parts.map(between).to_vec()
}

fn table_of(commands: &[Vec<f64>]) -> String {
    let row = |command: &Vec<f64>| {
        let cells: Vec<String> = command.iter().map(|value| format!("{value:?}")).collect();
        cells.join(",") + "\n"
    };
    let rows: String = commands.iter().map(row).collect();
    "c0 (m),c1 (m),c2 (m),c3 (m),c4 (m),c5 (m)\n".to_owned() + &rows
}

/// Robot 2m with friction in its holes.
fn with_friction(coefficient: f64) -> RobotSpec {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for tendon in spec.tendon_specs_mut() {
        tendon.set_friction(coefficient);
    }
    spec
}

#[test]
fn a_path_with_friction_is_that_of_the_library_and_does_not_come_back_as_it_went() {
    let folder = tempfile::tempdir().unwrap();
    let commands = out_and_back();
    let path = file(folder.path(), "path.csv", &table_of(&commands));
    let spec = with_friction(0.1);
    let robot_file = folder.path().join("rough.toml");
    fs::write(&robot_file, spec.to_toml().unwrap()).unwrap();
    let scene_file = file(
        folder.path(),
        "scene.toml",
        &format!("{POST}friction = 0.3\n"),
    );
    let settle = [
        "settle",
        "--robot",
        text(&robot_file),
        "--path",
        text(&path),
    ];
    let settle = [&settle[..], &["--scene", text(&scene_file)]].concat();
    let found = succeed_json(&settle);
    let rows = found["settled"].as_array().unwrap();
    assert_eq!(rows.len(), commands.len());

    let robot = Robot::new(spec).unwrap();
    let post = Obstacle::cylinder("post", 0.01, 0.4)
        .unwrap()
        .at([-0.06, 0.0, 0.25]);
    let scene = Scene::new(vec![post.with_friction(0.3).unwrap()]).unwrap();
    let mut led = ContactPath::new(&robot, &scene);
    let mut snaps = 0;
    for (number, (row, command)) in rows.iter().zip(&commands).enumerate() {
        let command = robot.command(command).unwrap();
        led.advance(&command, &Loads::default()).unwrap();
        let state = led.state();
        let tip = state.equilibrium.positions[9];
        assert_eq!(numbers(&row["tip_position"]), tip.as_slice());
        assert_eq!(
            numbers(&row["tendon_tensions"]),
            state.equilibrium.tendon_tensions
        );
        assert_eq!(row["converged"], true);
        assert_eq!(row["dissipated"], state.dissipated);
        assert_eq!(row["snaps"], state.snaps - snaps);
        snaps = state.snaps;
        // With friction there is no potential, whose stiffness and minima would be told; the start is without.
        assert!(row["smallest_stiffness"].is_null());
        assert_eq!(row["stability"].is_null(), number > 0);
        assert_eq!(
            row["contacts"].as_array().unwrap().len(),
            led.contacts().len()
        );
        assert!(row["complementarity"].as_f64().unwrap() < 1e-12);
    }
    let touching = rows[4]["contacts"].as_array().unwrap();
    assert!(!touching.is_empty() && touching[0]["sliding"] != "free");
    let [there, back] = [3, 5].map(|row: usize| numbers(&rows[row]["tip_position"]));
    let apart = there
        .iter()
        .zip(&back)
        .map(|(a, b)| (a - b).powi(2))
        .sum::<f64>();
    assert!(apart.sqrt() > 1e-3, "{apart}");

    let table = folder.path().join("table.csv");
    let said = succeed_json(&[&settle[..], &["--out", text(&table)]].concat());
    assert_eq!(
        (&said["commands"], &said["settled"]),
        (&9.into(), &9.into())
    );
    let written = fs::read_to_string(&table).unwrap();
    let header = written.lines().next().unwrap();
    assert!(
        header.ends_with(",snaps,dissipated (J),contacts,largest_contact_force (N)"),
        "{header}"
    );
    // A table is a path again.
    let again = [
        "settle",
        "--robot",
        text(&robot_file),
        "--path",
        text(&table),
    ];
    let again = succeed_json(&[&again[..], &["--scene", text(&scene_file)]].concat());
    assert_eq!(again["settled"], found["settled"]);
}

#[test]
fn without_friction_a_path_follows_its_branch_and_tells_its_stability() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "path.csv", &table_of(&out_and_back()));
    let scene = file(folder.path(), "scene.toml", POST);
    let around = ["--scene", text(&scene)];
    let found = succeed_json(&[&["settle", "--path", text(&path)], &around[..]].concat());
    let rows = found["settled"].as_array().unwrap();
    let alone = succeed_json(&[&["settle", "--command", COMMAND], &around[..]].concat());
    for (a, b) in numbers(&rows[4]["tip_position"])
        .iter()
        .zip(numbers(&alone["positions"][9]))
    {
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
    for row in rows {
        assert_eq!(
            (&row["stability"], &row["snaps"]),
            (&"stable".into(), &0.into())
        );
        assert!(row["smallest_stiffness"].as_f64().unwrap() > 0.0);
    }
    assert_eq!(rows[4]["contacts"][0]["obstacle"], "post");
    for (there, back) in [(0, 8), (1, 7), (2, 6), (3, 5)] {
        let [there, back] = [there, back].map(|row: usize| numbers(&rows[row]["tip_position"]));
        for (a, b) in there.iter().zip(&back) {
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
    }
    let printed = succeed(&[&["settle", "--path", text(&path)], &around[..]].concat());
    assert_eq!(printed.lines().count(), 10);
    for words in ["tension (N)", "contacts", "force (N)"] {
        assert!(printed.contains(words), "{printed}");
    }
}

#[test]
fn a_base_elsewhere_moves_the_robot_into_its_scene() {
    let folder = tempfile::tempdir().unwrap();
    let scene_file = file(folder.path(), "scene.toml", POST);
    let post = Obstacle::cylinder("post", 0.01, 0.4)
        .unwrap()
        .at([-0.06, 0.0, 0.25]);
    let scene = Scene::new(vec![post]).unwrap();
    let robot = Robot::load("2m").unwrap();
    let command: Vec<f64> = COMMAND
        .split(',')
        .map(|cell| cell.parse().unwrap())
        .collect();
    let command = robot.command(&command).unwrap();
    let [x, y, z] = robot.spec().base.position;
    let upright = robot.spec().base.orientation;
    let quarter = [0.5_f64.sqrt(), 0.0, 0.0, 0.5_f64.sqrt()];
    let bases = [
        (format!("{x},{y},{}", z - 0.1), [x, y, z - 0.1], upright),
        (format!("-0.01,0,{z},1,0,0,1"), [-0.01, 0.0, z], quarter),
    ];
    let mut tips = Vec::new();
    for (base, position, orientation) in &bases {
        let settle = ["settle", "--command", COMMAND, "--scene", text(&scene_file)];
        let said = succeed_json(&[&settle[..], &["--base", base]].concat());
        let moved = robot.with_base(*position, *orientation).unwrap();
        let mut settler = ContactSettler::new(&moved, &scene);
        let found = settler.settle(&command, &Loads::default()).unwrap();
        assert_eq!(
            said["contacts"].as_array().unwrap().len(),
            found.contacts.len()
        );
        let tip = numbers(&said["positions"][9]);
        for (a, b) in tip.iter().zip(&found.equilibrium.positions[9]) {
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
        tips.push(tip);
    }
    assert!((tips[0][0] - tips[1][0]).abs() > 0.01);
    // Of all commands of a table, too.
    let commands = file(folder.path(), "commands.csv", &format!("{COMMAND}\n"));
    for option in ["--commands", "--path"] {
        let settle = ["settle", option, text(&commands), "--base", &bases[0].0];
        let found = succeed_json(&[&settle[..], &["--scene", text(&scene_file)]].concat());
        for (a, b) in numbers(&found["settled"][0]["tip_position"])
            .iter()
            .zip(&tips[0])
        {
            assert!((a - b).abs() < 1e-12, "{option}");
        }
    }
}

#[test]
fn wrong_bases_and_options_beside_a_path_are_named() {
    let wrong = |options: &[&str], status, expected: &str| {
        refuse(&[&["settle"], options].concat(), status, expected);
    };
    let command = ["--command", COMMAND];
    let base = |value, status, expected: &str| {
        wrong(
            &[&command[..], &["--base", value]].concat(),
            status,
            expected,
        );
    };
    base(
        "0,0",
        2,
        "expected 3 numbers (m), or 7 with a quaternion, found 2",
    );
    base("0,0,up", 2, "`up` is not a number");
    base("0,0,inf", 1, "base.position");
    base("0,0,0,0,0,0,0", 1, "expected a quaternion (w, x, y, z)");
    let path = ["--path", "nosuch.csv"];
    wrong(&path, 1, "cannot read commands from nosuch.csv");
    for other in [
        &command[..],
        &["--commands", "nosuch.csv"],
        &["--random", "3"],
        &["--compliance"],
    ] {
        wrong(&[&path[..], other].concat(), 2, "cannot be used with");
    }
    wrong(
        &[&path[..], &["--picture", "never.png"]].concat(),
        1,
        "--picture is of one command",
    );
    wrong(
        &[&path[..], &["--out", "never.txt"]].concat(),
        1,
        "expected the extension .csv or .json",
    );
    wrong(
        &[&command[..], &["--out", "never.csv"]].concat(),
        2,
        "--out",
    );
}

/// A plan's or a deployment's base moves, which commands alone do not.
#[test]
fn columns_that_move_the_base_are_not_passed_over_in_silence() {
    let folder = tempfile::tempdir().unwrap();
    let lines = format!("c0,c1,c2,c3,c4,c5,insertion (m)\n{COMMAND},0.02\n");
    let path = file(folder.path(), "path.csv", &lines);
    let said = stderr(&tdcr(&["settle", "--path", text(&path)]).output().unwrap());
    assert!(
        said.contains("the column insertion moves the base"),
        "{said}"
    );
}

/// From the middle of all ranges, where the robot stands straight, it falls to one side as soon as the tendons pull.
#[test]
fn a_snap_is_told_and_a_command_without_rest_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let lines = format!("0.02,0.02,0.02,0.02,0.02,0.02\n{COMMAND}\n");
    let path = file(folder.path(), "path.csv", &lines);
    let settle = ["settle", "--path", text(&path)];
    let found = succeed_json(&settle);
    assert_eq!(found["settled"][0]["snaps"], 0);
    assert!(found["settled"][1]["snaps"].as_u64().unwrap() > 0);
    let printed = succeed(&settle);
    assert!(
        printed.lines().last().unwrap().contains("snap"),
        "{printed}"
    );

    // A moment that turns with the tip winds the robot up without end.
    let wound = [&settle[..], &["--wrench", "tip:0,0,0,0,5,0@disc"]].concat();
    let output = tdcr(&wound).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = stderr(&output);
    assert!(
        said.contains("path.csv, command 0, where the first is 0: the robot did not settle"),
        "{said}"
    );
    let printed = String::from_utf8(output.stdout).unwrap();
    assert!(
        printed.lines().count() == 2 && printed.contains("NOT settled"),
        "{printed}"
    );
}
