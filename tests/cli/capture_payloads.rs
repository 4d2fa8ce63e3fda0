//! Captures under payloads.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use serde_json::Value;

use crate::capture::small_rig;
use crate::release::{ended, listen, says_on, send, wait_for};
use crate::servo_sim::{LATE, Server, rig_on};
use crate::{TINY_NETWORK, refuse, stderr, succeed, succeed_json, tdcr, text};

/// The entries of a kind in a journal, in their order.
fn journalled(out: &Path, kind: &str) -> Vec<Value> {
    let journal = fs::read_to_string(out.join("capture.jsonl")).unwrap();
    let entries = journal.lines().skip(1).map(|line| {
        let line: Value = serde_json::from_str(line).unwrap();
        line["entry"].clone()
    });
    entries.filter(|entry| entry["kind"] == kind).collect()
}

#[test]
fn commands_are_captured_under_one_payload_after_another() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let [out, run] = ["data", "run"].map(|name| folder.path().join(name));
    let capture = ["capture", "--rig", text(&rig), "--out", text(&out)];
    let small = ["--points", "100", "--voxel", "0.004", "--no-log"];
    let loads = ["--commands", "3", "--payloads", "0,0.3"];
    let dry = succeed_json(&[&capture[..], &loads, &["--dry-run"]].concat());
    let told: Vec<f64> = (dry["moves"].as_array().unwrap().iter())
        .map(|told| told["payload"].as_f64().unwrap())
        .collect();
    assert_eq!(told, [0.0, 0.0, 0.0, 0.3, 0.3, 0.3]);
    let captured = succeed_json(&[&capture[..], &loads, &small].concat());
    assert_eq!(captured["samples"], 6);
    // Looks at home are beside the first one under the same payload.
    assert!(captured["drift"].as_f64().unwrap() < 2e-3, "{captured}");
    let samples = journalled(&out, "sample");
    let aside = |sample: &Value| {
        let [x, y] = [0, 1].map(|axis| sample["centroid"][axis].as_f64().unwrap());
        x.hypot(y)
    };
    let mut farther = 0.0;
    for (free, loaded) in samples[..3].iter().zip(&samples[3..]) {
        assert_eq!(free["payload"], 0.0);
        assert_eq!(loaded["payload"], 0.3);
        assert_eq!(free["ticks"], loaded["ticks"]);
        assert_eq!(loaded["repeat"], 0);
        farther += aside(loaded) - aside(free);
    }
    // What hangs there pulls a bent robot farther aside.
    assert!(farther > 5e-3, "{farther} m");
    let looks = journalled(&out, "sentinel");
    let first = |mass: f64| looks.iter().find(|look| look["payload"] == mass).unwrap();
    assert_eq!(first(0.0)["drift"], 0.0);
    assert_eq!(first(0.3)["drift"], 0.0);
    // All samples of a command are in one split, and payloads are part of what a network is told.
    let info = &succeed_json(&["data", "info", text(&out)])[0];
    assert_eq!((&info["train"], &info["test"]), (&2.into(), &2.into()));
    let places = ["--data", text(&out), "--out", text(&run)];
    succeed(&[&TINY_NETWORK[..], &places].concat());
    let predict = ["predict", "--model", text(&run.join("model.safetensors"))].map(str::to_owned);
    let command: Vec<String> = (samples[0]["command"].as_array().unwrap().iter())
        .map(ToString::to_string)
        .collect();
    let predict = [&predict[..], &["--command".to_owned(), command.join(",")]].concat();
    let predict: Vec<&str> = predict.iter().map(String::as_str).collect();
    refuse(&predict, 1, "trained with payloads of 0.3:0.3 kg");
    let cloud = folder.path().join("cloud.ply");
    let loaded = ["--payload", "0.3", "--out", text(&cloud)];
    succeed(&[&predict[..], &loaded].concat());
    // A set of several payloads does not grow: its samples would change their places.
    let more = ["--commands", "3", "--payloads", "0,0.3", "--repeat", "2"];
    refuse(
        &[&capture[..], &more, &small].concat(),
        1,
        "samples_of_payload",
    );
}

#[test]
fn payloads_that_make_no_sense_are_refused_and_one_that_nobody_hangs() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let out = folder.path().join("data");
    let capture = [
        "capture",
        "--rig",
        text(&rig),
        "--out",
        text(&out),
        "--commands",
        "2",
    ];
    for (payloads, reason) in [
        ("--payloads=-0.1", "the payload is -0.1 kg"),
        ("--payloads=0,nan", "the payload is NaN kg"),
        ("--payloads=0.1,0.2,0.1", "payloads are 0.1 kg twice"),
        ("--payloads=0", "payloads are 0 kg alone"),
    ] {
        refuse(&[&capture[..], &[payloads]].concat(), 1, reason);
        refuse(
            &[&capture[..], &[payloads, "--dry-run"]].concat(),
            1,
            reason,
        );
    }
    assert!(!out.exists());
    // A command of one's own that only the payload makes too much.
    let dry = succeed_json(&[&capture[..], &["--dry-run"]].concat());
    let file = folder.path().join("mine.csv");
    let values = dry["moves"][0]["command"].as_array().unwrap().iter();
    let values: Vec<String> = values.map(ToString::to_string).collect();
    fs::write(&file, values.join(",") + "\n").unwrap();
    let mine = ["capture", "--rig", text(&rig), "--out", text(&out)];
    let mine = [
        &mine[..],
        &["--commands-file", text(&file), "--payloads", "0,50"],
    ]
    .concat();
    refuse(&mine, 1, "under 50 kg: tendon");
    // More than its tendons could hold.
    let heavy = [&capture[..], &["--payloads", "0,100", "--dry-run"]].concat();
    let heavy = tdcr(&heavy).output().unwrap();
    let said = stderr(&heavy);
    assert!(
        !heavy.status.success() && said.contains("none of 1000 draws"),
        "{said}"
    );
    // Again where a busy machine ran the server later than the driver waits.
    for _ in 0..10 {
        let server = Server::of(
            concat!(env!("CARGO_MANIFEST_DIR"), "/examples/paper-robot.toml"),
            &[],
        );
        let desk = rig_on(&server, folder.path());
        let asked = tdcr(&[
            "capture",
            "--rig",
            text(&desk),
            "--out",
            text(&out),
            "--payloads",
            "0.02",
        ])
        .stdin(Stdio::null())
        .output()
        .unwrap();
        let said = stderr(&asked);
        if LATE.iter().any(|late| said.contains(late)) {
            continue;
        }
        assert!(
            said.contains("Hang 0.02 kg at the tip, then press Enter"),
            "{said}"
        );
        assert!(
            said.contains("nobody says that 0.02 kg hang at the tip"),
            "{said}"
        );
        assert_eq!(asked.status.code(), Some(1));
        return;
    }
    panic!("servos on a port are never heard in time");
}

/// What is asked for a payload ends in.
const ASKED: &str = "then press Enter";

#[test]
fn an_enter_from_before_the_question_is_no_answer_and_neither_is_ctrl_c() {
    // Again where a busy machine ran the server later than the driver waits.
    for _ in 0..10 {
        let server = Server::of(
            concat!(env!("CARGO_MANIFEST_DIR"), "/examples/paper-robot.toml"),
            &[],
        );
        let folder = tempfile::tempdir().unwrap();
        let rig = rig_on(&server, folder.path());
        let homed = tdcr(&["home", "--rig", text(&rig), "--here", "--no-log", "--quiet"]);
        if !{ homed }.output().unwrap().status.success() {
            continue;
        }
        let out = folder.path().join("out");
        let capture = [
            "capture",
            "--rig",
            text(&rig),
            "--out",
            text(&out),
            "--payloads",
            "0.02",
        ];

        let mut child = tdcr(&capture)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let said = listen(child.stderr.take().unwrap());
        let asks = || said.lock().unwrap().contains(ASKED).then_some(());
        if wait_for(&mut child, asks).is_some() {
            send("-INT", child.id());
        }
        let status = ended(&mut child);
        let told = said.lock().unwrap().clone();
        if LATE.iter().any(|late| told.contains(late)) {
            continue;
        }
        assert_eq!(status, Some(130), "{told}");
        assert!(!told.contains("nobody says"), "{told}");

        let words = format!(
            "sleep 0.5; {} {}",
            env!("CARGO_BIN_EXE_tdcr"),
            capture.join(" ")
        );
        let mut terminal = Command::new("script")
            .args(["-qec", &words, "/dev/null"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut keyboard = terminal.stdin.take().unwrap();
        keyboard.write_all(b"\n").unwrap();
        let said = listen(terminal.stdout.take().unwrap());
        let asks = || said.lock().unwrap().contains(ASKED).then_some(());
        let log = out.join("log-2.mcap");
        if wait_for(&mut terminal, asks).is_some() {
            // What an answer takes to switch the motors on.
            sleep(Duration::from_secs(2));
            assert!(!says_on(&log), "{}", said.lock().unwrap());
            keyboard.write_all(b"\n").unwrap();
            let on = wait_for(&mut terminal, || says_on(&log).then_some(()));
            keyboard.write_all(b"\x03").unwrap();
            ended(&mut terminal);
            let told = said.lock().unwrap().clone();
            if LATE.iter().any(|late| told.contains(late)) {
                continue;
            }
            assert!(on.is_some(), "{told}");
            return;
        }
        let told = said.lock().unwrap().clone();
        assert!(LATE.iter().any(|late| told.contains(late)), "{told}");
    }
    panic!("servos on a port are never heard in time");
}
