//! `tdcr calibrate` on clouds: data sets and logs of captures.

use std::fs;
use std::path::{Path, PathBuf};

use tdcr::pipeline::Silent;
use tdcr::pipeline::recording::{CalibrateSettings, Calibration, Fitted, calibrate};
use tdcr::sim::robot::{Backbone, Drive, PerDisc, RobotSpec};

use crate::capture::{capture, small_rig};
use crate::{refuse, succeed, succeed_json, text};

/// A robot file of two modules on a backbone of a bending stiffness (N m/rad a joint), whose tendons stretch.
fn robot(folder: &Path, name: &str, stiffness: f64) -> PathBuf {
    let mut spec = RobotSpec::standard("2m").unwrap();
    for module in &mut spec.modules {
        module.backbone = Some(PerDisc::Uniform(Backbone::isotropic(stiffness)));
        if let Some(tendons) = &mut module.tendons {
            tendons.drive = Drive::Gain(2000.0);
        }
    }
    let path = folder.join(name);
    fs::write(&path, spec.to_toml().unwrap()).unwrap();
    path
}

fn collect(robot: &Path, out: &Path, options: &[&str]) {
    let set = ["collect", "--robot", text(robot), "--out", text(out)];
    succeed(&[&set[..], &["--points", "200"], options].concat());
}

#[test]
fn a_data_set_gives_the_stiffness_of_its_robot_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (first, real) = (
        robot(folder.path(), "first.toml", 0.3),
        robot(folder.path(), "real.toml", 0.36),
    );
    let data = path("data");
    collect(&real, &data, &["--samples", "30", "--payload", "0.01:0.05"]);
    let out = path("calibrated.toml");
    let page = path("page.html");
    let run = |robot: &Path, more: &[&str]| {
        let on = ["calibrate", "--robot", text(robot), "--data", text(&data)];
        succeed_json(&[&on[..], more].concat())
    };
    let files = ["--out", text(&out), "--report", text(&page)];
    let found = run(
        &first,
        &[&["--fit", "stiffness,pretension"], &files[..]].concat(),
    );
    for parameter in found["parameters"].as_array().unwrap() {
        let (value, name) = (parameter["value"].as_f64().unwrap(), &parameter["name"]);
        let (truth, near) = match parameter["group"].as_str().unwrap() {
            "stiffness" => (1.2, 0.05),
            _ => (0.0, 3e-4),
        };
        assert!((value - truth).abs() < near, "{name}: {value}");
    }
    let number = |key: &str| found[key].as_f64().unwrap();
    assert!(number("train_rmse") < 1e-3, "{found}");
    assert!(
        number("train_rmse") < 0.5 * number("uncalibrated_rmse"),
        "{found}"
    );
    assert!(number("validation_rmse") < 1e-3, "{found}");
    assert_eq!(
        (&found["rows"], &found["validation_rows"]),
        (&24.into(), &6.into())
    );
    assert_eq!(
        (&found["measured"], &found["validated_on_splits"]),
        (&"clouds".into(), &true.into())
    );
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.contains("Median distances of the clouds"));
    assert!(html.contains("(root mean square: "));
    // What was written says the same when nothing more is fitted, and the folder itself may be named for validation.
    let map = path("calibrated.columns.toml");
    let none = [
        "--columns",
        text(&map),
        "--fit",
        "none",
        "--validate",
        text(&data),
    ];
    let again = run(&out, &none);
    for key in ["train_rmse", "validation_rmse"] {
        let difference = again[key].as_f64().unwrap() - number(key);
        assert!(difference.abs() < 1e-9, "{key}: {difference}");
    }
}

fn rows(robot: &RobotSpec, data: &Path) -> Calibration {
    let settings = CalibrateSettings {
        fitted: Fitted::nothing(),
        ..CalibrateSettings::default()
    };
    calibrate(robot, None, data, None, &settings, &Silent).unwrap()
}

#[test]
fn a_data_set_and_the_log_of_its_capture_have_the_same_rows() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let out = folder.path().join("data");
    succeed(&capture(&rig, &out));
    let spec = RobotSpec::load(text(&folder.path().join("paper-robot.toml"))).unwrap();
    let set = rows(&spec, &out);
    let log = rows(&spec, &out.join("log.mcap"));
    assert!(log.validation.is_none() && !log.found.validated_on_splits);
    let of_set = [&set.train, set.validation.as_ref().unwrap()];
    let mut matched = 0;
    for compared in of_set {
        let recording = &compared.file.recording;
        for (pulls, misses) in recording.pulls.iter().zip(&compared.after.distances) {
            let logged = &log.train.file.recording;
            // The set has commands in single precision, and those of whole ticks.
            let near = |other: &[f64]| {
                let mut pairs = pulls.iter().zip(other);
                pairs.all(|(a, b)| (a - b).abs() < 2e-5)
            };
            let found: Vec<usize> = (0..logged.len())
                .filter(|&row| near(&logged.pulls[row]))
                .collect();
            let [row] = found[..] else {
                panic!("{found:?}")
            };
            let median = |distances: &[f64]| {
                let mut sorted = distances.to_vec();
                sorted.sort_by(f64::total_cmp);
                sorted[sorted.len() / 2]
            };
            // Other points of one surface, some of them stray.
            let [one, other] = [median(misses), median(&log.train.after.distances[row])];
            assert!((one - other).abs() < 0.3 * one, "{one}, {other}");
            matched += 1;
        }
    }
    assert_eq!((matched, log.found.rows), (20, 20));
}

#[test]
fn clouds_that_cannot_be_calibrated_on_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let [empty, data, table, log] = ["empty", "data", "rows.csv", "torn.mcap"].map(path);
    fs::create_dir(&empty).unwrap();
    fs::write(&table, "a,b\n1,2\n").unwrap();
    fs::write(&log, "no log").unwrap();
    let two = robot(folder.path(), "2m.toml", 0.3);
    collect(&two, &data, &["--samples", "10"]);
    let refused = |robot: &str, data: &Path, more: &[&str], said: &str| {
        let on = ["calibrate", "--robot", robot, "--data", text(data)];
        refuse(&[&on[..], more].concat(), 1, said);
    };
    refused("2m", &empty, &[], "there is no data set in");
    refused(
        "3m",
        &data,
        &[],
        "has commands of 6 tendons; the robot has 9",
    );
    refused("2m", &table, &[], "it is a table, which needs a column map");
    refused("2m", &log, &[], "is not a log");
    refused("2m", &path("nowhere"), &[], "cannot read ");
    let lag = ["--fit", "lag"];
    refused(
        "2m",
        &data,
        &lag,
        "cannot fit lag: each row is the robot at rest",
    );
    let map = ["--fit", "servo_map"];
    refused(
        "2m",
        &data,
        &map,
        "whose rows are clouds; expected a table of markers",
    );
    let other = ["--validate", text(&table)];
    refused("2m", &data, &other, "one has markers, the other clouds");
}
