//! A rig among the obstacles of a scene.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use serde_json::Value;

use crate::capture::small_rig;
use crate::{refuse, stderr, tdcr, text};

/// The small rig with a table `[scene]`, beside a wall 6 mm from its home.
fn rig_by_a_wall(folder: &Path, scene: &str) -> PathBuf {
    let rig = small_rig(folder);
    let whole = fs::read_to_string(&rig).unwrap();
    let scene = format!("[scene]\n{scene}\n\n[motion]");
    fs::write(&rig, whole.replacen("[motion]", &scene, 1)).unwrap();
    let wall = "[[obstacle]]\nname = \"wall\"\nbox = { size = [0.02, 2.0, 2.0] }\nposition = [0.04, 0.0, 0.0]\n";
    fs::write(folder.join("wall.toml"), wall).unwrap();
    rig
}

fn keys(arguments: &[&str], keys: &str) -> Output {
    let mut command = tdcr(arguments);
    let pipes = command.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = pipes.stderr(Stdio::piped()).spawn().unwrap();
    let mut stdin = child.stdin.take().unwrap();
    stdin.write_all(keys.as_bytes()).unwrap();
    drop(stdin);
    child.wait_with_output().unwrap()
}

#[test]
fn keys_lead_no_disc_of_a_rig_into_a_wall() {
    let folder = tempfile::tempdir().unwrap();
    let rig = rig_by_a_wall(folder.path(), "file = \"wall.toml\"\nclearance = 0.004");
    // Along x to the wall, along y, and home.
    for (tip, along) in [(&["--tip"][..], "ddddwwhq"), (&[], "ddwwhq")] {
        let out = folder.path().join(format!("jogged{}", tip.len()));
        let jog = ["jog", "--rig", text(&rig), "--out", text(&out), "--json"];
        let jogged = keys(&[&jog[..], tip].concat(), along);
        let said = stderr(&jogged);
        assert!(jogged.status.success(), "{said}");
        assert!(said.contains("mm from the obstacle `wall`"), "{said}");
        let summary: Value = serde_json::from_slice(&jogged.stdout).unwrap();
        assert!(summary["refused"].as_u64().unwrap() >= 2, "{summary}");
        assert!(summary["moves"].as_u64().unwrap() >= 2, "{summary}");
    }
}

#[test]
fn scenes_of_rigs_that_are_wrong_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (scene, reason) in [
        ("file = \"gone.toml\"", "gone.toml: it cannot be read"),
        (
            "file = \"wall.toml\"\nclearence = 0.1",
            "unknown field `clearence`",
        ),
        ("clearance = 0.1", "missing field `file`"),
        (
            "file = \"wall.toml\"\nclearance = -0.1",
            "rig.toml:29: scene.clearance is -0.1",
        ),
        (
            "file = \"wall.toml\"\nclearance = 0.01",
            "`wall`, 0 % of the way",
        ),
    ] {
        let rig = rig_by_a_wall(folder.path(), scene);
        let capture = [
            "capture",
            "--rig",
            text(&rig),
            "--commands",
            "1",
            "--dry-run",
        ];
        refuse(&capture, 1, reason);
    }
}
