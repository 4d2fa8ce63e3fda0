//! `tdcr plan`.

use std::fs;
use std::path::{Path, PathBuf};

use crate::{refuse, succeed, succeed_json, text};

const FROM: &str = "0.034,0.007,0.001,0.026,0.015,0.019";
const TO: &str = "0.001,0.034,0.007,0.015,0.026,0.019";
/// On the other side of the ball.
const BEYOND: &str = "0.007,0.001,0.034,0.019,0.015,0.026";
const SCENE: &str = "
    [[obstacle]]
    name = 'ball'
    sphere = { radius = 0.02 }
    position = [-0.05, 0.09, 0.29]
";

fn scene(folder: &Path, scene: &str) -> PathBuf {
    let file = folder.join("scene.toml");
    fs::write(&file, scene).unwrap();
    file
}

fn tip_of(command: &str) -> Vec<f64> {
    let settled = succeed_json(&["settle", "--command", command]);
    let positions = settled["positions"].as_array().unwrap();
    let tip = positions[positions.len() - 1].as_array().unwrap();
    tip.iter().map(|x| x.as_f64().unwrap()).collect()
}

#[test]
fn a_plan_leads_from_one_command_to_the_other_and_its_table_is_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), SCENE);
    let (table, picture) = (
        folder.path().join("path.csv"),
        folder.path().join("path.svg"),
    );
    let plan = [
        "plan",
        "--from",
        FROM,
        "--to",
        BEYOND,
        "--scene",
        text(&scene),
    ];
    let files = ["--out", text(&table), "--picture", text(&picture)];
    let planned = succeed_json(&[&plan[..], &files].concat());
    let steps = planned["steps"].as_array().unwrap();
    let numbers = |step: &serde_json::Value| -> String {
        let command = step["command"].as_array().unwrap().iter();
        let command: Vec<String> = command.map(ToString::to_string).collect();
        command.join(",")
    };
    assert_eq!(numbers(&steps[0]), FROM);
    assert_eq!(numbers(&steps[steps.len() - 1]), BEYOND);
    for step in steps {
        assert!(step["clearance"].as_f64().unwrap() >= 0.002);
        assert!(step.get("insertion").is_none());
    }
    let rows = fs::read_to_string(&table).unwrap();
    let header = rows.lines().next().unwrap();
    assert!(
        header.starts_with("c0 (m),c1 (m)") && header.ends_with(",c5 (m)"),
        "{header}"
    );
    assert_eq!(rows.lines().count(), steps.len() + 1);
    assert!(fs::read_to_string(&picture).unwrap().starts_with("<svg"));
    // The robot settles there among the obstacles, without touching any.
    let settled = folder.path().join("settled.csv");
    let settle = [
        "settle",
        "--commands",
        text(&table),
        "--scene",
        text(&scene),
    ];
    succeed(&[&settle[..], &["--out", text(&settled)]].concat());
    let settled = fs::read_to_string(&settled).unwrap();
    let names: Vec<&str> = settled.lines().next().unwrap().split(',').collect();
    let contacts = names.iter().position(|name| *name == "contacts").unwrap();
    for line in settled.lines().skip(1) {
        assert_eq!(line.split(',').nth(contacts), Some("0"), "{line}");
    }
    // The same seed, the same plan.
    let again = succeed_json(&plan);
    assert_eq!(again["steps"], planned["steps"]);
    let told = succeed(&plan);
    assert!(
        told.contains("obstacles are") && told.contains(" --command "),
        "{told}"
    );
}

#[test]
fn a_plan_ends_with_the_tip_at_a_point() {
    let goal = tip_of(TO);
    let point = format!("{:?},{:?},{:?}", goal[0], goal[1], goal[2]);
    let planned = succeed_json(&["plan", "--from", FROM, "--tip", &point]);
    let steps = planned["steps"].as_array().unwrap();
    let tip = steps[steps.len() - 1]["tip_position"].as_array().unwrap();
    for (found, wanted) in tip.iter().zip(&goal) {
        assert!((found.as_f64().unwrap() - wanted).abs() < 1e-5);
    }
    assert!(steps[0].get("clearance").is_none());
}

#[test]
fn the_scene_of_the_guide_has_a_plan() {
    let plan = [
        "plan",
        "--scene",
        "examples/scenes/balls.toml",
        "--from",
        FROM,
    ];
    let planned = succeed_json(&[&plan[..], &["--tip", "0.06,0.06,0.30"]].concat());
    let steps = planned["steps"].as_array().unwrap();
    assert!(
        steps
            .iter()
            .all(|step| step["clearance"].as_f64().unwrap() >= 0.002)
    );
}

#[test]
fn a_base_that_moves_is_inserted() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("path.csv");
    let plan = [
        "plan",
        "--from",
        FROM,
        "--to",
        TO,
        "--insertion",
        "-0.01,0.05",
    ];
    let end = ["--to-insertion", "0.04", "--out", text(&table)];
    let planned = succeed_json(&[&plan[..], &end].concat());
    let steps = planned["steps"].as_array().unwrap();
    let last = &steps[steps.len() - 1];
    assert!((last["insertion"].as_f64().unwrap() - 0.04).abs() < 1e-12);
    let raised = last["tip_position"][2].as_f64().unwrap() - tip_of(TO)[2];
    assert!((raised - 0.04).abs() < 1e-6, "{raised}");
    let rows = fs::read_to_string(&table).unwrap();
    assert!(rows.lines().next().unwrap().ends_with(",insertion (m)"));
}

#[test]
fn what_cannot_be_planned_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let plan = ["plan", "--from", FROM, "--to", TO];
    let wall = "
        [[obstacle]]
        name = 'cage'
        pipe = { radius = 0.03, length = 0.5 }
        position = [0.0, 0.0, 0.3]
    ";
    let cage = scene(folder.path(), wall);
    let said = "from obstacle \"cage\"; expected 2.00 mm at least";
    refuse(&[&plan[..], &["--scene", text(&cage)]].concat(), 1, said);
    let weak = [&plan[..], &["--max-tension", "0.1"]].concat();
    refuse(&weak, 1, "at the start tendon");
    refuse(&weak, 1, "--min-tension and --max-tension are the limits");
    let far = ["plan", "--from", FROM, "--tip", "1,0,0"];
    refuse(&far, 1, "no command was found that brings the tip to");
    let negative = [&plan[..], &["--clearance", "-1"]].concat();
    refuse(
        &negative,
        1,
        "clearance is -1 m; expected a length of 0 or above",
    );
    let beyond = [
        &plan[..],
        &["--insertion", "0,0.1", "--to-insertion", "0.2"],
    ]
    .concat();
    refuse(&beyond, 1, "0.2 m where the base moves from 0 to 0.1 m");
    refuse(&["plan", "--from", FROM], 2, "--to");
    refuse(
        &["plan", "--from", "1,2", "--to", TO],
        1,
        "the command has 2 entries",
    );
}
