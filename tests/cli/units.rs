//! Commands in the units of their drives, and in the groups of their modules.

use std::fs;

use crate::{collect_small, eval_small, succeed, succeed_json, text, train_tiny};

/// A robot with a module of four tendons that are driven by tension, and one of four driven by rest length.
fn four_tendons(folder: &std::path::Path) -> std::path::PathBuf {
    let file = folder.join("four-tendons.toml");
    fs::write(&file, include_str!("four-tendons.toml")).unwrap();
    file
}

#[test]
fn pages_say_commands_in_the_units_and_groups_of_the_robot() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let robot = four_tendons(folder.path());
    let (data, page) = (path("data"), path("page.html"));
    let robot = ["--robot", text(&robot)];
    let size = ["collect", "--samples", "40", "--points", "400"];
    succeed_json(&[&size[..], &robot, &["--out", text(&data)]].concat());

    succeed(&["data", "view", text(&data), "--out", text(&page)]);
    let seen = fs::read_to_string(&page).unwrap();
    assert_eq!(seen.matches(">command (N)</text>").count(), 4);
    assert_eq!(seen.matches(">command (mm)</text>").count(), 4);
    assert!(!seen.contains("command (m)"));
    // A row of four for each module.
    let rows: Vec<&str> = seen
        .split("<svg ")
        .filter(|svg| svg.contains("motor "))
        .collect();
    assert_eq!(rows.len(), 2);
    assert!(rows[0].contains("module 1") && rows[0].contains("motor 4<"));
    assert!(rows[1].contains("module 2") && rows[1].contains("motor 5<"));
    let info = &succeed_json(&["data", "info", text(&data)])[0];
    let units = info["motor_units"].as_array().unwrap();
    assert_eq!(
        (units.len(), &units[3], &units[4]),
        (8, &"N".into(), &"m".into())
    );

    let trained = train_tiny(&data, &path("run"), &[]);
    let report = path("scores.html");
    let model = trained["model"].as_str().unwrap();
    let arguments = ["--report", text(&report)];
    let scores = succeed_json(&[&eval_small(model, &data)[..], &arguments].concat());
    let said = fs::read_to_string(&report).unwrap();
    let command: Vec<f64> = (scores["worst"][0]["command"].as_array().unwrap().iter())
        .map(|x| x.as_f64().unwrap())
        .collect();
    let shown = |values: &[f64], scale: f64, decimals: usize| {
        let texts: Vec<String> = values
            .iter()
            .map(|x| format!("{:.decimals$}", scale * x))
            .collect();
        texts.join(", ")
    };
    let expected = format!(
        "Command: {}\u{a0}N | {}\u{a0}mm<",
        shown(&command[..4], 1.0, 2),
        shown(&command[4..], 1e3, 1)
    );
    assert!(said.contains(&expected), "{expected}");
    // A ratio of distances, where CD is one of squared distances.
    let value = |key: &str| scores[key].as_f64().unwrap();
    let ratio = (value("cd_nearest") / value("cd")).sqrt();
    assert!(
        said.contains(&format!("{ratio:.1} times as far")),
        "{ratio}"
    );
    assert!(said.contains("root mean square, 400 points a cloud"));
    // Tips are known of simulated robots.
    assert!(value("tip") > 0.0 && value("tip_nearest") > 0.0);
    assert!(said.contains("Errors over the commands") && said.contains("Motor 5 (mm)"));
}

#[test]
fn motors_of_imported_clouds_have_units_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (data, out, again, page) = (path("data"), path("out"), path("again"), path("page.html"));
    collect_small(&data, &[]);
    succeed(&[
        "data",
        "export",
        text(&data),
        "--format",
        "npz",
        "--out",
        text(&out),
    ]);
    succeed(&[
        "data",
        "import",
        text(&out.join("train")),
        "--out",
        text(&again),
        "--points",
        "300",
    ]);
    succeed(&["data", "view", text(&again), "--out", text(&page)]);
    let page = fs::read_to_string(&page).unwrap();
    assert_eq!(page.matches("command (motor units)").count(), 6);
    assert!(!page.contains("command (m)"));
    // Few tips are drawn large enough to be seen.
    let workspace = page.split("<svg ").nth(1).unwrap();
    assert!(workspace.contains("again, 16 tips"), "of all clouds");
    assert!(workspace.contains("r=\"3\""));
}

#[test]
fn as_many_clouds_are_shown_as_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let (data, page) = (folder.path().join("data"), folder.path().join("page.html"));
    let size = ["collect", "--samples", "100", "--points", "100"];
    succeed_json(&[&size[..], &["--out", text(&data)]].concat());
    succeed(&[
        "data",
        "view",
        text(&data),
        "--clouds",
        "8",
        "--out",
        text(&page),
    ]);
    assert!(
        fs::read_to_string(&page)
            .unwrap()
            .contains("8 clouds, each across")
    );
}

#[test]
fn help_names_the_units_of_every_drive() {
    for command in ["render", "predict", "settle"] {
        let help = succeed(&[command, "--help"]);
        assert!(
            help.contains("or N for a tension drive"),
            "{command}: {help}"
        );
    }
    let folder = tempfile::tempdir().unwrap();
    let robot = four_tendons(folder.path());
    let views = folder.path().join("views");
    let command = [
        "--command",
        "2.36,0,1,0,0.11,0.12,0.12,0.13",
        "--out",
        text(&views),
    ];
    succeed(&[&["render", "--robot", text(&robot)], &command[..]].concat());
}
