//! Learning one representative of the commands that a robot's symmetries make alike.

use std::path::Path;

use serde_json::Value;
use tdcr::learn::data::read_cloud;

use crate::{
    TINY_NETWORK, collect_small, eval_small, refuse, stderr, succeed_json, tdcr, text, train_tiny,
};

const ALL: &str = "symmetry: 6 tendon permutations (3 rotations, 3 reflections), seen in 3 views";

/// What a run says on stderr of symmetries.
fn said(data: &Path, run: &Path, options: &[&str]) -> String {
    let places = ["--data", text(data), "--out", text(run)];
    let output = tdcr(&[&TINY_NETWORK[..], &places, options].concat())
        .output()
        .unwrap();
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    let mut lines = said.lines().filter(|line| line.contains("symmetry: "));
    let line = lines.next().expect(&said).to_owned();
    assert_eq!(lines.next(), None, "{said}");
    line
}

/// The points of a prediction (m).
fn predicted(model: &Path, command: &[f64], out: &Path) -> Vec<[f32; 3]> {
    let command: Vec<String> = command.iter().map(f64::to_string).collect();
    let command = command.join(",");
    let places = ["--model", text(model), "--out", text(out)];
    let options = [
        "--command",
        &command,
        "--points",
        "50",
        "--precision",
        "float32",
    ];
    succeed_json(&[&["predict"][..], &places, &options].concat());
    read_cloud(out).unwrap().points
}

#[test]
fn a_run_says_which_symmetries_it_uses_and_its_model_predicts_by_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let data = path("data");
    collect_small(&data, &[]);
    assert!(said(&data, &path("run"), &[]).ends_with(ALL));
    let none = said(&data, &path("none"), &["--symmetry", "none"]);
    assert!(none.ends_with("symmetry: none, as asked for"), "{none}");
    let colors = said(&data, &path("colors"), &["--colors"]);
    assert!(
        colors.contains("because the cameras do not see images of the robot in the same colours")
    );

    // The reflection y -> -y is one of the cameras as well: of the mirrored command the mirrored cloud is predicted.
    let model = path("run").join("model.safetensors");
    let command = [0.03, 0.01, 0.02, 0.005, 0.02, 0.015];
    let mirrored = [0.03, 0.02, 0.01, 0.005, 0.015, 0.02];
    let cloud = predicted(&model, &command, &path("cloud.ply"));
    let image = predicted(&model, &mirrored, &path("image.ply"));
    assert_eq!(cloud.len(), 50);
    for (a, b) in cloud.iter().zip(&image) {
        let miss = [a[0] - b[0], a[1] + b[1], a[2] - b[2]];
        assert!(miss.iter().all(|x| x.abs() < 1e-6), "{a:?}, {b:?}");
    }
    succeed_json(&eval_small(text(&model), &data));
    let student = [
        "distill",
        "--model",
        text(&model),
        "--data",
        text(&data),
        "--steps",
        "10",
    ];
    let out = path("fast");
    let distilled: Value = succeed_json(&[&student[..], &["--out", text(&out)]].concat());
    assert!(distilled["validation_cd"].as_f64().unwrap().is_finite());
}

#[test]
fn a_run_goes_on_with_its_own_use_of_symmetries_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (data, run, none) = (path("data"), path("run"), path("none"));
    collect_small(&data, &[]);
    let trained = train_tiny(&data, &run, &[]);
    assert_eq!(train_tiny(&data, &run, &["--symmetry", "auto"]), trained);
    train_tiny(&data, &none, &["--symmetry", "none"]);
    let refused = |run: &Path, options: &[&str], expected: &str| {
        let places = ["--data", text(&data), "--out", text(run)];
        refuse(&[&TINY_NETWORK[..], &places, options].concat(), 1, expected);
    };
    refused(
        &run,
        &["--symmetry", "none"],
        "of another run: settings.symmetry was \"auto\", expected \"none\"",
    );
    refused(
        &none,
        &[],
        "of another run: settings.symmetry was \"none\", expected \"auto\"",
    );
    // A run that starts at a model has its symmetries.
    let start = |run: &Path| run.join("model.safetensors");
    let of_none = said(&data, &path("on"), &["--init", text(&start(&none))]);
    assert!(of_none.ends_with("symmetry: none, as the initial model has none"));
    let of_run = said(&data, &path("further"), &["--init", text(&start(&run))]);
    assert!(of_run.ends_with(&format!("{ALL}, as the initial model has")));
    refused(
        &path("off"),
        &["--symmetry", "none", "--init", text(&start(&run))],
        "its symmetry is 6 tendon permutations (3 rotations, 3 reflections), seen in 3 views, expected the data's 1",
    );
}

#[test]
fn imported_clouds_have_no_symmetries_that_are_known() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (data, files, imported) = (path("data"), path("files"), path("imported"));
    collect_small(&data, &[]);
    let export = [
        "data",
        "export",
        text(&data),
        "--format",
        "npz",
        "--out",
        text(&files),
    ];
    succeed_json(&export);
    let train = files.join("train");
    succeed_json(&[
        "data",
        "import",
        text(&train),
        "--points",
        "300",
        "--out",
        text(&imported),
    ]);
    let said = said(&imported, &path("run"), &["--points", "300"]);
    let expected =
        "symmetry: none, because the data set does not say how its clouds were simulated";
    assert!(said.ends_with(expected), "{said}");
}
