//! `tdcr track`: tips led along paths.

use std::fs;

use serde_json::Value;

use super::capture::small_rig;
use super::{refuse, succeed, succeed_json, text};

/// Hung by its base, so that 20 g straighten it.
const HANGING: &str = "examples/hanging-2m.toml";

/// A circle in 4 s.
const CIRCLE: [&str; 7] = [
    "track",
    "--robot",
    HANGING,
    "--path",
    "circle",
    "--duration",
    "4",
];

fn tracked(options: &[&str]) -> Value {
    succeed_json(&[&CIRCLE, options].concat())
}

fn number(value: &Value, key: &str) -> f64 {
    value[key]
        .as_f64()
        .unwrap_or_else(|| panic!("no {key} in {value}"))
}

#[test]
fn a_circle_is_tracked_under_a_payload_that_nobody_knows_of() {
    for controller in ["resolved-rate", "mpc"] {
        let found = tracked(&["--payload", "0.02", "--controller", controller]);
        assert_eq!(found["controller"], controller);
        assert!(number(&found, "rms_error_percent") < 0.1, "{found}");
        assert!(number(&found, "rms_error_open_loop") > 30.0 * number(&found, "rms_error"));
        let payload = &found["estimated"][0];
        assert_eq!(payload["name"], "payload");
        assert!((number(payload, "value") - 0.02).abs() < 1e-3, "{payload}");
        assert_eq!(found["stopped"], Value::Null);
    }
}

#[test]
fn a_robot_that_swings_is_led_by_a_model_that_does() {
    let options = ["--timestep", "0.002", "--period", "0.04", "--rate", "0.5"];
    let controller = ["--controller", "moving-mpc", "--approach", "1"];
    let found = tracked(&[&options[..], &controller].concat());
    assert_eq!(found["delay_periods"], 0);
    let [closed, open] = ["rms_error", "rms_error_open_loop"].map(|key| number(&found, key));
    assert!(closed < 1e-3 && open > 5.0 * closed, "{found}");
}

#[test]
fn a_post_that_the_robot_leans_on_does_no_harm_where_the_model_has_it() {
    let folder = tempfile::tempdir().unwrap();
    let post = folder.path().join("post.toml");
    let lying = "cylinder = { radius = 0.005, length = 0.1 }\nposition = [0.025, 0.0, 0.25]\n\
                 orientation = [0.7071067811865476, 0.7071067811865476, 0.0, 0.0]\n";
    fs::write(&post, format!("[[obstacle]]\nname = \"post\"\n{lying}")).unwrap();
    let error = |option: &str| {
        let options = ["--controller", "mpc", option, text(&post)];
        number(&tracked(&options), "rms_error")
    };
    let (known, unknown) = (error("--scene"), error("--truth-scene"));
    assert!(known < 1e-4 && unknown > 10.0 * known, "{known} {unknown}");
    let robot = ["--robot", "examples/hanging-2m.toml", "--path", "circle"];
    let short = [
        "--duration",
        "0.2",
        "--approach",
        "0.2",
        "--timestep",
        "0.01",
    ];
    let blind = ["--controller", "moving-mpc", "--scene", text(&post)];
    let output = crate::tdcr(&[&["track"], &robot[..], &short, &blind].concat()).output();
    let said = crate::stderr(&output.unwrap());
    assert!(
        said.contains("model of moving-mpc has no obstacles"),
        "{said}"
    );
}

#[test]
fn trials_learn_from_one_another() {
    let options = ["--gain-error", "0.1", "--backlash", "1e-4", "--trials", "3"];
    let found = tracked(&options);
    let trials: Vec<f64> = (found["trials"].as_array().unwrap().iter())
        .map(|error| error.as_f64().unwrap())
        .collect();
    assert_eq!(trials.len(), 3);
    assert!(trials[2] < 0.5 * trials[0], "{trials:?}");
    assert_eq!(trials[2], number(&found, "rms_error"));
}

#[test]
fn the_open_loop_is_the_run_where_it_is_the_controller() {
    let found = tracked(&["--controller", "inverse", "--payload", "0.01"]);
    assert_eq!(found["rms_error"], found["rms_error_open_loop"]);
    assert!(number(&found, "rms_error_percent") > 1.0);
}

#[test]
fn the_run_is_a_table_and_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let [out, page] = ["run", "page.html"].map(|name| folder.path().join(name));
    let options = [
        "--out",
        text(&out),
        "--report",
        text(&page),
        "--delay",
        "0.1",
    ];
    let said = succeed(&[&CIRCLE[..], &options].concat());
    assert!(
        said.starts_with("RMS error of the tip over 81 periods: "),
        "{said}"
    );
    let table = fs::read_to_string(out.join("run.csv")).unwrap();
    // 4 s of approach, 4 s of path, 20 periods a second, both ends, and the header.
    assert_eq!(table.lines().count(), 162);
    let columns = table.lines().next().unwrap().split(',').count();
    assert_eq!(columns, 1 + 9 + 6 + 6 + 2 * 7 + 1);
    assert!(table.lines().all(|line| line.split(',').count() == columns));
    let open_loop = fs::read_to_string(out.join("open-loop.csv")).unwrap();
    assert_eq!(open_loop.lines().count(), 162);
    let page = fs::read_to_string(&page).unwrap();
    for title in [
        "Commands",
        "Tensions",
        "Estimated payload",
        "Distance of the tip from its target",
    ] {
        assert!(page.contains(title), "{title}");
    }
}

#[test]
fn a_circle_is_tracked_on_a_rig_seen_by_its_cameras_alone() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let out = folder.path().join("run");
    let track = [
        "track",
        "--rig",
        text(&rig),
        "--path",
        "circle",
        "--duration",
        "5",
    ];
    let options = ["--payload", "0.02", "--out", text(&out)];
    let found = succeed_json(&[&track[..], &options].concat());
    assert_eq!(found["stopped"], Value::Null, "{found}");
    assert_eq!(found["rms_error_open_loop"], Value::Null);
    assert_eq!(
        (&found["periods"], &found["late_periods"]),
        (&51.into(), &0.into())
    );
    // Two cameras of 160 by 120 pixels; with the four of the example's it is a third of this.
    assert!(number(&found, "rms_error_percent") < 4.0, "{found}");
    let table = fs::read_to_string(out.join("run.csv")).unwrap();
    assert_eq!(table.lines().count(), 92);
    for log in ["log.mcap", "run.mcap"] {
        let log = out.join(log);
        let logged = succeed_json(&["log", "info", text(&log)]);
        assert_eq!(logged["whole"], true, "{logged}");
    }
}

#[test]
fn a_robot_that_is_not_seen_ends_the_run_after_a_while() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let whole = fs::read_to_string(&rig).unwrap();
    let nowhere = whole.replace("low = [-0.20, -0.20, 0.16]", "low = [0.18, 0.18, 0.44]");
    assert_ne!(whole, nowhere);
    fs::write(&rig, nowhere).unwrap();
    // Nothing of the robot passes the masks: the tip is waited for, and then the run ends at home.
    let track = [
        "track",
        "--rig",
        text(&rig),
        "--path",
        "circle",
        "--duration",
        "9",
    ];
    let found = succeed_json(&track);
    let stopped = found["stopped"].as_str().unwrap();
    assert!(stopped.contains("the tip is not seen"), "{found}");
}

#[test]
fn a_run_that_ends_before_its_path_has_no_error_in_percent() {
    let path = ["track", "--path", "circle", "--duration", "1"];
    let said = succeed(&[&path[..], &["--payload", "1e9"]].concat());
    assert!(
        said.contains("over 0 periods: not known; in open loop"),
        "{said}"
    );
}

#[test]
fn a_path_in_time_is_read_from_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("path.csv");
    fs::write(
        &path,
        "z (m),t (s),x (m),y (m)\n0.326,0,0.03,0\n\n0.326,1,0.03,0.01\n",
    )
    .unwrap();
    let found = succeed_json(&["track", "--robot", HANGING, "--path", text(&path)]);
    assert_eq!(found["periods"], 21);
    assert!(number(&found, "rms_error_percent") < 0.1, "{found}");
}

#[test]
fn what_is_wrong_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("path.csv");
    let track = ["track", "--robot", HANGING, "--path"];
    refuse(
        &[&track[..], &["triangle"]].concat(),
        1,
        "neither a file nor a curve",
    );
    fs::write(&path, "x,y,z\n0,0,0\n").unwrap();
    refuse(
        &[&track[..], &[text(&path)]].concat(),
        1,
        "line 1: the columns are x, y, z; expected t, x, y and z",
    );
    fs::write(&path, "t,x,y,z\n0,0,0,0.3\n0,0,0,0.3\n").unwrap();
    refuse(
        &[&track[..], &[text(&path)]].concat(),
        1,
        "expected times that ascend",
    );
    let with = |options: &[&'static str]| [&CIRCLE[..], options].concat();
    refuse(
        &with(&["--centre", "0,0,1"]),
        1,
        "out of reach of robot `2m-hanging`",
    );
    refuse(
        &with(&["--rig", "examples/rig-sim.toml"]),
        2,
        "cannot be used with",
    );
    let rig = [
        "track",
        "--rig",
        "examples/rig-sim.toml",
        "--path",
        "circle",
    ];
    for (option, value) in [
        ("--friction", "0.1"),
        ("--noise", "d435"),
        ("--truth-scene", "x.toml"),
    ] {
        refuse(
            &[&rig[..], &[option, value]].concat(),
            2,
            "cannot be used with",
        );
    }
    refuse(
        &[&rig[..], &["--rate", "0.5"]].concat(),
        1,
        "the rate is 0.5 m/s; expected at most 0.02, the rig's motion.slew",
    );
    refuse(&with(&["--noise", "d415"]), 2, "nor d435");
    refuse(&with(&["--trials", "0"]), 2, "expected 1 to 1000");
    refuse(
        &with(&["--truth", "3m"]),
        1,
        "--truth has 9 tendons, and --robot 6",
    );
    refuse(
        &with(&["--friction", "3"]),
        1,
        "the coefficient of friction is 3; expected 0 to 2",
    );
    refuse(&with(&["--gain-error", "1.5"]), 2, "is no share");
    refuse(&with(&["--period", "0"]), 2, "above 0");
    refuse(&with(&["--tension", "5,1"]), 1, "tensions of 5 to 1 N");
    refuse(
        &with(&["--approach", "1e12"]),
        1,
        "periods; expected at most",
    );
}
