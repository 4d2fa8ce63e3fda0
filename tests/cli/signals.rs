//! Signals, and logs that nobody can read: what they do to the work.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::{COMMAND, SMALL_SET, collect_small, stderr, succeed, tdcr, text, train_tiny};

/// Runs with a stderr that nobody reads any more.
fn unread(arguments: &[&str]) -> Output {
    let mut child = tdcr(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stderr.take());
    child.wait_with_output().unwrap()
}

/// Runs with a stderr on a full disk.
fn onto_a_full_disk(arguments: &[&str]) -> Output {
    let full = File::options().write(true).open("/dev/full").unwrap();
    tdcr(arguments).stderr(full).output().unwrap()
}

#[test]
fn logs_that_cannot_be_written_cost_the_work_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for (name, run) in [
        ("unread", unread as fn(&[&str]) -> Output),
        ("full", onto_a_full_disk),
    ] {
        let data = folder.path().join(name);
        let collected = run(&[&SMALL_SET[..], &["--out", text(&data)]].concat());
        assert!(collected.status.success(), "{name}: {}", collected.status);
        assert!(data.join("meta.json").exists());
        let refused = run(&["settle", "--robot", "4m", "--command", COMMAND]);
        assert_eq!(refused.status.code(), Some(1), "{name}: no panic");
    }
}

#[test]
fn a_fresh_start_is_not_said_to_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let collect = [&SMALL_SET[..], &["--out", text(&data)]].concat();
    let said = stderr(&tdcr(&collect).output().unwrap());
    assert!(said.contains("collect: 20 steps"), "{said}");
    assert!(!said.contains("going on"), "{said}");
}

fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    let sent = Command::new("kill").args([name, &id]).status().unwrap();
    assert!(sent.success());
}

/// Waits until the child ends, and kills it if that is not soon.
fn ends_soon(child: &mut Child) -> std::process::ExitStatus {
    let began = Instant::now();
    while began.elapsed() < Duration::from_secs(20) {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    panic!("the signal was not heard");
}

/// What outlives a terminal that is closed.
#[test]
fn a_command_under_nohup_goes_on_after_a_hangup_and_ends_when_told() {
    let mut child = Command::new("nohup")
        .args([env!("CARGO_BIN_EXE_tdcr"), "servo-sim"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut port = String::new();
    BufReader::new(child.stdout.take().unwrap())
        .read_line(&mut port)
        .unwrap();
    assert!(port.starts_with("/dev/"), "{port}");
    signal(&child, "-HUP");
    sleep(Duration::from_millis(500));
    assert_eq!(child.try_wait().unwrap(), None, "it ended");
    signal(&child, "-TERM");
    ends_soon(&mut child);
}

/// A prediction that would take hours.
fn endless_prediction(folder: &Path) -> Child {
    let (data, run) = (folder.join("data"), folder.join("run"));
    collect_small(&data, &[]);
    let trained = train_tiny(&data, &run, &[]);
    let cloud = folder.join("cloud.ply");
    let model = trained["model"].as_str().unwrap();
    let what = ["predict", "--model", model, "--command", COMMAND];
    let how = ["--points", "2000", "--prior-samples", "10000000"];
    tdcr(&[&what[..], &how, &["--out", text(&cloud)]].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

#[test]
fn work_without_a_safe_point_ends_at_the_first_signal() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = endless_prediction(folder.path());
    sleep(Duration::from_millis(1500));
    signal(&child, "-TERM");
    assert_eq!(ends_soon(&mut child).code(), Some(130));
    assert!(!folder.path().join("cloud.ply").exists());
}

#[test]
fn work_with_safe_points_stops_at_one_and_tells_what_it_has() {
    let mut child = tdcr(&["settle", "--random", "1000000000"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut log = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    log.read_line(&mut line).unwrap();
    assert!(line.contains("settle: 1000000000 steps"), "{line}");
    sleep(Duration::from_millis(1500));
    signal(&child, "-TERM");
    assert_eq!(ends_soon(&mut child).code(), Some(130));
    let (mut said, mut result) = (String::new(), String::new());
    log.read_to_string(&mut said).unwrap();
    let mut stdout = child.stdout.take().unwrap();
    stdout.read_to_string(&mut result).unwrap();
    assert!(said.contains("stopping at the next safe point"), "{said}");
    assert!(said.ends_with("error: interrupted\n"), "{said}");
    assert!(result.contains("settled, largest residual"), "{result}");
}

#[test]
fn one_of_a_thing_is_no_plural() {
    let survey = succeed(&["settle", "--random", "1"]);
    assert!(survey.starts_with("1 command, "), "{survey}");
}

/// What the system says of a process: running, sleeping, stopped.
fn state(child: &Child) -> char {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap();
    let (_, behind) = stat.rsplit_once(") ").unwrap();
    behind.chars().next().unwrap()
}

fn becomes(child: &Child, what: impl Fn(char) -> bool) {
    let began = Instant::now();
    while !what(state(child)) {
        assert!(
            began.elapsed() < Duration::from_secs(20),
            "{}",
            state(child)
        );
        sleep(Duration::from_millis(20));
    }
}

#[test]
fn work_that_holds_no_motor_is_stopped_and_goes_on_as_any_program_is() {
    let mut child = tdcr(&["settle", "--random", "1000000000"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut log = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    log.read_line(&mut line).unwrap();
    for _ in 0..2 {
        signal(&child, "-TSTP");
        becomes(&child, |state| state == 'T');
        signal(&child, "-CONT");
        becomes(&child, |state| state != 'T');
    }
    signal(&child, "-QUIT");
    assert_eq!(ends_soon(&mut child).code(), Some(130));
}

#[test]
fn a_background_that_is_ended_at_once_leaves_no_part_of_itself() {
    let folder = tempfile::tempdir().unwrap();
    let [rig, robot, log] =
        ["rig.toml", "paper-robot.toml", "empty.mcap"].map(|name| folder.path().join(name));
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    std::fs::copy(examples.join("rig-sim.toml"), &rig).unwrap();
    std::fs::copy(examples.join("paper-robot.toml"), &robot).unwrap();
    let arguments = ["background", "--pictures", "1000", "--rig", text(&rig)];
    let mut child = tdcr(&[&arguments[..], &["--out", text(&log)]].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let began = Instant::now();
    let partial = log.with_added_extension("tmp");
    while !std::fs::metadata(&partial).is_ok_and(|file| file.len() > 0) {
        assert!(
            began.elapsed() < Duration::from_secs(60),
            "no picture comes"
        );
        sleep(Duration::from_millis(20));
    }
    // Four pictures of 640 by 480 take longer than the second signal.
    signal(&child, "-INT");
    signal(&child, "-INT");
    assert_eq!(ends_soon(&mut child).code(), Some(130));
    assert!(!log.exists() && !partial.exists());
}
