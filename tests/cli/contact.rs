//! `tdcr settle --scene` and `tdcr simulate --scene`: what the robot touches.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{COMMAND, refuse, succeed, succeed_json, text};

/// A post that the robot of [`COMMAND`] leans on, and a floor that it does not reach.
const SCENE: &str = r#"
[[obstacle]]
name = "floor"
half_space = {}

[[obstacle]]
name = "post"
cylinder = { radius = 0.01, length = 0.4 }
position = [-0.06, 0.0, 0.25]
"#;

fn scene(folder: &Path, lines: &str) -> PathBuf {
    let path = folder.join("scene.toml");
    fs::write(&path, lines).unwrap();
    path
}

fn numbers(value: &Value) -> Vec<f64> {
    let array = value.as_array().unwrap().iter();
    array.map(|number| number.as_f64().unwrap()).collect()
}

#[test]
fn a_result_names_what_is_touched_and_says_how_exact_that_is() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), SCENE);
    let settled = succeed_json(&["settle", "--command", COMMAND, "--scene", text(&scene)]);
    assert_eq!(settled["converged"], true);
    let around = &settled;
    assert!(around["complementarity"].as_f64().unwrap() < 1e-12);
    assert!(around["shape_error"].as_f64().unwrap() > 1e-3);
    let contacts = around["contacts"].as_array().unwrap();
    assert!(!contacts.is_empty());
    for contact in contacts {
        assert_eq!(contact["obstacle"], "post");
        let (point, normal) = (numbers(&contact["point"]), numbers(&contact["normal"]));
        // On the post, and pushed away from it.
        assert!(((point[0] + 0.06).hypot(point[1]) - 0.01).abs() < 1e-9);
        let force = numbers(&contact["force"]);
        let along: f64 = force.iter().zip(&normal).map(|(f, n)| f * n).sum();
        let size = force.iter().map(|f| f * f).sum::<f64>().sqrt();
        assert!((along - size).abs() < 1e-9 && size > 0.0);
    }
    let said = succeed(&["settle", "--command", COMMAND, "--scene", text(&scene)]);
    for words in ["contact", "complementarity", "post", "mm of the discs"] {
        assert!(said.contains(words), "{words}: {said}");
    }
}

#[test]
fn a_table_counts_contacts_and_without_a_scene_has_no_such_columns() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), SCENE);
    let commands = folder.path().join("commands.csv");
    fs::write(&commands, format!("{COMMAND}\n")).unwrap();
    let table = folder.path().join("table.csv");
    let settle = [
        "settle",
        "--commands",
        text(&commands),
        "--out",
        text(&table),
    ];
    succeed(&[&settle[..], &["--scene", text(&scene)]].concat());
    let lines = fs::read_to_string(&table).unwrap();
    assert!(
        lines
            .lines()
            .next()
            .unwrap()
            .ends_with(",contacts,largest_contact_force (N)")
    );
    let alone = folder.path().join("alone.csv");
    succeed(&[
        "settle",
        "--commands",
        text(&commands),
        "--out",
        text(&alone),
    ]);
    assert!(!fs::read_to_string(&alone).unwrap().contains("contact"));
}

#[test]
fn what_cannot_be_settled_among_obstacles_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let inside = SCENE.replace("-0.06, 0.0, 0.25", "0.0, 0.0, 0.25");
    let inside = scene(folder.path(), &inside);
    let settle = ["settle", "--command", COMMAND, "--scene"];
    let said = "starts inside obstacle \"post\"";
    refuse(&[&settle[..], &[text(&inside)]].concat(), 1, said);
    let scene = scene(folder.path(), SCENE);
    let moment = [text(&scene), "--wrench", "tip:0,0,0,0,0,0.01"];
    let said = "the wrench on disc 9 is a moment or turns with its disc; among obstacles";
    refuse(&[&settle[..], &moment].concat(), 1, said);
}

#[test]
fn a_moving_robot_says_what_it_touches_and_its_path_has_the_forces() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path(), SCENE);
    let (commands, path) = (
        folder.path().join("commands.csv"),
        folder.path().join("path.csv"),
    );
    fs::write(&commands, format!("{COMMAND}\n").repeat(1500)).unwrap();
    let simulate = [
        "simulate",
        "--commands",
        text(&commands),
        "--scene",
        text(&scene),
    ];
    let simulated = succeed_json(&[&simulate[..], &["--out", text(&path)]].concat());
    let contacts = simulated["contacts"].as_array().unwrap();
    assert!(!contacts.is_empty());
    let sum = |axis: usize| -> f64 {
        (contacts
            .iter()
            .map(|contact| contact["force"][axis].as_f64().unwrap()))
        .sum()
    };
    let rows = fs::read_to_string(&path).unwrap();
    assert!(
        rows.lines()
            .next()
            .unwrap()
            .ends_with("fx9 (N),fy9 (N),fz9 (N)")
    );
    let last: Vec<f64> = (rows.lines().last().unwrap().split(','))
        .map(|x| x.parse().unwrap())
        .collect();
    assert_eq!(last.len(), 61);
    for axis in 0..3 {
        let of_discs: f64 = last[31 + axis..].iter().step_by(3).sum();
        assert!((of_discs - sum(axis)).abs() < 1e-9, "{of_discs}");
    }
    // Without a scene there are none, and steps of higher order take no contacts.
    let free = succeed_json(&simulate[..3]);
    assert!(free["contacts"].is_null());
    let higher = [&simulate[..], &["--integrator", "runge-kutta4"]].concat();
    refuse(&higher, 1, "take no contacts");
}

#[test]
fn the_example_scene_is_one_that_the_readmes_robot_settles_in() {
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/scenes/shelf.toml");
    let settled = succeed_json(&["settle", "--command", COMMAND, "--scene", scene]);
    assert_eq!(settled["converged"], true);
    assert_eq!(settled["contacts"][0]["obstacle"], "rail");
}
