//! Captures of an owner's own commands.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::capture::small_rig;
use crate::{refuse, succeed, succeed_json, text};

/// The commands (m) that a dry run tells of.
fn planned(rig: &Path, more: &[&str]) -> Vec<Value> {
    let dry = ["capture", "--rig", text(rig), "--dry-run"];
    let told = succeed_json(&[&dry[..], more].concat());
    told["moves"].as_array().unwrap().clone()
}

/// A table of commands as `tdcr settle` writes it, with other columns beside.
fn table(moves: &[Value]) -> String {
    let rows = moves.iter().map(|told| {
        let values = told["command"].as_array().unwrap().iter();
        let values: Vec<String> = values.map(ToString::to_string).collect();
        format!("{},yes\n", values.join(","))
    });
    "c0 (m),c1 (m),c2 (m),c3 (m),c4 (m),c5 (m),mine\n".to_owned() + &rows.collect::<String>()
}

/// The samples of a journal, in their order.
fn journalled(out: &Path) -> Vec<Value> {
    let journal = fs::read_to_string(out.join("capture.jsonl")).unwrap();
    let entries = journal.lines().skip(1).map(|line| {
        let line: Value = serde_json::from_str(line).unwrap();
        line["entry"].clone()
    });
    entries.filter(|entry| entry["kind"] == "sample").collect()
}

/// Root mean square distance (m) of the centres of two commands' samples from their means, of two samples for each.
fn spread(samples: &[Value]) -> f64 {
    let centre =
        |k: usize| -> [f64; 3] { serde_json::from_value(samples[k]["centroid"].clone()).unwrap() };
    let apart = |a: usize, b: usize| {
        let parts = centre(a)
            .into_iter()
            .zip(centre(b))
            .map(|(a, b)| (a - b) * (a - b));
        parts.sum::<f64>()
    };
    // Each is half of their distance from the mean, and there is one degree of freedom less.
    ((apart(0, 2) + apart(1, 3)) / 2.0 / 2.0).sqrt()
}

#[test]
fn commands_of_a_file_are_captured_in_its_order_and_repeated() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let [file, out] = ["mine.csv", "data"].map(|name| folder.path().join(name));
    let mut drawn = planned(&rig, &["--commands", "2", "--seed", "3"]);
    drawn.reverse();
    fs::write(&file, table(&drawn)).unwrap();
    let mine = ["--commands-file", text(&file), "--repeat", "2"];
    let told = planned(&rig, &mine);
    assert_eq!(told.len(), 4);
    for (index, told) in told.iter().enumerate() {
        assert_eq!(told["ticks"], drawn[index % 2]["ticks"]);
    }
    let capture = ["capture", "--rig", text(&rig), "--out", text(&out)];
    let small = ["--points", "100", "--voxel", "0.004", "--no-log"];
    let said = succeed(&[&capture[..], &mine, &small].concat());
    assert!(said.contains("4 clouds on rig rig-sim"), "{said}");
    let samples = journalled(&out);
    for (index, sample) in samples.iter().enumerate() {
        assert_eq!(
            (&sample["index"], &sample["repeat"]),
            (&index.into(), &(index / 2).into())
        );
        assert_eq!(sample["ticks"], told[index]["ticks"]);
    }
    let spread = format!("centres of their clouds {:.2} mm", 1e3 * spread(&samples));
    assert!(said.contains(&spread), "{said} {spread}");
    // Repeats of a command are in one split, and nobody takes them for a mistake.
    let info = &succeed_json(&["data", "info", text(&out)])[0];
    assert_eq!((&info["train"], &info["test"]), (&2.into(), &2.into()));
    succeed(&["data", "check", text(&out)]);
    let meta: Value =
        serde_json::from_str(&fs::read_to_string(out.join("meta.json")).unwrap()).unwrap();
    let recording = &meta["origin"]["recorded"]["recording"];
    assert_eq!(recording["settings"]["given_commands"]["count"], 2);
    assert_eq!(recording["cycle"], 2);
    // More repeats add to it.
    let three = [&capture[..], &mine[..2], &["--repeat", "3"], &small].concat();
    let report = succeed_json(&three);
    assert_eq!(
        (&report["samples"], &report["captured"]),
        (&6.into(), &2.into())
    );
    // The same folder is not for other commands.
    drawn.reverse();
    fs::write(&file, table(&drawn)).unwrap();
    let other = [&capture[..], &mine, &small].concat();
    refuse(&other, 1, "given_commands.hash");
}

#[test]
fn a_command_of_a_file_that_the_rig_cannot_take_is_told_with_its_place() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let file = folder.path().join("mine.csv");
    let drawn = planned(&rig, &["--commands", "2"]);
    let with = |place: usize, value: &str| {
        let mut wrong = drawn.clone();
        wrong[1]["command"][place] = serde_json::from_str(value).unwrap();
        fs::write(&file, table(&wrong)).unwrap();
    };
    let out = folder.path().join("data");
    let capture = ["capture", "--rig", text(&rig), "--out", text(&out)];
    let mine = [&capture[..], &["--commands-file", text(&file)]].concat();
    // Beyond the robot's range, beyond a servo's limits, and where the simulator finds a tendon slack.
    with(2, "5.0");
    refuse(&mine, 1, "mine.csv line 3: command entry 3 is 5 m");
    let slack = drawn[1]["command"][4].as_f64().unwrap() + 2e-3;
    with(4, &slack.to_string());
    refuse(
        &mine,
        1,
        "mine.csv line 3: column c3: tendon 4 would have a tension",
    );
    fs::write(
        &file,
        table(&drawn)
            .replace("mine", "payload")
            .replace("yes", "0.02"),
    )
    .unwrap();
    refuse(&mine, 1, "mine.csv line 2: the column payload has 0.02 kg");
    refuse(
        &[&mine[..], &["--commands", "5"]].concat(),
        2,
        "cannot be used with",
    );
    let many = ["--commands", "10000000", "--repeat", "10000000"];
    refuse(&[&capture[..], &many].concat(), 1, "samples");
    assert!(!out.exists());
}
