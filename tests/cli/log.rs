//! `tdcr log`.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tdcr::hw::clock::VirtualClock;
use tdcr::hw::log::{LogRecord, LogSettings, LogWriter};

use super::{refuse, succeed, succeed_json, text};

/// A log of 50 commands, one each 0.1 s, in about ten chunks.
fn log(folder: &Path) -> PathBuf {
    let path = folder.join("run.mcap");
    let settings = LogSettings {
        flush_after: Duration::from_millis(500),
        ..LogSettings::default()
    };
    let mut log = LogWriter::create(&path, &VirtualClock::new(), settings).unwrap();
    for step in 0..50 {
        let command = LogRecord::Command(vec![0.01, 0.001 * f64::from(step)]);
        log.write(
            Duration::from_millis(100 * u64::try_from(step).unwrap()),
            &command,
        )
        .unwrap();
    }
    log.finish().unwrap();
    path
}

#[test]
fn info_says_what_is_in_a_log() {
    let folder = tempfile::tempdir().unwrap();
    let path = log(folder.path());
    let info = succeed_json(&["log", "info", text(&path)]);
    assert_eq!(info["whole"], true);
    assert_eq!(info["messages"], 50);
    assert_eq!(info["stated"], 50);
    assert_eq!(
        (info["start"].as_f64(), info["end"].as_f64()),
        (Some(0.0), Some(4.9))
    );
    let topic = &info["topics"][0];
    assert_eq!(topic["topic"], "/command");
    assert_eq!(topic["schema"], "tdcr.Command");
    assert_eq!(topic["messages"], 50);
    assert!((topic["rate"].as_f64().unwrap() - 10.0).abs() < 1e-9);
    let said = succeed(&["log", "info", text(&path)]);
    assert!(said.contains("4.9 s, 50 messages, whole"), "{said}");
}

#[test]
fn a_log_that_was_cut_off_is_repaired() {
    let folder = tempfile::tempdir().unwrap();
    let path = log(folder.path());
    let bytes = fs::read(&path).unwrap();
    let cut = folder.path().join("cut.mcap");
    let half = bytes.len() / 2;
    fs::write(&cut, &bytes[..half]).unwrap();
    let info = succeed_json(&["log", "info", text(&cut)]);
    let messages = info["messages"].as_u64().unwrap();
    assert!((10..40).contains(&messages), "{messages}");
    assert_eq!(info["whole"], false);
    assert!(info["damage"][0]["at"].as_u64().unwrap() <= half as u64);
    let said = succeed(&["log", "info", text(&cut)]);
    assert!(said.contains("the file ends before its log does"), "{said}");

    let out = folder.path().join("whole.mcap");
    let repair = ["log", "repair", text(&cut), "--out", text(&out)];
    let repaired = succeed_json(&repair);
    assert_eq!(repaired["messages"], messages);
    let after = succeed_json(&["log", "info", text(&out)]);
    assert_eq!(after["whole"], true);
    assert_eq!(after["messages"], messages);
    assert_eq!(after["topics"], info["topics"]);

    refuse(&repair, 1, "is there already; --force replaces it");
    succeed(&[&repair[..], &["--force"]].concat());
}

#[test]
fn what_is_no_log_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    fs::write(&path, "not a log").unwrap();
    refuse(&["log", "info", text(&path)], 1, "is not a log");
    let out = folder.path().join("out.mcap");
    refuse(
        &["log", "repair", text(&path), "--out", text(&out)],
        1,
        "is not a log",
    );
    assert!(!out.exists());
    let bag = folder.path().join("bag");
    let as_bag = ["--format", "rosbag2", "--out", text(&bag)];
    let export = [&["log", "export", text(&path)], as_bag.as_slice()].concat();
    refuse(&export, 1, "is not a log");
    assert!(!bag.exists(), "so that the right log can go there");
    let missing = folder.path().join("missing.mcap");
    refuse(&["log", "info", text(&missing)], 1, "missing.mcap");
}

/// A log by the format's Python library with its defaults.
#[test]
fn a_log_with_zstd_chunks_is_repaired_with_all_its_messages() {
    let folder = tempfile::tempdir().unwrap();
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/hw/tests/data/events-zstd.mcap"
    );
    let out = folder.path().join("out.mcap");
    let repaired = succeed_json(&["log", "repair", path, "--out", text(&out)]);
    assert_eq!(
        (&repaired["whole"], &repaired["messages"]),
        (&true.into(), &14.into())
    );
    for file in [path, text(&out)] {
        let info = succeed_json(&["log", "info", file]);
        assert_eq!(
            (&info["whole"], &info["messages"]),
            (&true.into(), &14.into())
        );
    }
    // Another compression is refused by name, and nothing is written.
    let mut bytes = fs::read(path).unwrap();
    let names: Vec<usize> = (0..bytes.len() - 8)
        .filter(|&at| bytes[at..].starts_with(b"\x04\0\0\0zstd"))
        .collect();
    names
        .iter()
        .for_each(|at| bytes[at + 4..at + 8].copy_from_slice(b"xxxx"));
    let other = folder.path().join("other.mcap");
    fs::write(&other, bytes).unwrap();
    let unwritten = folder.path().join("unwritten.mcap");
    refuse(&["log", "info", text(&other)], 1, "compressed by `xxxx`");
    refuse(
        &["log", "repair", text(&other), "--out", text(&unwritten)],
        1,
        "compressed by `xxxx`",
    );
    refuse(
        &[
            "log",
            "pictures",
            text(&other),
            "--out",
            text(folder.path()),
        ],
        1,
        "compressed by `xxxx`",
    );
    let robot = ["calibrate", "--robot", "2m", "--data", text(&other)];
    refuse(&robot, 1, "compressed by `xxxx`");
    assert!(!unwritten.exists());
}
