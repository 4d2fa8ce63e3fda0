//! `tdcr data export --format lerobot`: what Python is asked to do. `tests/python/package/test_lerobot.py` has what it does.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use serde_json::{Value, json};

use crate::{COMMAND, stderr, tdcr};

/// Runs the export in a folder with an interpreter that says on stdout what it is given, and ends with 3.
fn ask(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let python = folder.join("python");
    fs::write(&python, "#!/bin/sh\ncat\nexit 3\n").unwrap();
    fs::set_permissions(&python, fs::Permissions::from_mode(0o755)).unwrap();
    let export = ["data", "export", "--format", "lerobot", "--out", "episodes"];
    let mut command = tdcr(&[&export[..], arguments].concat());
    command.current_dir(folder).env("TDCR_PYTHON", &python);
    let output = command.output().unwrap();
    let said = String::from_utf8(output.stdout.clone()).unwrap();
    (output.status.code(), said, stderr(&output))
}

fn asked(folder: &Path, arguments: &[&str]) -> Value {
    let (status, said, error) = ask(folder, arguments);
    assert_eq!(status, Some(3), "{error}");
    serde_json::from_str(&said).unwrap()
}

fn refused(folder: &Path, arguments: &[&str], expected: &str) {
    let (status, said, error) = ask(folder, arguments);
    assert!(
        status == Some(1) && error.contains(expected),
        "{arguments:?} said\n{said}{error}"
    );
}

#[test]
fn python_gets_what_was_given_and_its_status_is_that_of_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir(folder.join("captured")).unwrap();
    for log in ["captured/log.mcap", "captured/log-2.mcap", "other.mcap"] {
        fs::write(folder.join(log), "").unwrap();
    }
    fs::write(folder.join("moves.csv"), format!("{COMMAND}\n{COMMAND}\n")).unwrap();

    let request = asked(folder, &["captured", "other.mcap", "--threads", "2"]);
    let logs = ["captured/log.mcap", "captured/log-2.mcap", "other.mcap"];
    assert_eq!(
        request,
        json!({"version": env!("CARGO_PKG_VERSION"), "function": "export_logs",
            "keywords": {"out": "episodes", "logs": logs},
            "episodes": 3, "threads": 2, "json": false, "quiet": false})
    );
    let more = [
        "--fps",
        "30",
        "--task",
        "bend",
        "--repo-id",
        "a/b",
        "--images",
        "--depth",
    ];
    let request = asked(
        folder,
        &[&["other.mcap", "--json", "--quiet"], &more[..]].concat(),
    );
    assert_eq!(
        request["keywords"],
        json!({"out": "episodes", "logs": ["other.mcap"], "fps": 30, "task": "bend", "repo_id": "a/b",
            "videos": false, "depth": true})
    );
    assert_eq!(
        (&request["json"], &request["quiet"]),
        (&true.into(), &true.into())
    );

    let request = asked(folder, &["moves.csv", "--robot", "2m", "--cameras", "0,2"]);
    assert_eq!(request["function"], "export_commands");
    let keywords = &request["keywords"];
    assert_eq!(
        (&keywords["robot"]["name"], &keywords["cameras"]),
        (&json!("2m"), &json!([0, 2]))
    );
    let commands = serde_json::from_str::<Value>(&format!("[{COMMAND}]")).unwrap();
    assert_eq!(keywords["commands"], json!([[commands, commands]]));
}

#[test]
fn what_python_could_not_do_it_is_not_asked() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir(folder.join("set")).unwrap();
    fs::write(folder.join("log.mcap"), "").unwrap();
    fs::write(folder.join("moves.csv"), format!("{COMMAND}\n{COMMAND}\n")).unwrap();
    fs::write(folder.join("one.csv"), COMMAND).unwrap();
    fs::write(folder.join("wrong.csv"), "0,0,0,0,0,0\n0,0,0,0,0,1\n").unwrap();
    refused(folder, &["set"], "set: no log.mcap, which `tdcr capture`");
    refused(folder, &["none.mcap"], "there is no none.mcap");
    refused(
        folder,
        &["moves.csv", "log.mcap"],
        "log.mcap is no file of commands",
    );
    refused(folder, &["one.csv"], "one.csv has 1 command; expected");
    refused(folder, &["wrong.csv"], "command entry 6 is 1 m");
    refused(
        folder,
        &["log.mcap", "--robot", "2m"],
        "--robot goes with files",
    );

    let export = ["data", "export", "log.mcap", "--out", "made"];
    let refuse = |more: &[&str], python: &str, expected: &str| {
        let mut command = tdcr(&[&export[..], more].concat());
        command.current_dir(folder).env("TDCR_PYTHON", python);
        let output = command.output().unwrap();
        let said = stderr(&output);
        assert!(
            output.status.code() == Some(1) && said.contains(expected),
            "{said}"
        );
    };
    let missing = "cannot run no/python: --format lerobot needs Python with the package tdcr";
    refuse(&["--format", "lerobot"], "no/python", missing);
    let ply = ["--format", "ply", "--fps", "10"];
    refuse(&ply, "no/python", "--fps goes with --format lerobot");
    let two = ["--format", "npz", "set"];
    refuse(&two, "no/python", "2 data sets are given; expected one");
    assert!(!folder.join("made").exists());
}
