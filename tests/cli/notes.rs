//! Notes on robots from files of other tools: every command that reads one says them.

use std::fs;

use crate::study::write;
use crate::{stderr, tdcr, text};

/// A MuJoCo model whose commands are other functions than those here, behind simulated servos.
const ROBOT: &str = include_str!("notes/robot.xml");
const RIG: &str = include_str!("notes/rig.toml");
const STUDY: &str = "title = \"Small\"\nrobot = \"robot.xml\"\nwant = [\"tip\"]\n\
                     [[vary]]\nwhat = \"payload\"\nvalues = [0.0]\n[[vary]]\nwhat = \"command\"\n[sample]\ncount = 2\n";

#[test]
fn study_and_the_commands_of_a_rig_say_them() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "robot.xml", ROBOT);
    let study = write(folder.path(), "study.toml", STUDY);
    let rig = write(folder.path(), "rig.toml", RIG);
    let out = folder.path().join("out");
    for arguments in [
        vec!["study", text(&study), "--out", text(&out)],
        vec![
            "capture",
            "--rig",
            text(&rig),
            "--commands",
            "10",
            "--dry-run",
        ],
    ] {
        let output = tdcr(&arguments).output().unwrap();
        let said = stderr(&output);
        assert!(output.status.success(), "{said}");
        let note = "a command is the rest length (m), 0.75 ctrl + 0.005";
        assert_eq!(said.matches(note).count(), 3, "{arguments:?}: {said}");
    }
    assert!(fs::metadata(out.join("study.json")).is_ok());
}

#[test]
fn export_says_where_a_model_is_otherwise() {
    let folder = tempfile::tempdir().unwrap();
    let toml = crate::succeed(&["export", "--robot", "2m", "--format", "toml"]);
    let spring = "armature = 0.01\nbackbone = { bending = [0.05, 0.05], torsion = 0.15 }";
    let robot = write(
        folder.path(),
        "robot.toml",
        &toml.replace("armature = 0.01", spring),
    );
    let output = tdcr(&["export", "--robot", text(&robot)]).output().unwrap();
    assert!(output.status.success());
    let said = stderr(&output);
    assert!(
        said.contains("bending and torsion differ at 10 joints, by up to 3.000 times"),
        "{said}"
    );
}
