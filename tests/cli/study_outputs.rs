//! Outputs of `tdcr study` that take more than one settled robot: trained models, dexterity, hysteresis loops.

use std::fs;
use std::path::Path;

use crate::study::{files, number, table, write};
use crate::{SMALL_SET, TINY_NETWORK, refuse, succeed, succeed_json, text};

/// A study of two models under three commands.
const MODELS: &str = r#"
want = ["model"]
[model]
file = "{run}/model.safetensors"
points = 300
emd_points = 60
[[vary]]
what = "model.run"
values = ["one", "other"]
[[vary]]
what = "command"
[sample]
count = 3
"#;

/// Runs a study in parts, which must come to the files of one run; returns the folder of that.
fn run_in_parts(folder: &Path, file: &Path, parts: usize) -> std::path::PathBuf {
    let whole = folder.join("whole");
    succeed(&["study", text(file), "--out", text(&whole)]);
    let folders: Vec<_> = (1..=parts)
        .map(|part| {
            let out = folder.join(format!("part-{part}"));
            let which = format!("{part}/{parts}");
            succeed(&["study", text(file), "--part", &which, "--out", text(&out)]);
            out
        })
        .collect();
    let merged = folder.join("merged");
    let folders: Vec<&str> = folders.iter().map(|out| text(out)).collect();
    succeed(&[&["study", "merge"], &folders[..], &["--out", text(&merged)]].concat());
    assert!(files(&merged) == files(&whole));
    whole
}

#[test]
fn trained_models_are_scored_beside_the_sampling_floor() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let data = at("data");
    succeed(&[&SMALL_SET[..], &["--out", text(&data)]].concat());
    for (run, seed) in [("one", "0"), ("other", "1")] {
        let run = at(run);
        let options = ["--data", text(&data), "--out", text(&run), "--seed", seed];
        succeed(&[&TINY_NETWORK[..], &options].concat());
    }
    let file = write(folder.path(), "study.toml", MODELS);
    let whole = run_in_parts(folder.path(), &file, 2);
    let rows = table(&whole.join("table.csv"));
    assert_eq!(rows.len(), 6);
    for row in &rows {
        for measure in ["cd", "emd"] {
            let [model, floor] =
                ["model", "floor"].map(|who| number(row, &format!("{who}_{measure}")));
            assert!(
                model > 1.5 * floor && floor > 0.0,
                "{measure}: {model} beside {floor}"
            );
        }
        assert!(number(row, "model_tip") > 0.0);
    }
    // The same robots under the same commands, by two networks.
    for (one, other) in rows[..3].iter().zip(&rows[3..]) {
        assert_eq!(one["floor_cd"], other["floor_cd"]);
        assert_ne!(one["model_cd"], other["model_cd"]);
    }
    let curves = fs::read_to_string(whole.join("figures/training.svg")).unwrap();
    assert!(curves.contains("one") && curves.contains("Validation CD"));

    // Another model in the place of one is another study.
    fs::copy(at("one/model.safetensors"), at("other/model.safetensors")).unwrap();
    let again = ["study", text(&file), "--out", text(&whole)];
    refuse(&again, 1, "holds another study");
    for (from, to, expected) in [
        ("{run}/", "{walk}/", "a path with {run}"),
        ("{run}/", "{run}/{x}", "{NAME} is the value of a variable"),
        (
            "want = [\"model\"]",
            "want = [\"model\"]\nrobot = \"3m\"",
            "no other robot than the model's own",
        ),
        (
            "want = [\"model\"]",
            "want = [\"tip\"]",
            "an entry \"model\" in `want`",
        ),
        ("emd_points = 60", "emd_points = 301", "1 to 300"),
    ] {
        let changed = write(folder.path(), "changed.toml", &MODELS.replace(from, to));
        refuse(&["study", text(&changed)], 1, expected);
    }
    fs::remove_file(at("other/model.safetensors")).unwrap();
    refuse(&again, 1, "other/model.safetensors, which is not there");
}

#[test]
fn what_a_model_is_not_told_counts_as_its_error() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("one"));
    succeed(&[&SMALL_SET[..], &["--out", text(&data)]].concat());
    succeed(
        &[
            &TINY_NETWORK[..],
            &["--data", text(&data), "--out", text(&run)],
        ]
        .concat(),
    );
    let study = MODELS.replace(
        "values = [\"one\", \"other\"]",
        "values = [\"one\"]\n[[vary]]\nwhat = \"modules\"\nvalues = [2, 3]",
    );
    let file = write(folder.path(), "study.toml", &study);
    let out = folder.path().join("out");
    succeed(&["study", text(&file), "--out", text(&out)]);
    let rows = table(&out.join("table.csv"));
    let fits = |row: &&std::collections::BTreeMap<String, String>| row["modules"] == "2";
    assert!(
        rows.iter()
            .filter(fits)
            .all(|row| row["status"] == "settled")
    );
    // A command of nine tendons is none of a model of six.
    let others: Vec<_> = rows.iter().filter(|row| !fits(row)).collect();
    assert_eq!(others.len(), 3);
    let refused = |row: &&std::collections::BTreeMap<String, String>| {
        row["status"].contains("9 values") && row["model_emd"].is_empty()
    };
    assert!(others.iter().all(refused), "{others:?}");
}

#[test]
fn latin_hypercubes_in_parts_tell_workspace_and_dexterity_as_one_run() {
    let folder = tempfile::tempdir().unwrap();
    let study = "want = [\"workspace\", \"dexterity\"]\ndexterity_radius = 0.03\n[[vary]]\nwhat = \"robot\"\nvalues = [\"2m\", \"3m\"]\n\
                 [[vary]]\nwhat = \"command\"\n[sample]\ndesign = \"latin-hypercube\"\ncount = 300\n";
    let file = write(folder.path(), "study.toml", study);
    let whole = run_in_parts(folder.path(), &file, 3);
    let rows = table(&whole.join("summary.csv"));
    assert_eq!(rows.len(), 2);
    for row in &rows {
        let shares =
            ["p10", "median", "p90", "max"].map(|name| number(row, &format!("dexterity_{name}")));
        assert!(
            shares.is_sorted() && shares[0] > 0.0 && shares[3] < 1.0,
            "{shares:?}"
        );
        assert_eq!(number(row, "dexterity_radius"), 0.03);
        assert!(number(row, "volume") > 0.0);
    }
    // Each tendon's values are in strata of their own, over all parts.
    let commands = table(&whole.join("table.csv"));
    let mut strata: Vec<usize> = (commands[..300].iter())
        .map(|row| (number(row, "c0") / 0.04 * 300.0) as usize)
        .collect();
    strata.sort_unstable();
    strata.dedup();
    assert_eq!(strata.len(), 300);
    assert!(whole.join("figures/dexterity.svg").exists());
    refuse(
        &[
            "study",
            text(&write(folder.path(), "none.toml", "want = [\"dexterity\"]")),
        ],
        1,
        "this one is of many commands",
    );
}

/// A robot whose tendons slide freely comes back as it went, but for the wall that it rubs on.
#[test]
fn an_obstacle_that_rubs_opens_a_hysteresis_loop() {
    let folder = tempfile::tempdir().unwrap();
    let wall = "[[obstacle]]\nname = \"wall\"\nbox = { size = [0.02, 1.0, 1.0] }\nposition = [0.05, 0.0, 0.3]\n";
    let study = "want = [\"hysteresis\"]\nset = { command = 0.03, stiffness = 0.2 }\nhysteresis = { by = -0.02 }\n\
                 [[vary]]\nwhat = \"scene\"\nvalues = [\"smooth.toml\", \"rough.toml\"]\n";
    let file = folder.path().join("study.toml");
    fs::write(&file, study).unwrap();
    fs::write(folder.path().join("smooth.toml"), wall).unwrap();
    let rough = format!("{wall}friction = 0.5\n");
    fs::write(folder.path().join("rough.toml"), rough).unwrap();
    let out = folder.path().join("out");
    let finished = succeed_json(&["study", text(&file), "--out", text(&out)]);
    assert_eq!(finished["settled"], 2);
    let rows = table(&out.join("table.csv"));
    let widths: Vec<f64> = rows.iter().map(|row| number(row, "loop_width")).collect();
    assert!(widths[0] < 1e-7 && widths[1] > 5e-5, "{widths:?}");
}

#[test]
fn hysteresis_loops_are_drawn_and_their_area_grows_with_friction() {
    let folder = tempfile::tempdir().unwrap();
    let study = "want = [\"hysteresis\"]\nset = { command = 0.03, stiffness = 0.2 }\nhysteresis = { by = -0.02 }\n\
                 [[vary]]\nwhat = \"friction\"\nvalues = [0.0, 0.05, 0.1]\n";
    let file = write(folder.path(), "study.toml", study);
    let out = folder.path().join("out");
    let finished = succeed_json(&["study", text(&file), "--out", text(&out)]);
    assert_eq!(finished["settled"], 3);
    let rows = table(&out.join("table.csv"));
    let areas: Vec<f64> = rows.iter().map(|row| number(row, "loop_area")).collect();
    assert!(
        areas[0] < 0.01 * areas[1] && areas[1] < areas[2],
        "{areas:?}"
    );
    let loops = fs::read_to_string(out.join("figures/hysteresis-loops.svg")).unwrap();
    for name in ["friction 0", "friction 0.05", "friction 0.1"] {
        assert!(loops.contains(name), "{name}");
    }
}
