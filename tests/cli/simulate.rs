//! `tdcr simulate`: robots in motion.

use std::path::PathBuf;

use crate::{refuse, succeed, succeed_json, text};

/// A folder with a file of commands.
fn commands(lines: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("commands.csv");
    std::fs::write(&file, lines).unwrap();
    (folder, file)
}

const PULL: &str = "0.03,0.01,0.01,0.02,0.02,0.02\n";

#[test]
fn simulate_moves_the_robot_and_writes_its_path() {
    let (folder, file) = commands(&format!("# one command a step\n\n{}", PULL.repeat(50)));
    let path = folder.path().join("path.csv");
    let arguments = ["simulate", "--commands", text(&file), "--out", text(&path)];
    let simulated = succeed_json(&arguments);
    assert_eq!(simulated["steps"], 50);
    assert!((simulated["time"].as_f64().unwrap() - 0.1).abs() < 1e-12);
    let tip = &simulated["positions"][9];
    assert!(tip[0].as_f64().unwrap().abs() > 1e-4, "{tip}");
    assert_eq!(simulated["velocity"].as_array().unwrap().len(), 30);

    let rows = std::fs::read_to_string(&path).unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    assert_eq!(rows.len(), 51);
    assert!(rows[0].starts_with("time (s),x0 (m),y0 (m),z0 (m),x1 (m)"));
    let last: Vec<f64> = rows[50].split(',').map(|x| x.parse().unwrap()).collect();
    assert_eq!(last.len(), 31);
    for axis in 0..3 {
        assert_eq!(last[28 + axis], tip[axis].as_f64().unwrap());
    }
    let table = succeed(&arguments);
    assert!(table.contains("50 steps, 0.100 s"), "{table}");
}

#[test]
fn the_integrators_agree_to_first_order_and_a_payload_is_felt() {
    let (_folder, file) = commands(&PULL.repeat(100));
    let height = |options: &[&str]| {
        let arguments = [&["simulate", "--commands", text(&file)], options].concat();
        succeed_json(&arguments)["positions"][9][2]
            .as_f64()
            .unwrap()
    };
    let euler = height(&[]);
    let runge_kutta = height(&["--integrator", "runge-kutta4"]);
    assert!(euler != runge_kutta && (euler - runge_kutta).abs() < 1e-4);
    assert!((height(&["--payload", "0.02"]) - euler).abs() > 1e-5);
}

#[test]
fn wrong_commands_are_named_with_their_line() {
    let simulate = |lines: &str, expected: &str| {
        let (_folder, file) = commands(lines);
        refuse(&["simulate", "--commands", text(&file)], 1, expected);
    };
    simulate(
        &format!("{PULL}0.1,0,0,0,0,0\n"),
        "line 2: command entry 1 is 0.1 m; tendon 1 takes",
    );
    simulate(
        "0.1,0,0\n",
        "line 1: the command has 3 entries; robot `2m` has 6 tendons",
    );
    simulate(
        &format!("{PULL}\n0.01,x,0,0,0,0\n"),
        "line 3: `x` is not a number",
    );
    simulate("# nothing\n", "has no commands; expected one per line");
    refuse(
        &["simulate", "--commands", "/no/such.csv"],
        1,
        "cannot read commands from /no/such.csv",
    );
    let (_folder, file) = commands(PULL);
    let arguments = ["simulate", "--commands", text(&file), "--dt", "0"];
    refuse(&arguments, 2, "expected a finite number above 0");
}

#[test]
fn a_step_that_the_robot_is_too_stiff_for_is_refused() {
    let (folder, file) = commands("0.03,0.01,0.02,0.01,0.01,0.01\n");
    let robot = folder.path().join("stiff.toml");
    let stiff = include_str!("../../sim/robots/2m.toml").replace("gain = 500.0", "gain = 1e7");
    std::fs::write(&robot, stiff).unwrap();
    for integrator in ["semi-implicit-euler", "runge-kutta4"] {
        let stiff = [
            "simulate",
            "--robot",
            text(&robot),
            "--commands",
            text(&file),
        ];
        refuse(
            &[&stiff[..], &["--integrator", integrator]].concat(),
            1,
            "steps of 0.002 s are unstable",
        );
    }
}

#[test]
fn objects_move_and_their_poses_are_written() {
    let (folder, file) = commands(&"0.034,0.007,0.001,0.026,0.015,0.019\n".repeat(400));
    let scene = folder.path().join("scene.toml");
    let path = folder.path().join("path.csv");
    std::fs::write(
        &scene,
        "[[obstacle]]\nname = 'table'\nbox = { size = [0.3, 0.4, 0.02] }\nposition = [-0.2, 0.0, 0.23]\nfriction = 0.3\n
         [[obstacle]]\nname = 'a, \"b\"'\nbox = { size = [0.03, 0.06, 0.05] }\nposition = [-0.062, 0.0, 0.265]\nmass = 0.02\n",
    )
    .unwrap();
    let arguments = [
        "simulate",
        "--commands",
        text(&file),
        "--scene",
        text(&scene),
        "--out",
        text(&path),
    ];
    let simulated = succeed_json(&arguments);
    let object = &simulated["objects"][0];
    assert_eq!(object["name"], "a, \"b\"");
    let moved = object["position"][0].as_f64().unwrap() + 0.062;
    assert!(moved.abs() > 1e-3, "{object}");
    let rows = std::fs::read_to_string(&path).unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    assert!(rows[0].ends_with(",\"a, \"\"b\"\" x (m)\",\"a, \"\"b\"\" y (m)\",\"a, \"\"b\"\" z (m)\",\"a, \"\"b\"\" qw\",\"a, \"\"b\"\" qx\",\"a, \"\"b\"\" qy\",\"a, \"\"b\"\" qz\""), "{}", rows[0]);
    let last: Vec<f64> = rows[400].split(',').map(|x| x.parse().unwrap()).collect();
    assert_eq!(last.len(), 1 + 60 + 7);
    for axis in 0..3 {
        assert_eq!(last[61 + axis], object["position"][axis].as_f64().unwrap());
    }
    let table = succeed(&arguments);
    assert!(table.contains("object `a, \"b\"` at"), "{table}");
}

#[test]
fn objects_of_shapes_that_do_not_move_are_refused() {
    let (folder, file) = commands(PULL);
    let scene = folder.path().join("scene.toml");
    let tube = "[[obstacle]]\nname = 'tube'\npipe = { radius = 0.1, length = 0.2 }\nmass = 1.0\n";
    std::fs::write(&scene, tube).unwrap();
    let arguments = [
        "simulate",
        "--commands",
        text(&file),
        "--scene",
        text(&scene),
    ];
    refuse(&arguments, 1, "object `tube` is a pipe");
}

#[test]
fn loads_of_a_file_vary_from_command_to_command() {
    let (folder, file) = commands(&PULL.repeat(20));
    let loads = folder.path().join("loads.csv");
    let simulate = |table: &str, options: &[&str]| {
        std::fs::write(&loads, table).unwrap();
        let arguments = ["simulate", "--commands", text(&file)];
        let given = match table.is_empty() {
            true => vec![],
            false => vec!["--loads-file", text(&loads)],
        };
        succeed_json(&[&arguments[..], &given, options].concat())["positions"].clone()
    };
    // The same all along is what --wrench is, beside which it acts.
    let wrench = simulate("", &["--wrench", "tip:0.1,0,0.2,0,0.01,0"]);
    let header = "# of a gripper\nfxtip (N), fz9 (N), my9 (N m), note\n";
    let rows = "0.1,0.2,0.01,held\n".repeat(20);
    assert_eq!(simulate(&format!("{header}{rows}"), &[]), wrench);
    let halves = "fx9,fz9,my9,time (s)\n0.05,0.1,0.005,0\n0.05,0.1,0.005,1\n";
    assert_eq!(
        simulate(halves, &["--wrench", "9:0.05,0,0.1,0,0.005,0"]),
        wrench
    );
    // Linear in time: a step of 2 ms ends at 2 ms, the last at 40 ms.
    let ramp: String = (1..=20)
        .map(|k| format!("{}\n", 0.01 * f64::from(k)))
        .collect();
    let stepwise = simulate(&format!("fx4 (N)\n{ramp}"), &[]);
    let linear = simulate("t,fx4\n0,0\n0.04,0.2\n", &[]);
    for (one, other) in stepwise
        .as_array()
        .unwrap()
        .iter()
        .zip(linear.as_array().unwrap())
    {
        for axis in 0..3 {
            let off = one[axis].as_f64().unwrap() - other[axis].as_f64().unwrap();
            assert!(off.abs() < 1e-12, "{stepwise} {linear}");
        }
    }

    for (table, expected) in [
        ("", "is empty; expected columns fx9"),
        (
            "a,b\n1,2\n",
            "line 1: the columns are a, b; expected columns fx9",
        ),
        (
            "fx10\n1\n",
            "line 1: the column `fx10` is of no disc: the robot has discs 0 to 9",
        ),
        (
            "fx9,fxtip\n1,1\n",
            "line 1: the column `fxtip` is there twice",
        ),
        ("fx9\n", "has no loads below the names"),
        ("fx9,fy9\n1\n", "line 2: 1 entries, expected 2"),
        (
            "fx9,fy9 (N)\n\n1,nan\n",
            "line 3: column `fy9 (N)`: `nan` is no finite number",
        ),
        (
            "fx9\n1\n2\n",
            "has 2 rows of loads, and there are 20 commands; expected a row for each",
        ),
        (
            "t,fx9\n0,1\n0,2\n",
            "line 3: the time 0 s, after 0 s; expected times that ascend",
        ),
    ] {
        std::fs::write(&loads, table).unwrap();
        let arguments = [
            "simulate",
            "--commands",
            text(&file),
            "--loads-file",
            text(&loads),
        ];
        refuse(&arguments, 1, expected);
    }
}

/// What is touched is in the matrices, and what is out of reach is not.
#[test]
fn steps_are_linearised_with_what_the_robot_touches() {
    let (folder, file) = commands(&"0.034,0.007,0.001,0.026,0.015,0.019\n".repeat(150));
    let matrices = |name: &str, x: f64| {
        let scene = folder.path().join(format!("{name}.toml"));
        let wall = format!(
            "[[obstacle]]\nname = \"wall\"\nhalf_space = {{}}\nposition = [{x}, 0, 0]\norientation = [0.70710678, 0, 0.70710678, 0]\n"
        );
        std::fs::write(&scene, wall).unwrap();
        let out = folder.path().join(format!("{name}.json"));
        let scene = ["--scene", text(&scene)];
        let scene = if name == "free" { &[][..] } else { &scene[..] };
        let simulate = [
            "simulate",
            "--commands",
            text(&file),
            "--linearise",
            text(&out),
        ];
        succeed(&[&simulate[..], scene].concat());
        let read = std::fs::read_to_string(out).unwrap();
        serde_json::from_str::<serde_json::Value>(&read).unwrap()
    };
    let [free, far, near] = [("free", 0.0), ("far", -1.0), ("near", -0.03)].map(|(name, x)| {
        let rows = matrices(name, x)["a"].take();
        serde_json::from_value::<Vec<Vec<f64>>>(rows).unwrap()
    });
    assert!(free.len() == 60 && free.iter().all(|row| row.len() == 60));
    let apart = |one: &[Vec<f64>], other: &[Vec<f64>]| {
        let pairs = one.iter().flatten().zip(other.iter().flatten());
        pairs.fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()))
    };
    assert!(apart(&far, &free) < 1e-12, "{}", apart(&far, &free));
    assert!(apart(&near, &free) > 1e-3, "{}", apart(&near, &free));
}
