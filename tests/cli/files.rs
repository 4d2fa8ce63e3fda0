//! What was there stays until what takes its place is whole.

use std::fs;
use std::path::Path;

use crate::{COMMAND, collect_small, eval_small, stderr, succeed, tdcr, text, train_tiny};

/// Runs a command that writes `file`, with another result there and no room for a new one beside it.
fn keeps(file: &Path, arguments: &[&str]) {
    fs::write(file, "old").unwrap();
    let aside = file.with_added_extension("tmp");
    fs::create_dir(&aside).unwrap();
    let output = tdcr(arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    let said = stderr(&output);
    assert!(
        said.contains("cannot") && said.contains(text(file)) || said.contains("file:"),
        "{said}"
    );
    assert_eq!(fs::read(file).unwrap(), b"old", "{arguments:?}");
    fs::remove_dir(&aside).unwrap();
    // And with room it is replaced, and nothing is left beside it.
    fs::write(file, "old").unwrap();
    succeed(arguments);
    assert_ne!(fs::read(file).unwrap(), b"old", "{arguments:?}");
    assert!(!aside.exists());
}

#[test]
fn a_result_that_cannot_be_written_leaves_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (data, run, commands) = (path("data"), path("run"), path("commands.csv"));
    collect_small(&data, &[]);
    let trained = train_tiny(&data, &run, &[]);
    let model = trained["model"].as_str().unwrap();
    fs::write(&commands, format!("{COMMAND}\n{COMMAND}\n")).unwrap();

    let simulate = ["simulate", "--commands", text(&commands)];
    let file = path("path.csv");
    keeps(&file, &[&simulate[..], &["--out", text(&file)]].concat());
    let file = path("matrices.json");
    keeps(
        &file,
        &[&simulate[..], &["--linearise", text(&file)]].concat(),
    );
    let file = path("robot.xml");
    keeps(&file, &["export", "--force", "--out", text(&file)]);
    for name in ["page.html", "page.svg", "page.png"] {
        let file = path(name);
        keeps(&file, &["data", "view", text(&data), "--out", text(&file)]);
    }
    for name in ["cloud.ply", "cloud.npz"] {
        let file = path(name);
        let predict = [
            "predict",
            "--model",
            model,
            "--command",
            COMMAND,
            "--points",
            "50",
        ];
        keeps(&file, &[&predict[..], &["--out", text(&file)]].concat());
    }
    let file = path("scores.html");
    let report = ["--report", text(&file)];
    keeps(&file, &[&eval_small(model, &data)[..], &report].concat());
}

#[test]
fn a_run_that_fails_leaves_the_path_of_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let (commands, out) = (
        folder.path().join("commands.csv"),
        folder.path().join("path.csv"),
    );
    fs::write(&commands, format!("{COMMAND}\n").repeat(2000)).unwrap();
    fs::write(&out, "old").unwrap();
    // Too long a step for an explicit integrator.
    let simulate = [
        "simulate",
        "--commands",
        text(&commands),
        "--integrator",
        "runge-kutta4",
    ];
    let output = tdcr(&[&simulate[..], &["--dt", "0.5", "--out", text(&out)]].concat());
    let output = { output }.output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert_eq!(fs::read(&out).unwrap(), b"old");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn exported_and_predicted_clouds_do_not_mix_with_older_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (data, out) = (path("data"), path("out"));
    collect_small(&data, &[]);
    let export = |format| {
        [
            "data",
            "export",
            text(&data),
            "--format",
            format,
            "--out",
            text(&out),
        ]
        .map(str::to_owned)
    };
    let ply = export("ply");
    let ply: Vec<&str> = ply.iter().map(String::as_str).collect();
    succeed(&ply);
    let output = tdcr(&ply).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("holds `test`, expected an empty folder, or a new one"));
    let names = |folder: &Path| {
        let mut names: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().file_name())
            .collect();
        names.sort_unstable();
        names
    };
    assert_eq!(names(&out), ["test", "train", "val"]);
    assert_eq!(names(&out.join("test")).len(), 4);
    // What a killed export left is no obstacle, and does not stay.
    fs::remove_dir_all(&out).unwrap();
    fs::create_dir_all(out.join(".partial-export/train")).unwrap();
    fs::write(out.join(".partial-export/train/cloud-00099.ply"), "half").unwrap();
    succeed(&ply);
    assert_eq!(names(&out), ["test", "train", "val"]);
    assert_eq!(names(&out.join("train")).len(), 32);

    let trained = train_tiny(&data, &path("run"), &[]);
    let (commands, clouds) = (path("commands.csv"), path("clouds"));
    let model = trained["model"].as_str().unwrap();
    let predict = [
        "predict",
        "--model",
        model,
        "--points",
        "50",
        "--commands",
        text(&commands),
        "--out",
        text(&clouds),
    ];
    fs::write(&commands, format!("{COMMAND}\n{COMMAND}\n")).unwrap();
    succeed(&predict);
    succeed(&predict);
    fs::write(&commands, format!("{COMMAND}\n")).unwrap();
    let output = tdcr(&predict).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("holds cloud-00001.ply of an earlier prediction"));
}
