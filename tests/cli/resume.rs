//! Interrupted work is resumed, and ends as if it had never stopped.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::LazyLock;
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::{SCORES, tdcr, text};

/// Kills of a collection, at moments spread over its run.
const KILLS: u32 = 8;

/// Runs of it that may come to their end instead, before the test gives up.
const ATTEMPTS: u32 = 10 * KILLS;

fn demo(out: &Path) -> Command {
    let mut command = tdcr(&[
        "demo",
        "--samples",
        "12",
        "--steps",
        "6",
        "--quiet",
        "--out",
        text(out),
    ]);
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// Folder of a demo that nothing interrupted, made once for all tests here, and how long it took.
fn whole_demo() -> &'static (PathBuf, Duration) {
    static WHOLE: LazyLock<(PathBuf, Duration)> = LazyLock::new(|| {
        let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("whole_demo");
        if out.exists() {
            fs::remove_dir_all(&out).unwrap();
        }
        let began = Instant::now();
        assert!(demo(&out).status().unwrap().success());
        (out, began.elapsed())
    });
    &WHOLE
}

/// Starts the demo and ends it by `signal` after `patience`, if it has not come to its end by then; whether it was ended.
fn end_demo(out: &Path, signal: &str, patience: Duration) -> bool {
    let mut child = demo(out).spawn().unwrap();
    sleep(patience);
    let id = child.id().to_string();
    let sent = Command::new("kill").args([signal, &id]).status();
    // One that came to its end is not waited for yet, so that it can still be sent a signal.
    assert!(sent.unwrap().success());
    let status = child.wait().unwrap();
    if signal == "-INT" {
        assert!(status.code() == Some(130) || status.success(), "{status}");
    }
    !status.success()
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
    let (whole, span) = whole_demo();
    let expected = results(whole);
    let ended = folder.path().join("ended");
    let moments = [
        ("-INT", 0.15),
        ("-KILL", 0.3),
        ("-INT", 0.5),
        ("-KILL", 0.7),
    ];
    let ends = moments.map(|(signal, share)| end_demo(&ended, signal, span.mul_f64(share)));
    assert!(ends[..2] == [true; 2], "{ends:?}");
    assert!(demo(&ended).status().unwrap().success());
    assert!(results(&ended) == expected, "after {ends:?}");
    for key in SCORES {
        assert!(expected.2[key].as_f64().unwrap() > 0.0, "{key}");
    }
    // A demo computes in one precision, whichever suits the machine.
    let precision = expected.2["precision"].as_str().unwrap();
    assert_eq!(expected.2["training_precision"], precision);
    let said = format!("{precision} in prediction, {precision} in training");
    let page = fs::read_to_string(whole.join("report.html")).unwrap();
    assert!(page.contains(&said));
}

#[test]
fn scores_in_a_journal_of_another_format_are_computed_anew() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    for (place, bytes) in set_files(&whole_demo().0) {
        let file = out.join(place);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, bytes).unwrap();
    }
    let expected = results(&out);
    let journal = out.join("evaluation.jsonl");
    let written = fs::read_to_string(&journal).unwrap();
    // What an older version left: the same fields, of another meaning.
    let entries: Vec<&str> = written.lines().skip(1).collect();
    let wrong = entries.join("\n").replace("\"cd\":", "\"cd\":9");
    let mut key: Value = serde_json::from_str(written.lines().next().unwrap()).unwrap();
    assert!(key.as_object_mut().unwrap().remove("format").is_some());
    fs::write(&journal, format!("{key}\n{wrong}\n")).unwrap();
    assert!(demo(&out).status().unwrap().success());
    assert!(results(&out) == expected);
}

fn collect(out: &Path, threads: &str) -> Command {
    let size = ["--samples", "24", "--points", "3000", "--payload", "0:0.03"];
    let how = ["--threads", threads, "--quiet", "--out", text(out)];
    let mut command = tdcr(&[&["collect", "--base"], &size[..], &how].concat());
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// Every file under a folder with its contents, the hidden ones too.
fn tree(dir: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(tree(&path));
        } else {
            found.push((path.clone(), fs::read(&path).unwrap()));
        }
    }
    found.sort();
    found
}

/// The files of a data set, by their place in it.
pub fn set_files(dir: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let inside = |(path, bytes): (PathBuf, Vec<u8>)| {
        let place = path.strip_prefix(dir).unwrap().to_owned();
        (place, bytes)
    };
    tree(dir).into_iter().map(inside).collect()
}

#[test]
fn a_collection_that_is_killed_at_any_moment_ends_as_one_that_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    let began = Instant::now();
    assert!(collect(&whole, "1").status().unwrap().success());
    let span = began.elapsed();
    let expected = set_files(&whole);
    assert_eq!(expected.len(), 6);
    // Each of several sets is killed again and again, until there were kills enough. Every attempt
    // has a moment of its own, so that a machine that grows faster still meets some before the end.
    let mut set = folder.path().join("killed0");
    let mut kills = 0;
    for attempt in 1..=ATTEMPTS {
        let mut child = collect(&set, ["1", "2"][attempt as usize % 2])
            .spawn()
            .unwrap();
        // The golden ratio's multiples spread the moments evenly over a run, from its start to past its end.
        let share = (f64::from(attempt) * 0.618_034).fract();
        sleep(span.mul_f64(1.1 * share));
        child.kill().unwrap();
        let finished = child.wait().unwrap().success();
        kills += u32::from(!finished);
        if !finished && kills == KILLS {
            assert!(collect(&set, "2").status().unwrap().success());
        }
        if finished || kills == KILLS {
            assert!(set_files(&set) == expected, "{set:?} after {kills} kills");
            set = folder.path().join(format!("killed{attempt}"));
        }
        if kills == KILLS {
            return;
        }
    }
    panic!("only {kills} of {ATTEMPTS} attempts were killed before their end");
}
