//! `tdcr study`: sweeps, their parts, their resumption, their refusals.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;

use crate::{COMMAND, refuse, succeed, succeed_json, tdcr, text};

/// A study of 3 x 2 x 40 configurations, some of which no robot has.
const SMALL: &str = r#"
title = "Small"
seed = 3
want = ["tip", "deflection", "tension", "energy", "stability", "compliance", "manipulability", "force", "workspace"]
tension_limit = 20.0
[[vary]]
what = "payload"
range = [0.0, 0.03]
steps = 3
[[vary]]
what = "modules[1].pitch"
values = [0.017, -0.01]
[[vary]]
what = "command"
[[vary]]
what = "gain"
range = [400.0, 600.0]
[sample]
count = 40
"#;

pub(crate) fn write(folder: &Path, name: &str, text: &str) -> std::path::PathBuf {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path
}

/// The files of a study's folder that do not tell the time, by name.
pub(crate) fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for part in [folder.to_owned(), folder.join("figures")] {
        for entry in fs::read_dir(part).into_iter().flatten() {
            let entry = entry.unwrap();
            let name = entry.file_name().into_string().unwrap();
            if entry.file_type().unwrap().is_file() && name != "study.json" && name != ".lock" {
                found.insert(name, fs::read(entry.path()).unwrap());
            }
        }
    }
    found
}

/// The cells of a table, by the names in its first line without units. No cell that is looked at here holds a comma.
pub(crate) fn table(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let names: Vec<&str> = lines
        .next()
        .unwrap()
        .split(',')
        .map(|title| title.split(" (").next().unwrap())
        .collect();
    let row = |line: &str| {
        let cells = line.split(',').map(ToOwned::to_owned);
        names.iter().map(ToString::to_string).zip(cells).collect()
    };
    lines.map(row).collect()
}

pub(crate) fn number(row: &BTreeMap<String, String>, name: &str) -> f64 {
    row[name].parse().unwrap()
}

/// The small study without the pitch that no robot has.
fn possible() -> String {
    SMALL.replace("[0.017, -0.01]", "[0.017, 0.015]")
}

#[test]
fn a_study_is_the_same_for_any_number_of_threads_and_parts() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(folder.path(), "small.toml", &possible());
    let run = |out: &Path, options: &[&str]| {
        succeed_json(&[&["study", text(&file), "--out", text(out)], options].concat())
    };
    let whole = folder.path().join("whole");
    let finished = run(&whole, &["--threads", "1"]);
    assert_eq!(
        (&finished["rows"], &finished["settled"]),
        (&240.into(), &240.into())
    );
    let expected = files(&whole);
    for name in ["table.csv", "table.parquet", "summary.csv", "report.html"] {
        assert!(
            expected.contains_key(name),
            "{name} of {:?}",
            expected.keys()
        );
    }
    let threads = folder.path().join("threads");
    run(&threads, &["--threads", "3"]);
    assert!(files(&threads) == expected);
    for of in [1, 2, 5] {
        let mut parts = Vec::new();
        for number in 1..=of {
            let out = folder.path().join(format!("part-{number}-of-{of}"));
            run(&out, &["--part", &format!("{number}/{of}")]);
            parts.push(out);
        }
        parts.reverse();
        let merged = folder.path().join(format!("merged-{of}"));
        let parts: Vec<&str> = parts.iter().map(|part| text(part)).collect();
        let merge = [&["study", "merge"], &parts[..], &["--out", text(&merged)]].concat();
        succeed(&merge);
        assert!(files(&merged) == expected, "{of} parts");
        if of == 5 {
            let without = [&["study", "merge"], &parts[1..], &["--out", text(&merged)]].concat();
            refuse(&without, 1, "expected all parts of one study, each once");
            let twice = [&merge[..3], &merge[2..]].concat();
            refuse(&twice, 1, "expected all parts of one study, each once");
        }
    }
    refuse(
        &["study", "merge", text(&whole), "--out", "x"],
        1,
        "it holds a whole study",
    );
}

#[test]
fn a_killed_study_goes_on_and_comes_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(
        folder.path(),
        "small.toml",
        &possible().replace("count = 40", "count = 1500"),
    );
    let whole = folder.path().join("whole");
    succeed(&["study", text(&file), "--out", text(&whole)]);
    let killed = folder.path().join("killed");
    let arguments = ["study", text(&file), "--out", text(&killed)];
    let mut child = tdcr(&arguments).stderr(Stdio::null()).spawn().unwrap();
    let rows = killed.join("table.csv.unfinished");
    while !fs::metadata(&rows).is_ok_and(|found| found.len() > 100_000) {
        assert!(
            child.try_wait().unwrap().is_none(),
            "it must not be done yet"
        );
        sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!killed.join("table.csv").exists());
    // As if the last line had been cut, too.
    let written = fs::read(&rows).unwrap();
    fs::write(&rows, &written[..written.len() - 7]).unwrap();
    let other = write(folder.path(), "other.toml", &possible());
    refuse(
        &["study", text(&other), "--out", text(&killed)],
        1,
        "holds another study",
    );
    succeed(&arguments);
    assert!(files(&killed) == files(&whole));
    // Finished, the same command draws the report again and computes nothing.
    fs::remove_file(killed.join("report.html")).unwrap();
    succeed(&arguments);
    assert!(files(&killed) == files(&whole));
    refuse(
        &["study", text(&other), "--out", text(&killed)],
        1,
        "holds another study",
    );
}

#[test]
fn rows_are_what_settle_says_of_the_same_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let study = format!(
        "want = [\"tip\", \"deflection\", \"tension\", \"stability\"]\n[set]\ncommand = [{COMMAND}]\n\"force[tip].x\" = 0.01\n\
         [[vary]]\nwhat = \"payload\"\nvalues = [0.0, 0.02]\n"
    );
    let file = write(folder.path(), "study.toml", &study);
    let out = folder.path().join("out");
    succeed(&["study", text(&file), "--out", text(&out)]);
    let settled = |payload: &str, force: &str| {
        succeed_json(&[
            "settle",
            "--command",
            COMMAND,
            "--payload",
            payload,
            "--wrench",
            force,
        ])
    };
    let bare = settled("0", "tip:0,0,0");
    let place = |settled: &serde_json::Value| -> Vec<f64> {
        serde_json::from_value(settled["positions"][9].clone()).unwrap()
    };
    for (row, payload) in table(&out.join("table.csv")).iter().zip(["0", "0.02"]) {
        let expected = settled(payload, "tip:0.01,0,0");
        let (tip, start) = (place(&expected), place(&bare));
        for (axis, name) in ["tip_x", "tip_y", "tip_z"].into_iter().enumerate() {
            assert_eq!(number(row, name), tip[axis]);
        }
        let moved: Vec<f64> = tip.iter().zip(&start).map(|(a, b)| a - b).collect();
        let distance = moved.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!((number(row, "deflection") - distance).abs() < 1e-12);
        assert!((number(row, "sag") + moved[2]).abs() < 1e-12);
        let tensions: Vec<f64> =
            serde_json::from_value(expected["tendon_tensions"].clone()).unwrap();
        assert_eq!(
            number(row, "tension_max"),
            tensions.iter().copied().fold(0.0, f64::max)
        );
        assert_eq!(
            number(row, "smallest_stiffness"),
            expected["smallest_stiffness"].as_f64().unwrap()
        );
    }
}

#[test]
fn a_row_that_is_no_robot_says_so_and_the_others_are_there() {
    let folder = tempfile::tempdir().unwrap();
    // Each pitch alone is fine, the last with 1000 discs is none.
    let study = "want = [\"tip\"]\n[[vary]]\nwhat = \"modules\"\nvalues = [1, 2]\n[[vary]]\nwhat = \"command[0]\"\n\
                 values = [0.02, 0.01]\n[[vary]]\nwhat = \"discs\"\nvalues = [5, 600]\n";
    let file = write(folder.path(), "study.toml", study);
    let out = folder.path().join("out");
    let finished = succeed_json(&["study", text(&file), "--out", text(&out)]);
    assert_eq!(finished["rows"], 8);
    let text = fs::read_to_string(out.join("table.csv")).unwrap();
    let refused: Vec<&str> = text
        .lines()
        .filter(|line| line.contains("robot field"))
        .collect();
    assert_eq!(refused.len(), 2, "{text}");
    assert!(
        refused
            .iter()
            .all(|line| line.contains("1000") && line.contains(",2,")),
        "{refused:?}"
    );
}

#[test]
fn the_parquet_file_holds_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(folder.path(), "small.toml", &possible());
    let out = folder.path().join("out");
    succeed(&["study", text(&file), "--out", text(&out)]);
    let rows = table(&out.join("table.csv"));
    let reader =
        SerializedFileReader::new(fs::File::open(out.join("table.parquet")).unwrap()).unwrap();
    assert_eq!(
        reader.metadata().file_metadata().num_rows(),
        rows.len() as i64
    );
    for (read, row) in reader.get_row_iter(None).unwrap().zip(&rows) {
        for (title, field) in read.unwrap().get_column_iter() {
            let cell = &row[title.split(" (").next().unwrap()];
            match field {
                Field::Double(value) => assert_eq!(*value, cell.parse::<f64>().unwrap()),
                Field::Long(value) => assert_eq!(value.to_string(), *cell),
                Field::Str(value) => assert_eq!(value, cell),
                Field::Null => assert!(cell.is_empty()),
                other => panic!("{other:?}"),
            }
        }
    }
}

#[test]
fn outputs_keep_what_the_field_says_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(folder.path(), "small.toml", &possible());
    let out = folder.path().join("out");
    succeed(&["study", text(&file), "--out", text(&out)]);
    for row in table(&out.join("table.csv")) {
        let of = |name: &str| number(&row, name);
        assert!(of("tension_min") <= of("tension_max"));
        assert!((of("tension_margin") - (20.0 - of("tension_max"))).abs() < 1e-12);
        assert!(
            (of("anisotropy") - of("compliance_max") / of("compliance_min")).abs()
                < 1e-9 * of("anisotropy")
        );
        let product = of("motion_min") * of("motion_mid") * of("motion_max");
        assert!((of("manipulability") - product).abs() <= 1e-12 * product);
        assert!(of("force_min") <= of("force_mid") && of("force_mid") <= of("force_max"));
        if of("payload") == 0.0 {
            assert_eq!((of("deflection"), of("sag")), (0.0, 0.0));
        } else {
            assert!(of("deflection") > 0.0 && of("sag").abs() <= of("deflection"));
        }
        assert!((400.0..=600.0).contains(&of("gain")));
    }
    for row in table(&out.join("summary.csv")) {
        assert_eq!(
            (number(&row, "rows"), number(&row, "settled")),
            (40.0, 40.0)
        );
        assert!(number(&row, "sag_p10") <= number(&row, "sag_median"));
        assert!(number(&row, "volume") > 0.0 && number(&row, "reach") < 0.2);
    }
}

#[test]
fn every_starter_runs_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["payload", "modules", "stiffness", "workspace", "friction"] {
        let starter = succeed(&["study", "--new", name]);
        let file = write(folder.path(), &format!("{name}.toml"), &starter);
        let out = folder.path().join(name);
        let finished = succeed_json(&["study", text(&file), "--out", text(&out)]);
        let (rows, settled) = (
            finished["rows"].as_u64().unwrap(),
            finished["settled"].as_u64().unwrap(),
        );
        assert!(
            rows > 10 && settled * 100 >= rows * 95,
            "{name}: {settled} of {rows}"
        );
        let page = fs::read_to_string(out.join("report.html")).unwrap();
        assert!(page.contains("<svg"), "{name}");
        assert!(
            files(&out).keys().any(|file| file.ends_with(".svg")),
            "{name}"
        );
    }
    let rows = table(&folder.path().join("friction/table.csv"));
    let loops: Vec<(f64, f64)> = rows
        .iter()
        .map(|row| (number(row, "friction"), number(row, "loop_width")))
        .collect();
    assert!(
        loops
            .iter()
            .all(|(mu, width)| (*mu == 0.0) == (*width < 1e-9)),
        "{loops:?}"
    );
}

#[test]
fn what_is_wrong_with_a_study_is_named_with_its_key() {
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        ("", "missing field `want`"),
        (
            "want = []",
            "`want` is empty; expected some of tip, deflection",
        ),
        (
            "want = [\"tips\"]",
            "`want[0]` is \"tips\"; expected one of tip, deflection",
        ),
        (
            "want = [\"workspace\"]",
            "`want[0]` is \"workspace\"; expected an output of single configurations",
        ),
        ("wants = [\"tip\"]", "unknown field `wants`"),
        (
            "robot = \"4m\"\nwant = [\"tip\"]",
            "`robot`: unknown robot `4m`",
        ),
        (
            "want = [\"tip\"]\n[[vary]]\nwhat = \"stifness\"\nvalues = [1]",
            "`vary[0].what` is \"stifness\"; expected one of robot, scene, modules, discs, stiffness",
        ),
        (
            "want = [\"tip\"]\n[[vary]]\nwhat = \"payload\"",
            "`vary[0]` is neither; expected either `values = [...]`",
        ),
        (
            "want = [\"tip\"]\n[[vary]]\nwhat = \"payload\"\nrange = [0.03, 0.0]\nsteps = 3",
            "`vary[0].range` is [0.03, 0]; expected [LOW, HIGH], finite, LOW below HIGH",
        ),
        (
            "want = [\"tip\"]\n[[vary]]\nwhat = \"modules\"\nrange = [1, 4]\nsteps = 3",
            "`vary[0].steps` is 3; expected as many as make all values of `modules` whole",
        ),
        (
            "want = [\"tip\"]\n[[vary]]\nwhat = \"command\"",
            "`sample` is missing; expected a table with `count`",
        ),
        (
            "want = [\"tip\"]\n[[vary]]\nwhat = \"command\"\n[sample]\ncount = 5\ndesign = \"grid\"",
            "`sample.design` is \"grid\"; expected sobol, latin-hypercube or uniform",
        ),
        (
            "want = [\"tip\"]\n[[vary]]\nwhat = \"payload\"\nvalues = [0.01, -1]",
            "`vary[0] (payload)` is -1, and no robot comes of it: the payload is -1 kg",
        ),
        (
            "want = [\"tip\"]\n[[vary]]\nwhat = \"command[7]\"\nvalues = [0.01]",
            "`vary[0] (command[7])` is 0.01, and no robot comes of it: command[7]: the robot has 6 tendons",
        ),
        (
            "want = [\"tip\"]\n[set]\n\"modules[5].radius\" = 1",
            "the list has 2",
        ),
    ];
    for (study, expected) in cases {
        let file = write(folder.path(), "bad.toml", study);
        let out = folder.path().join("out");
        refuse(&["study", text(&file), "--out", text(&out)], 1, expected);
        refuse(&["study", text(&file), "--out", text(&out)], 1, "bad.toml");
        assert!(!out.exists());
    }
    refuse(&["study"], 2, "FILE");
    refuse(
        &["study", "--new", "lunch"],
        2,
        "payload, modules, stiffness, workspace, friction",
    );
    refuse(
        &["study", "absent.toml"],
        1,
        "cannot read study absent.toml",
    );
    let file = write(folder.path(), "good.toml", "want = [\"tip\"]");
    refuse(&["study", text(&file), "--part", "3/2"], 2, "3/2");
    let foreign = folder.path().join("foreign");
    fs::create_dir(&foreign).unwrap();
    write(&foreign, "table.csv", "mine");
    refuse(
        &["study", text(&file), "--out", text(&foreign)],
        1,
        "holds another study",
    );
    assert_eq!(
        fs::read_to_string(foreign.join("table.csv")).unwrap(),
        "mine"
    );
}

#[test]
fn figures_hold_the_medians_of_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(folder.path(), "small.toml", &possible());
    let out = folder.path().join("out");
    succeed(&["study", text(&file), "--out", text(&out)]);
    let svg = fs::read_to_string(out.join("figures/deflection-over-payload.svg")).unwrap();
    // Two plots (deflection, sag), a line for each pitch, a dot for each payload.
    let heights: Vec<f64> = svg
        .split("<circle ")
        .skip(1)
        .map(|dot| {
            dot.split("cy=\"")
                .nth(1)
                .unwrap()
                .split('"')
                .next()
                .unwrap()
                .parse()
                .unwrap()
        })
        .collect();
    assert_eq!(heights.len(), 2 * 2 * 3);
    let summary = table(&out.join("summary.csv"));
    for (plot, column) in ["deflection_median", "sag_median"].into_iter().enumerate() {
        let value = |payload: usize, pitch: usize| number(&summary[2 * payload + pitch], column);
        let height = |payload: usize, pitch: usize| heights[6 * plot + 3 * pitch + payload];
        // On a linear axis, heights are in proportion to values.
        let scale = (height(0, 0) - height(2, 0)) / (value(2, 0) - value(0, 0));
        for (payload, pitch) in [(1, 0), (0, 1), (1, 1), (2, 1)] {
            let expected = scale * (value(payload, pitch) - value(0, 0));
            let drawn = height(0, 0) - height(payload, pitch);
            assert!(
                (drawn - expected).abs() < 0.3,
                "{column} {payload} {pitch}: {drawn} {expected}"
            );
        }
    }
    assert!(
        svg.contains("10 % to the 90 % quantile over 40 configurations")
            && svg.contains("payload (g)")
    );
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains(svg.trim_end()), "the page holds the figure");
}
