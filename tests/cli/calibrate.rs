//! `tdcr calibrate`.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{refuse, succeed_json, text};

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("examples/opencr")
        .join(name)
}

/// The first `rows` rows of a recording, one line changed.
fn excerpt(folder: &Path, rows: usize, change: impl Fn(usize, &str) -> String) -> PathBuf {
    let whole = fs::read_to_string(example("real_robot_v4_train.csv")).unwrap();
    let lines: Vec<String> = (1..)
        .zip(whole.lines().take(rows + 1))
        .map(|(line, row)| change(line, row))
        .collect();
    let file = folder.join("excerpt.csv");
    fs::write(&file, lines.join("\n")).unwrap();
    file
}

fn same(_: usize, row: &str) -> String {
    row.to_owned()
}

fn on<'a>(data: &'a Path, robot: &'a Path, columns: &'a Path) -> Vec<&'a str> {
    let options = [
        "--robot",
        text(robot),
        "--data",
        text(data),
        "--columns",
        text(columns),
    ];
    [&["calibrate"], &options[..]].concat()
}

#[test]
fn a_recording_calibrates_a_robot_that_the_same_command_reads_again() {
    let folder = tempfile::tempdir().unwrap();
    let (robot, columns) = (example("robot.toml"), example("columns.toml"));
    let data = excerpt(folder.path(), 60, same);
    let validation = example("real_robot_v4_tendon_pull.csv");
    let [out, page] = ["calibrated.toml", "page.html"].map(|name| folder.path().join(name));
    let fit = [
        "--fit",
        "pretension,lag,base_pose,stiffness",
        "--validate",
        text(&validation),
    ];
    let files = ["--out", text(&out), "--report", text(&page)];
    let found = succeed_json(&[&on(&data, &robot, &columns)[..], &fit, &files].concat());
    let number = |key: &str| found[key].as_f64().unwrap();
    assert!(number("train_rmse") < 0.8 * number("uncalibrated_rmse"));
    assert!(number("validation_rmse") < number("uncalibrated_validation_rmse"));
    assert_eq!(
        (&found["rows"], &found["validation_rows"]),
        (&Value::from(60), &Value::from(134))
    );
    let parameters = found["parameters"].as_array().unwrap();
    assert_eq!(parameters.len(), 9 + 1 + 6 + 3);
    for parameter in parameters {
        let ends = parameter["interval"].as_array().unwrap();
        let [low, high] = [0, 1].map(|end: usize| ends[end].as_f64().unwrap());
        assert!(
            (low..=high).contains(&parameter["value"].as_f64().unwrap()),
            "{parameter}"
        );
    }
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.contains("Calibration of opencr") && html.contains("offset of servo 8"));
    // What was written says the same when nothing more is fitted.
    let map = folder.path().join("calibrated.columns.toml");
    let again = succeed_json(&[&on(&data, &out, &map)[..], &["--fit", "none"]].concat());
    let difference = again["train_rmse"].as_f64().unwrap() - number("train_rmse");
    assert!(difference.abs() < 1e-9, "{difference}");
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let (robot, columns) = (example("robot.toml"), example("columns.toml"));
    let data = excerpt(folder.path(), 30, same);
    let fit = ["--fit", "pretension,lag", "--starts", "2"];
    let run = |threads: &str| {
        succeed_json(
            &[
                &on(&data, &robot, &columns)[..],
                &fit,
                &["--threads", threads],
            ]
            .concat(),
        )
    };
    assert_eq!(run("1"), run("3"));
}

#[test]
fn bad_rows_are_named_by_line_and_left_out_only_where_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let (robot, columns) = (example("robot.toml"), example("columns.toml"));
    let data = excerpt(folder.path(), 30, |line, row| {
        let cells: Vec<&str> = row.split(',').collect();
        match line {
            // A number that is none, a row cut short, a marker far away.
            7 => [&cells[..cells.len() - 1], &["nan"]].concat().join(","),
            12 => cells[..5].join(","),
            20 => [&cells[..cells.len() - 1], &["900.0"]].concat().join(","),
            _ => row.to_owned(),
        }
    });
    for part in [
        "3 bad rows",
        "line 7: tip_z is `nan`",
        "line 12: 5 cells",
        "line 20: tip_x, tip_y, tip_z jumps",
    ] {
        refuse(&on(&data, &robot, &columns), 1, part);
    }
    let found = succeed_json(
        &[
            &on(&data, &robot, &columns)[..],
            &["--fit", "none", "--skip-bad-rows"],
        ]
        .concat(),
    );
    assert_eq!(found["bad_lines"], serde_json::json!([7, 12, 20]));
    assert_eq!(found["rows"], 28);
}

#[test]
fn a_column_map_that_does_not_fit_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let robot = example("robot.toml");
    let data = excerpt(folder.path(), 30, same);
    let map = fs::read_to_string(example("columns.toml")).unwrap();
    let columns = folder.path().join("columns.toml");
    let refused = |from: &str, to: &str, expected: &str| {
        fs::write(&columns, map.replacen(from, to, 1)).unwrap();
        refuse(&on(&data, &robot, &columns), 1, expected);
    };
    refused(
        "servo_9_mm",
        "servo_0_mm",
        "has no column `servo_0_mm`; its columns are timestamp, ",
    );
    refused(
        "unit = \"mm\"",
        "unit = \"rad\"",
        "needs the `spool_radius`",
    );
    refused(
        "disc = \"tip\"",
        "disc = 24",
        "disc is 24; the robot has discs 0 to 23",
    );
    let tenth = "[[servos]]\ncolumn = \"servo_1_mm\"\nunit = \"mm\"\n\n[[markers]]";
    refused(
        "[[markers]]",
        tenth,
        "10 servos; expected one [[servos]] for each of the robot's 9 tendons",
    );
}

/// Another robot, other units, names and signs, and no clock.
#[test]
fn angles_of_spools_in_other_units_and_signs_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let robot = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/one-module.toml");
    let columns = folder.path().join("columns.toml");
    let servo = |name: &str| {
        format!(
            "[[servos]]\ncolumn = \"{name}\"\nunit = \"deg\"\nsign = -1\nzero = 180.0\nspool_radius = 0.01\n"
        )
    };
    let markers = "[[markers]]\ndisc = 3\ncolumns = [\"X\", \"Y\", \"Z\"]\nunit = \"cm\"\n";
    fs::write(&columns, ["a", "b", "c"].map(servo).concat() + markers).unwrap();
    let mut rows = String::from("X;Y;Z;a;b;c\n");
    for k in 0..12 {
        rows += &format!("0;0;8;{};180;180\n", 180 - k);
    }
    let data = folder.path().join("rows.csv");
    fs::write(&data, rows).unwrap();
    let found = succeed_json(&[&on(&data, &robot, &columns)[..], &["--fit", "none"]].concat());
    assert_eq!(found["rows"], 12);
    assert!(found["train_rmse"].as_f64().unwrap() > 0.0);
}
