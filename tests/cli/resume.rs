//! Interrupted work is taken up, and ends as if it had never stopped.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use serde_json::Value;

use crate::{SCORES, tdcr, text};

fn demo(out: &Path) -> Command {
    let mut command = tdcr(&[
        "demo",
        "--samples",
        "40",
        "--steps",
        "60",
        "--quiet",
        "--out",
        text(out),
    ]);
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// Starts the demo again and again, and ends it by `signal` after ever longer times until it comes
/// through; returns how often it was ended.
fn demo_with_interruptions(out: &Path, signal: &str) -> u32 {
    for interruptions in 0..200 {
        let mut child = demo(out).spawn().unwrap();
        for _ in 0..2 * (interruptions + 1) {
            sleep(Duration::from_millis(150));
            if let Some(status) = child.try_wait().unwrap() {
                assert!(status.success(), "{status}");
                return interruptions;
            }
        }
        let id = child.id().to_string();
        assert!(
            Command::new("kill")
                .args([signal, &id])
                .status()
                .unwrap()
                .success()
        );
        let status = child.wait().unwrap();
        if signal == "-INT" {
            assert!(status.code() == Some(130) || status.success(), "{status}");
        }
    }
    panic!("the demo never came to its end");
}

/// What the demo leaves, but for the times that it took.
fn results(out: &Path) -> (Vec<u8>, Vec<u8>, Value) {
    let mut metrics: Value =
        serde_json::from_slice(&fs::read(out.join("metrics.json")).unwrap()).unwrap();
    let seconds = metrics["seconds"].take();
    assert!(seconds.as_f64().unwrap() > 0.0);
    metrics["stages"].take();
    assert!(fs::metadata(out.join("report.html")).unwrap().len() > 100_000);
    let read = |file: &str| fs::read(out.join(file)).unwrap();
    (
        read("data/train/shard-00000.h5"),
        read("run/model.safetensors"),
        metrics,
    )
}

#[test]
fn a_demo_that_is_interrupted_or_killed_ends_as_one_that_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, interrupted, killed] =
        ["whole", "interrupted", "killed"].map(|name| folder.path().join(name));
    assert!(demo(&whole).status().unwrap().success());
    let expected = results(&whole);
    for (out, signal) in [(&interrupted, "-INT"), (&killed, "-KILL")] {
        assert!(demo_with_interruptions(out, signal) > 0);
        assert!(results(out) == expected, "after {signal}");
    }
    for key in SCORES {
        assert!(expected.2[key].as_f64().unwrap() > 0.0, "{key}");
    }
}
