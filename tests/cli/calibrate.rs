//! `tdcr calibrate`.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tdcr::sim::chain::Configuration;
use tdcr::sim::robot::{Loads, Robot, RobotSpec};

use crate::{refuse, stderr, succeed_json, tdcr, text};

pub fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("examples/opencr")
        .join(name)
}

/// The first `rows` rows of a recording, one line changed.
pub fn excerpt(folder: &Path, rows: usize, change: impl Fn(usize, &str) -> String) -> PathBuf {
    let whole = fs::read_to_string(example("real_robot_v4_train.csv")).unwrap();
    let lines: Vec<String> = (1..)
        .zip(whole.lines().take(rows + 1))
        .map(|(line, row)| change(line, row))
        .collect();
    let file = folder.join("excerpt.csv");
    fs::write(&file, lines.join("\n")).unwrap();
    file
}

pub fn same(_: usize, row: &str) -> String {
    row.to_owned()
}

pub fn on<'a>(data: &'a Path, robot: &'a Path, columns: &'a Path) -> Vec<&'a str> {
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
    assert!(html.contains("Calibration of opencr") && html.contains("offset of servo 9"));
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

/// The example's map with servos in the order of their numbers, and the one of tendon 3 the other way round; and their columns in
/// the right order.
fn shuffled(folder: &Path) -> (PathBuf, Vec<String>) {
    let map = fs::read_to_string(example("columns.toml")).unwrap();
    let columns: Vec<String> = (map.lines())
        .filter_map(|line| line.strip_prefix("column = \"servo_"))
        .map(|rest| format!("servo_{}", rest.trim_end_matches('"')))
        .collect();
    let [head, tail] = [
        map.find("[[servos]]").unwrap(),
        map.find("[[markers]]").unwrap(),
    ];
    let mut sorted = columns.clone();
    sorted.sort_unstable();
    let servo = |column: &String| {
        let sign = if *column == columns[3] {
            "sign = -1\n"
        } else {
            ""
        };
        format!("[[servos]]\ncolumn = \"{column}\"\nunit = \"mm\"\n{sign}\n")
    };
    let servos: String = sorted.iter().map(servo).collect();
    let file = folder.join("columns.toml");
    fs::write(&file, format!("{}{servos}{}", &map[..head], &map[tail..])).unwrap();
    (file, columns)
}

/// Columns in another order and of other signs than the tendons': single pulls tell the right ones.
#[test]
fn single_pulls_tell_which_servo_pulls_which_tendon() {
    let folder = tempfile::tempdir().unwrap();
    let robot = example("robot.toml");
    let (shuffled, columns) = shuffled(folder.path());
    let data = example("real_robot_v4_tendon_pull.csv");
    let doubted = tdcr(&[&on(&data, &robot, &shuffled)[..], &["--fit", "none"]].concat()).output();
    let said = stderr(&doubted.unwrap());
    assert!(
        said.contains("servo_map among what is fitted finds which"),
        "{said}"
    );
    let out = folder.path().join("mapped.toml");
    let fit = ["--fit", "servo_map", "--out", text(&out)];
    let found = succeed_json(&[&on(&data, &robot, &shuffled)[..], &fit].concat());
    let servos = found["servo_map"]["servos"].as_array().unwrap();
    let names = servos.iter().map(|servo| servo["column"].as_str().unwrap());
    assert_eq!(names.collect::<Vec<_>>(), columns);
    assert!(
        servos.iter().all(|servo| servo["sign"] == 1.0),
        "{servos:?}"
    );
    assert!(found["servo_map"]["turn"].as_f64().unwrap().abs() < 0.3);
    // What was found is a column map, with which nothing is in doubt.
    let mapped = out.with_extension("columns.toml");
    let again = tdcr(&[&on(&data, &robot, &mapped)[..], &["--fit", "none"]].concat()).output();
    let said = stderr(&again.unwrap());
    assert!(!said.contains("servo_map"), "{said}");
}

/// With the default unknowns, columns that the recording contradicts are put right before the fit: the order of the servos, and axes of
/// motion capture that are not the robot's.
#[test]
fn a_default_fit_puts_servos_and_frame_right() {
    let folder = tempfile::tempdir().unwrap();
    let robot = example("robot.toml");
    let data = example("real_robot_v4_tendon_pull.csv");
    let [right, all] = [None, Some("default,friction")].map(|fit| {
        let fit: Vec<&str> = fit.iter().flat_map(|fit| ["--fit", fit]).collect();
        succeed_json(&[&on(&data, &robot, &example("columns.toml"))[..], &fit].concat())
    });
    assert!(right["servo_map"].is_null() && right["frame"].is_null());
    let count = |found: &Value| found["parameters"].as_array().unwrap().len();
    assert_eq!(
        count(&all),
        count(&right) + 3,
        "a coefficient for each module"
    );
    let rmse = |found: &Value| found["train_rmse"].as_f64().unwrap();
    let (order, columns) = shuffled(folder.path());
    let found = succeed_json(&on(&data, &robot, &order));
    let servos = found["servo_map"]["servos"].as_array().unwrap();
    assert!(
        servos
            .iter()
            .zip(&columns)
            .all(|(servo, column)| servo["column"] == **column)
    );
    assert!(
        rmse(&found) < 1.1 * rmse(&right),
        "{} {}",
        rmse(&found),
        rmse(&right)
    );
    // Axes in another order: a third of a turn about the diagonal.
    let map = fs::read_to_string(example("columns.toml")).unwrap();
    let axes = folder.path().join("axes.toml");
    let turned = map.replace(
        r#"["tip_x", "tip_y", "tip_z"]"#,
        r#"["tip_z", "tip_x", "tip_y"]"#,
    );
    assert_ne!(turned, map);
    fs::write(&axes, turned).unwrap();
    let said = tdcr(&[&on(&data, &robot, &axes)[..], &["--json"]].concat()).output();
    let said = said.unwrap();
    let notes = stderr(&said);
    assert!(notes.contains("frame lies turned by 1"), "{notes}");
    let found: Value = serde_json::from_slice(&said.stdout).unwrap();
    let turn = found["frame"]["turn"].as_f64().unwrap();
    assert!((turn - 2.0944).abs() < 0.2, "{turn}");
    assert!(
        rmse(&found) < 1.1 * rmse(&right),
        "{} {}",
        rmse(&found),
        rmse(&right)
    );
}

/// A disc's orientation, where it was measured too, tells what the tip's place does not: how far the tip is turned.
#[test]
fn orientations_count_beside_places() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut spec = RobotSpec::standard("2m").unwrap();
    for tendons in spec
        .modules
        .iter_mut()
        .filter_map(|module| module.tendons.as_mut())
    {
        tendons.range = [0.0, 1.0];
    }
    let robot = Robot::new(spec).unwrap();
    let (lengths, _) = robot.tendon_kinematics(&Configuration::straight(&robot));
    let mut table = String::from("a,b,c,d,e,f,x,y,z,w,i,j,k\n");
    for row in 0..40 {
        let pull = |t: usize| 4e-3 + 4e-3 * (0.7 * f64::from(row) + 2.1 * t as f64).sin();
        let command: Vec<f64> = (0..6).map(|t| lengths[t] - pull(t)).collect();
        let settled = robot.settle(&robot.command(&command).unwrap(), &Loads::default());
        let (place, turn) = (
            settled.positions.last().unwrap(),
            settled.orientations.last().unwrap(),
        );
        let numbers = (0..6).map(pull).chain(place.iter().copied());
        let numbers: Vec<String> = (numbers.chain([turn.w, turn.i, turn.j, turn.k]))
            .map(|number| number.to_string())
            .collect();
        table += &(numbers.join(",") + "\n");
    }
    let data = path("recording.csv");
    fs::write(&data, table).unwrap();
    let servos: String = ["a", "b", "c", "d", "e", "f"]
        .iter()
        .map(|column| format!("[[servos]]\ncolumn = \"{column}\"\nunit = \"m\"\n"))
        .collect();
    let marker = "[[markers]]\ndisc = \"tip\"\ncolumns = [\"x\", \"y\", \"z\"]\nunit = \"m\"\n\
        orientation = [\"w\", \"i\", \"j\", \"k\"]\n";
    let columns = path("columns.toml");
    fs::write(&columns, format!("{servos}{marker}")).unwrap();
    let robot = PathBuf::from("2m");
    let none = ["--fit", "none"];
    let right = succeed_json(&[&on(&data, &robot, &columns)[..], &none].concat());
    assert!(right["train_rmse"].as_f64().unwrap() < 1e-6, "{right}");
    // Turned by 0.2 rad about z: 0.02 m of lever misses 4 mm at two of three points, less their mean.
    let turned = format!("{servos}{marker}turn = [0.995004165, 0.0, 0.0, 0.0998334166]\n");
    fs::write(&columns, turned).unwrap();
    let wrong = succeed_json(&[&on(&data, &robot, &columns)[..], &none].concat());
    assert!(wrong["train_rmse"].as_f64().unwrap() > 1e-4, "{wrong}");
    let out = path("found.toml");
    let fit = ["--fit", "marker_offset", "--out", text(&out)];
    succeed_json(&[&on(&data, &robot, &columns)[..], &fit].concat());
    let found = fs::read_to_string(out.with_extension("columns.toml")).unwrap();
    let found: toml::Table = found.parse().unwrap();
    let marker = &found["markers"][0];
    let turn = marker
        .get("turn")
        .map_or(0.0, |turn| turn[3].as_float().unwrap());
    assert!(turn.abs() < 0.02, "{marker:?}");
    let broken = fs::read_to_string(&columns)
        .unwrap()
        .replace("\"k\"", "\"q\"");
    fs::write(&columns, broken).unwrap();
    refuse(
        &[&on(&data, &robot, &columns)[..], &none].concat(),
        1,
        "no column `q`",
    );
}
