//! Names from files and the command line: what a terminal would obey, and what is not Unicode.

use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;

use crate::{SMALL_SET, stderr, tdcr, text};

#[test]
fn a_robots_name_does_not_command_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("robot.toml");
    let robot = include_str!("one-module.toml");
    let name = "name = \"a\\u001b[2Jb\\u009b31m\\u202ec\"";
    fs::write(&file, robot.replace("name = \"one module\"", name)).unwrap();
    let harmless = |bytes: &[u8], shown: &str| {
        let said = String::from_utf8(bytes.to_vec()).unwrap();
        assert!(said.contains(shown), "{said:?}");
        let obeyed = |c: char| (c.is_control() && c != '\n') || c == '\u{202e}';
        assert!(!said.contains(obeyed), "{said:?}");
    };
    let shown = "a\\u001b[2Jb\\u009b31m\\u202ec";
    let refused = tdcr(&["settle", "--robot", text(&file), "--command", "0.01"]);
    harmless(&{ refused }.output().unwrap().stderr, shown);
    let data = folder.path().join("data");
    let collect = [
        &SMALL_SET[..],
        &["--robot", text(&file), "--out", text(&data)],
    ]
    .concat();
    harmless(&tdcr(&collect).output().unwrap().stdout, shown);
    let json = [
        "settle",
        "--robot",
        text(&file),
        "--command",
        "0,0,0",
        "--json",
    ];
    harmless(&tdcr(&json).output().unwrap().stdout, shown);
}

#[test]
fn a_name_that_is_not_unicode_works_or_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join(OsStr::from_bytes(b"d\xffta"));
    let run = |arguments: &[&str], json: &[&str]| {
        let mut command = tdcr(arguments);
        command.arg(&data).args(json).output().unwrap()
    };
    let collect = [&SMALL_SET[..], &["--out"]].concat();
    let refused = run(&collect, &["--json"]);
    assert_eq!(refused.status.code(), Some(1));
    let said = stderr(&refused);
    assert!(
        said.contains("which is not UTF-8; rename it, or leave out --json"),
        "{said}"
    );
    assert!(!data.exists());
    for arguments in [&collect[..], &["data", "info"], &["data", "check"]] {
        let output = run(arguments, &[]);
        assert!(
            output.status.success(),
            "{arguments:?}: {}",
            stderr(&output)
        );
    }
}
