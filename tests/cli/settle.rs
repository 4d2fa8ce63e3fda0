//! `tdcr settle`: tables of commands, loads, compliance.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{COMMAND, refuse, stderr, succeed, succeed_json, tdcr, text};

const OTHER: &str = "0.02,0.02,0.02,0.02,0.02,0.03";

fn file(folder: &Path, name: &str, lines: &str) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, lines).unwrap();
    path
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// Where the tip comes to rest.
fn tip(settled: &Value) -> [f64; 3] {
    std::array::from_fn(|axis| number(&settled["positions"][9][axis]))
}

/// Settles [`COMMAND`] with more options.
fn settle(options: &[&str]) -> Value {
    succeed_json(&[&["settle", "--command", COMMAND], options].concat())
}

#[test]
fn a_result_says_what_it_is_of_and_in_which_units() {
    let settled = settle(&["--payload", "0.02", "--wrench", "tip:0,0,-0.1@disc"]);
    assert_eq!(settled["robot"], "2m");
    assert_eq!(settled["tdcr_version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(settled["command"][0], 0.034);
    assert_eq!(settled["loads"]["payload"], 0.02);
    assert_eq!(settled["loads"]["wrenches"][0]["disc"], 9);
    assert_eq!(settled["loads"]["wrenches"][0]["frame"], "disc");
    assert_eq!(settled["units"]["command"][5], "m");
    assert_eq!(settled["units"]["smallest_stiffness"], "N m/rad");
    assert!(number(&settled["smallest_stiffness"]) > 0.0);
}

/// As in all that people read; discs have the numbers that loads name them by.
#[test]
fn the_tables_tendons_count_from_one_and_its_discs_from_zero() {
    let printed = tdcr(&["settle", "--command", COMMAND]).output().unwrap();
    let printed = String::from_utf8(printed.stdout).unwrap();
    let (discs, tendons) = printed.split_once("\ntendon ").unwrap();
    let numbers = |table: &str| -> Vec<usize> {
        let first = table
            .lines()
            .filter_map(|line| line.split_whitespace().next());
        first.filter_map(|cell| cell.parse().ok()).collect()
    };
    assert_eq!(numbers(discs), (0..10).collect::<Vec<_>>());
    assert_eq!(numbers(tendons), (1..=6).collect::<Vec<_>>());
}

#[test]
fn a_table_has_for_each_command_what_settling_it_alone_gives() {
    let folder = tempfile::tempdir().unwrap();
    let lines = format!("c0,c1,c2,c3,c4,c5,payload\n{COMMAND},0\n{OTHER},0.01\n");
    let commands = file(folder.path(), "commands.csv", &lines);
    let table = folder.path().join("table.csv");
    let json = folder.path().join("table.json");
    for out in [&table, &json] {
        let said = succeed_json(&["settle", "--commands", text(&commands), "--out", text(out)]);
        assert_eq!(
            (&said["commands"], &said["settled"]),
            (&2.into(), &2.into())
        );
    }
    let all: Value = serde_json::from_slice(&fs::read(&json).unwrap()).unwrap();
    assert_eq!(all["units"]["tendon_tensions"], "N");
    let written = fs::read_to_string(&table).unwrap();
    let rows: Vec<Vec<&str>> = (written.lines())
        .map(|line| line.split(',').collect())
        .collect();
    let at = |name: &str| rows[0].iter().position(|column| *column == name).unwrap();
    for (row, (command, payload)) in [(COMMAND, "0"), (OTHER, "0.01")].iter().enumerate() {
        let alone = succeed_json(&["settle", "--command", command, "--payload", payload]);
        let cell = |name: &str| rows[row + 1][at(name)];
        let value = |name: &str| cell(name).parse::<f64>().unwrap();
        assert_eq!(
            [value("x (m)"), value("y (m)"), value("z (m)")],
            tip(&alone)
        );
        assert_eq!(value("qw"), number(&alone["orientations"][9][0]));
        assert_eq!(value("tension3 (N)"), number(&alone["tendon_tensions"][3]));
        assert_eq!(value("length5 (m)"), number(&alone["tendon_lengths"][5]));
        let stiffness = value("smallest_stiffness (N m/rad)");
        assert_eq!(stiffness, number(&alone["smallest_stiffness"]));
        assert_eq!(value("residual (N m)"), number(&alone["residual"]));
        assert_eq!(cell("converged"), "true");
        let tip_position = &all["settled"][row]["tip_position"][0];
        assert_eq!(number(tip_position), tip(&alone)[0]);
    }
    // The table is a file of commands again, and columns may stand in any order.
    let again = folder.path().join("again.csv");
    succeed(&["settle", "--commands", text(&table), "--out", text(&again)]);
    assert_eq!(fs::read_to_string(&again).unwrap(), written);
    let turned = "\u{feff}payload (kg),c5,c4,c3,c2,c1,c0 (m),note\n0,0.019,0.015,0.026,0.001,0.007,0.034,up\n";
    let turned = file(folder.path(), "turned.csv", turned);
    let turned = succeed_json(&["settle", "--commands", text(&turned)]);
    assert_eq!(turned["settled"][0], all["settled"][0]);
}

#[test]
fn a_header_names_columns_of_other_commands_too() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("path.csv");
    let named = file(
        folder.path(),
        "named.csv",
        &format!("a,b,c,d,e,f\n{COMMAND}\n"),
    );
    let simulate = |commands: &Path| {
        let arguments = [
            "simulate",
            "--commands",
            text(commands),
            "--out",
            text(&path),
        ];
        succeed_json(&arguments)["steps"].clone()
    };
    assert_eq!(simulate(&named), 1);
    let wrong = |lines: &str, expected: &str| {
        let commands = file(folder.path(), "wrong.csv", lines);
        refuse(&["simulate", "--commands", text(&commands)], 1, expected);
    };
    wrong(
        &format!("c0,c1,c2,c3,c4,c6\n{COMMAND}\n"),
        "wrong.csv line 1: the columns of the command are c0, c1, c2, c3, c4, c6; expected c0, c1 and so on, each once",
    );
    wrong(
        "c0,c1,c2,c3,c4,c5\n0.01,0.01\n",
        "wrong.csv line 2: the line has 2 entries, expected 6, one for each column named in the first line",
    );
    wrong(
        &format!("c0,c1,c2,c3,c4,c5,payload\n{COMMAND},0.01\n"),
        "line 2: the column payload has 0.01 kg",
    );
    wrong("c0,c1,c2,c3,c4,c5\n", "has no commands");
}

#[test]
fn compliance_is_how_far_the_tip_moves_by_a_small_force() {
    let compliance = settle(&["--compliance"])["tip_compliance"].clone();
    assert!(succeed(&["settle", "--command", COMMAND, "--compliance"]).contains("tip by"));
    let force = 1e-5;
    for (column, wrench) in ["1e-5,0,0", "0,1e-5,0", "0,0,1e-5"].iter().enumerate() {
        let there = tip(&settle(&["--wrench", &format!("9:{wrench}")]));
        let wrench = format!("tip:{}@world", wrench.replace("1e-5", "-1e-5"));
        let back = tip(&settle(&["--wrench", &wrench]));
        for row in 0..3 {
            let expected = (there[row] - back[row]) / (2.0 * force);
            let found = number(&compliance[row][column]);
            assert!(
                (found - expected).abs() < 1e-4,
                "{found} and {expected} m/N"
            );
        }
    }
}

#[test]
fn a_line_load_and_a_wrench_that_turns_with_its_disc_are_felt() {
    let unloaded = tip(&settle(&[]));
    let loaded = |options: &[&str]| tip(&settle(options));
    let hung = loaded(&["--line-load", "0,0,-0.5"]);
    assert!(hung[2] < unloaded[2] - 1e-3);
    let [world, disc] =
        ["@world", "@disc"].map(|frame| loaded(&["--wrench", &format!("tip:0,0,0.2{frame}")]));
    assert!(world != disc && world != unloaded);
    let twice = loaded(&["--wrench", "tip:0,0,0.1", "--wrench", "tip:0,0,0.1,0,0,0"]);
    for axis in 0..3 {
        assert!((twice[axis] - world[axis]).abs() < 1e-9);
    }
    // A force beside a disc's origin has the moment of its arm.
    let beside = loaded(&["--wrench", "tip@0,0.01,0:0,0,0.2@disc"]);
    let moment = loaded(&["--wrench", "tip:0,0,0.2,0.002,0,0@disc"]);
    for axis in 0..3 {
        assert!((beside[axis] - moment[axis]).abs() < 1e-9);
    }
    assert!((beside[1] - disc[1]).abs() > 1e-4);
}

#[test]
fn wrong_loads_are_named() {
    let wrong = |option: &str, value: &str, status, expected: &str| {
        let arguments = ["settle", "--command", COMMAND, option, value];
        refuse(&arguments, status, expected);
    };
    wrong("--wrench", "0,0,1", 2, "expected DISC:FX,FY,FZ");
    wrong("--wrench", "top:0,0,1", 2, "`top` is no disc");
    wrong(
        "--wrench",
        "9:0,0",
        2,
        "expected 3 numbers (N), or 6 with a moment (N m), found 2",
    );
    wrong("--wrench", "9:0,0,NaN", 2, "`NaN` is not a finite number");
    wrong(
        "--wrench",
        "9@0,1:0,0,1",
        2,
        "the point of the disc: expected 3 numbers, found 2",
    );
    wrong(
        "--wrench",
        "9:0,0,1@base",
        2,
        "the frame is @base; expected @disc or @world",
    );
    wrong(
        "--wrench",
        "10:0,0,1",
        1,
        "a wrench acts on disc 10; the robot has 10 discs",
    );
    wrong("--line-load", "0,1", 2, "expected 3 numbers, found 2");
}

#[test]
fn a_robot_without_tendons_takes_an_empty_command() {
    let folder = tempfile::tempdir().unwrap();
    let robot = include_str!("one-module.toml");
    let tendons = robot
        .lines()
        .filter(|line| !line.starts_with("tendons = "))
        .map(|line| format!("{line}\n"));
    let robot = file(folder.path(), "free.toml", &tendons.collect::<String>());
    let free = ["settle", "--robot", text(&robot), "--command", ""];
    let settled = succeed_json(&[&free[..], &["--wrench", "tip:0.001,0,0"]].concat());
    assert_eq!(settled["command"].as_array().unwrap().len(), 0);
    refuse(
        &["settle", "--command", ""],
        1,
        "the command has 0 entries; robot `2m` has 6 tendons",
    );
}

/// Beck's column: a steel wire of 0.5 m with weak damping of its own, `E I` = 0.0393 N m².
const COLUMN: &str = r#"
name = "column"
gravity = [0, 0, 0]
routing = "base"
base = { position = [0.0, 0.0, 0.0], holes = [], hole_height = 0.0 }
[[modules]]
discs = 25
length = 0.5
joint_below = 0.01
radius = 0.004
half_height = 0.0025
mass = { density = 0.0 }
holes = []
damping = 0.0
armature = 0.0
rod = { youngs = 5e10, poisson = 0.3, radius = 0.001, density = 7800.0, damping = { bending = 1e-4, torsion = 1e-4 } }
"#;

/// At 25 `E I / L²` a column flutters under a force that follows its tip, and stands under a weak one: text, JSON and table say it.
#[test]
fn a_column_that_flutters_has_not_settled() {
    let folder = tempfile::tempdir().unwrap();
    let robot = file(folder.path(), "column.toml", COLUMN);
    let arguments = ["settle", "--robot", text(&robot), "--command=", "--wrench"];
    let strong = [&arguments[..], &["tip:0,0,-3.92699@disc"]].concat();
    let output = tdcr(&strong).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = stderr(&output);
    assert!(
        said.contains("the robot did not settle: it flutters"),
        "{said}"
    );
    let table = String::from_utf8(output.stdout).unwrap();
    for expected in [
        "NOT settled (flutter)",
        "own inertia and damping",
        "small motions grow by",
    ] {
        assert!(table.contains(expected), "{table}");
    }
    let output = tdcr(&[&strong[..], &["--json"]].concat()).output().unwrap();
    let settled: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(settled["stability"], "flutter");
    assert_eq!(settled["examined"], "motion");
    assert_eq!(settled["converged"], false);
    assert!(
        (number(&settled["growth"]["rate"]) / 26.0 - 1.0).abs() < 0.05,
        "{settled}"
    );
    assert_eq!(settled["growth"]["without_damping"], true);
    let weak = succeed_json(&[&arguments[..], &["tip:0,0,-0.5@disc"]].concat());
    assert_eq!(weak["stability"], "stable");
    assert_eq!(weak["examined"], "motion");
    assert_eq!(weak["growth"], Value::Null);
    let held = succeed_json(&[&arguments[..], &["tip:0,0,-0.2"]].concat());
    assert_eq!(held["examined"], "energy");
    let commands = file(folder.path(), "commands.csv", "payload\n0\n");
    let out = folder.path().join("out.csv");
    let table = [
        "settle",
        "--robot",
        text(&robot),
        "--commands",
        text(&commands),
        "--out",
        text(&out),
    ];
    let output = tdcr(&[&table[..], &["--wrench", "tip:0,0,-3.92699@disc"]].concat())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let written = fs::read_to_string(&out).unwrap();
    assert!(
        written
            .lines()
            .next()
            .unwrap()
            .ends_with(",stability,examined"),
        "{written}"
    );
    assert!(
        written
            .lines()
            .last()
            .unwrap()
            .ends_with(",false,flutter,motion"),
        "{written}"
    );
}

/// JSON as editors of Windows write it, and endings in capitals.
#[test]
fn json_with_a_byte_order_mark_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let spec = tdcr::sim::robot::RobotSpec::standard("2m").unwrap();
    let marked = |json: String| format!("\u{feff}{json}");
    let robot = marked(serde_json::to_string(&spec).unwrap());
    let robot = file(folder.path(), "r.JSON", &robot);
    let commands = file(folder.path(), "c.JSON", &marked(format!("[[{COMMAND}]]")));
    let plain = succeed_json(&["settle", "--command", COMMAND]);
    let settle = ["settle", "--robot", text(&robot)];
    let one = succeed_json(&[&settle[..], &["--command", COMMAND]].concat());
    assert_eq!(one["positions"], plain["positions"]);
    let many = succeed_json(&[&settle[..], &["--commands", text(&commands)]].concat());
    assert_eq!(many["settled"][0]["tip_position"], plain["positions"][9]);
    let wide: Vec<u8> = "\u{feff}[[1]]"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    fs::write(&commands, wide).unwrap();
    refuse(
        &["settle", "--commands", text(&commands)],
        1,
        "UTF-16 text; expected UTF-8",
    );
}

#[test]
fn a_robot_without_tendons_needs_no_command_and_others_are_told_which() {
    let folder = tempfile::tempdir().unwrap();
    let mut spec = tdcr::sim::robot::RobotSpec::standard("2m").unwrap();
    spec.modules
        .iter_mut()
        .for_each(|module| module.tendons = None);
    let robot = spec.to_toml().unwrap();
    let robot = file(folder.path(), "robot.toml", &robot);
    let on = ["settle", "--robot", text(&robot)];
    let alone = succeed_json(&on);
    assert_eq!(
        alone["positions"],
        succeed_json(&[&on[..], &["--command", ""]].concat())["positions"]
    );
    let images = folder.path().join("images");
    let expected = "robot `2m` has 6 tendons; expected --command C,C,... with a value for each";
    refuse(&["settle"], 1, expected);
    refuse(&["render", "--out", text(&images)], 1, expected);
}

#[test]
fn a_field_in_a_table_that_has_none_of_its_name_is_sent_where_it_belongs() {
    let folder = tempfile::tempdir().unwrap();
    let robot = tdcr::sim::robot::RobotSpec::standard("2m")
        .unwrap()
        .to_toml()
        .unwrap();
    let robot = format!("tendons = {{ drive = \"length\" }}\n{robot}");
    let robot = file(folder.path(), "robot.toml", &robot);
    let expected = "`tendons` belongs in [[modules]]";
    refuse(
        &["settle", "--robot", text(&robot), "--command", COMMAND],
        1,
        expected,
    );
    let study = file(
        folder.path(),
        "study.toml",
        "want = [\"tip\"]\nvalues = [1]\n",
    );
    refuse(&["study", text(&study)], 1, "`values` belongs in [[vary]]");
    let rig = fs::read_to_string("examples/rig-sim.toml").unwrap();
    let rig = file(folder.path(), "rig.toml", &format!("current = 0.5\n{rig}"));
    refuse(
        &["scan", "--rig", text(&rig)],
        1,
        "`current` belongs in [safety]",
    );
}
