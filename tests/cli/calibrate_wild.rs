//! Recordings, and maps of their columns, that `tdcr calibrate` must not take as they are.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::calibrate::{example, excerpt, on, same};
use crate::{refuse, stderr, succeed_json, tdcr, text};

/// The recording's excerpt with another number in a servo's cell of line 12.
fn with_cell(folder: &Path, cell: &str) -> PathBuf {
    excerpt(folder, 60, |line, row| match line {
        12 => {
            let mut cells: Vec<&str> = row.split(',').collect();
            cells[2] = cell;
            cells.join(",")
        }
        _ => row.to_owned(),
    })
}

#[test]
fn a_wild_cell_of_a_servo_is_refused_by_row_and_column_and_left_out_where_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let (robot, columns) = (example("robot.toml"), example("columns.toml"));
    let named = "line 12: servo_4_mm";
    // A metre, where millimetres stand; its number in metres; what no number could be.
    for cell in ["1e300", "-1000", "1000.0"] {
        let data = with_cell(folder.path(), cell);
        refuse(&on(&data, &robot, &columns), 1, named);
    }
    let without = ["--skip-bad-rows", "--fit", "none", "--json"];
    let data = with_cell(folder.path(), "1e300");
    let output = tdcr(&[&on(&data, &robot, &columns)[..], &without].concat()).output();
    let output = output.unwrap();
    let said = stderr(&output);
    assert!(
        said.contains("1 bad row left out") && said.contains(named),
        "{said}"
    );
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["bad_lines"], serde_json::json!([12]));
    assert_eq!(found["rows"], 59);
    // The whole recordings have no such cell.
    for name in [
        "real_robot_v4_train.csv",
        "real_robot_v4_val.csv",
        "real_robot_v4_tendon_pull.csv",
    ] {
        let recording = example(name);
        let whole = [&on(&recording, &robot, &columns)[..], &["--fit", "none"]].concat();
        assert_eq!(
            succeed_json(&whole)["bad_lines"],
            serde_json::json!([]),
            "{name}"
        );
    }
}

#[test]
fn one_column_for_two_things_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let robot = example("robot.toml");
    let data = excerpt(folder.path(), 20, same);
    let map = fs::read_to_string(example("columns.toml")).unwrap();
    let columns = folder.path().join("columns.toml");
    let none = ["--fit", "none"];
    let refused = |from: &str, to: &str, expected: &str| {
        let changed = map.replacen(from, to, 1);
        assert_ne!(changed, map);
        fs::write(&columns, changed).unwrap();
        refuse(
            &[&on(&data, &robot, &columns)[..], &none].concat(),
            1,
            expected,
        );
    };
    refused(
        "servo_3_mm",
        "servo_4_mm",
        "column `servo_4_mm` is that of servos[0] and of servos[1]",
    );
    refused(
        "tip_y",
        "tip_x",
        "column `tip_x` is that of markers[0] and of markers[0]",
    );
    refused(
        "tip_z",
        "servo_4_mm",
        "column `servo_4_mm` is that of servos[0] and of markers[0]",
    );
    refused(
        "pattern =",
        "sign = 1\npattern =",
        "`sign` belongs in [[servos]]",
    );
}

#[cfg(unix)]
#[test]
fn what_is_no_regular_file_or_too_long_is_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let (robot, columns) = (example("robot.toml"), example("columns.toml"));
    let pipe = folder.path().join("pipe");
    let made = Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    let expected = "not a regular file";
    for special in [Path::new("/dev/zero"), &pipe] {
        refuse(&on(special, &robot, &columns), 1, expected);
        refuse(
            &on(&example("real_robot_v4_val.csv"), &robot, special),
            1,
            expected,
        );
        refuse(&["settle", "--commands", text(special)], 1, expected);
        refuse(&["eval", "--model", text(special)], 1, expected);
        refuse(&["eval", "--predictions", text(special)], 1, expected);
        refuse(&["log", "info", text(special)], 1, expected);
        refuse(&["study", text(special)], 1, expected);
    }
    let study = folder.path().join("study.toml");
    let model = "want = [\"model\"]\n[model]\nfile = \"/dev/zero\"\n";
    fs::write(&study, model).unwrap();
    let out = folder.path().join("study");
    refuse(&["study", text(&study), "--out", text(&out)], 1, expected);

    let one = excerpt(folder.path(), 1, same);
    let one = fs::read_to_string(one).unwrap();
    let (header, row) = one.split_once('\n').unwrap();
    let long = folder.path().join("long.csv");
    fs::write(
        &long,
        format!("{header}\n{}", format!("{row}\n").repeat(100_001)),
    )
    .unwrap();
    let expected = "has 100001 rows; expected at most 100000: keep one of 2 rows";
    refuse(&on(&long, &robot, &columns), 1, expected);
}
