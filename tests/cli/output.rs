//! Outputs whose names promise another format than is written.

use crate::{COMMAND, refuse, text};

#[test]
fn a_name_that_promises_another_format_is_refused_before_the_work_is_done() {
    let folder = tempfile::tempdir().unwrap();
    let commands = folder.path().join("commands.csv");
    std::fs::write(&commands, format!("{COMMAND}\n")).unwrap();
    let commands = ["--commands", text(&commands)];
    let one = ["--command", COMMAND];
    let refused = |what: &[&str], option: &str, name: &str, expected: &str| {
        let out = folder.path().join(name);
        refuse(&[what, &[option, text(&out)]].concat(), 1, expected);
        assert!(!out.exists());
    };
    let predict = |command: [&'static str; 2]| ["predict", command[0], command[1]];
    let cloud = "expected the extension .ply or .npz";
    refused(&predict(one), "--out", "p6.obj", cloud);
    refused(&predict(one), "--out", "p6", cloud);
    let file = "is named like a file; expected a .npz file, or a folder for a PLY file each";
    let many = ["predict", commands[0], commands[1]];
    refused(&many, "--out", "p6.obj", file);
    refused(&many, "--out", "p6.PLY", file);
    let table = "expected the extension .csv or .json";
    refused(
        &["settle", commands[0], commands[1]],
        "--out",
        "t.txt",
        table,
    );
    let tip = ["reach", "--tip", "0.06,0.03,0.31"];
    refused(&tip, "--out", "t.npz", table);
    let simulate = ["simulate", commands[0], commands[1]];
    refused(
        &simulate,
        "--out",
        "path.npz",
        "expected the extension .csv",
    );
    refused(
        &simulate,
        "--linearise",
        "ab.npz",
        "expected the extension .json",
    );
    refused(
        &["eval"],
        "--report",
        "page.pdf",
        "expected the extension .html",
    );
    for (what, name, folder) in [
        ("collect", "data.h5", "the data set"),
        ("train", "model.safetensors", "the run"),
        ("distill", "model.safetensors", "the run"),
        ("demo", "report.html", "all that the demo makes"),
    ] {
        let expected = format!("is named like a file; expected a folder for {folder}");
        refused(&[what], "--out", name, &expected);
    }
    let pictures = "is named like a file; expected a folder for the pictures of all cameras";
    refused(&["render", one[0], one[1]], "--out", "views.png", pictures);
}
