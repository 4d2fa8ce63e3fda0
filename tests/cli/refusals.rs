//! What wrong input is told: what was wrong, where, and what would be right.

use std::fs;
use std::path::PathBuf;

use crate::{COMMAND, collect_small, refuse, text, train_tiny};

#[test]
fn a_wrong_robot_is_named() {
    let expected =
        "unknown robot `4m`: expected 2m, 3m, 5m or the path of a .toml, .json, .xml (MJCF) or";
    refuse(
        &["settle", "--robot", "4m", "--command", COMMAND],
        1,
        expected,
    );
    refuse(
        &["collect", "--robot", "4m", "--out", "/tmp/never"],
        1,
        expected,
    );
    refuse(
        &["settle", "--robot", "/no/such.toml", "--command", COMMAND],
        1,
        "cannot read robot file /no/such.toml",
    );
}

#[test]
fn a_wrong_command_is_named() {
    let settle = |command: &str, status, expected: &str| {
        refuse(&["settle", "--command", command], status, expected);
    };
    settle(
        "0.01,0.02",
        1,
        "the command has 2 entries; robot `2m` has 6 tendons",
    );
    settle(
        "0.01,0.02,0.05,0,0,0",
        1,
        "command entry 3 is 0.05 m; tendon 3 takes 0 to 0.04 m",
    );
    settle(
        "0.01,-0.02,0.01,0,0,0",
        1,
        "command entry 2 is -0.02 m; tendon 2 takes 0 to 0.04 m",
    );
    settle(
        "NaN,0.02,0.01,0,0,0",
        1,
        "command entry 1 is NaN m; tendon 1 takes 0 to 0.04 m",
    );
    settle("0.01,inf,0.01,0,0,0", 1, "command entry 2 is inf m");
    settle("0.01,two,0.01,0,0,0", 2, "`two` is not a number");
    refuse(
        &["settle"],
        1,
        "robot `2m` has 6 tendons; expected --command",
    );
    refuse(
        &["settle", "--command", COMMAND, "--payload", "-1"],
        1,
        "the payload is -1 kg; expected a finite mass",
    );
}

#[test]
fn wrong_numbers_and_sizes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("data");
    let collect = |option: &str, value: &str, status, expected: &str| {
        refuse(
            &["collect", "--out", text(&out), option, value],
            status,
            expected,
        );
    };
    collect("--samples", "5", 1, "5");
    collect("--points", "0", 2, "expected a whole number, 1 to 10000000");
    collect(
        "--samples",
        "10000000000000",
        2,
        "expected a whole number, 1 to 10000000",
    );
    collect("--voxel", "-0.002", 2, "expected a finite number above 0");
    collect("--voxel", "NaN", 2, "expected a finite number above 0");
    collect("--voxel", "1e-12", 1, "from 0.000001 to 1 m");
    collect("--voxel", "1e300", 1, "from 0.000001 to 1 m");
    refuse(
        &["servo-sim", "--friction", "0.3"],
        1,
        "--friction acts with --physics friction and --physics dynamic alone",
    );
    refuse(
        &["settle", "--command", COMMAND, "--threads", "0"],
        2,
        "--threads",
    );
    refuse(
        &["settle", "--command", COMMAND, "--threads", "20000"],
        2,
        "expected a whole number, 1 to ",
    );
    assert!(!out.exists(), "nothing was written");
}

#[test]
fn an_unwritable_folder_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "not a folder").unwrap();
    let inside: PathBuf = file.join("data");
    refuse(
        &["collect", "--samples", "10", "--out", text(&inside)],
        1,
        text(&inside),
    );
    refuse(
        &["demo", "--samples", "10", "--out", text(&inside)],
        1,
        text(&inside),
    );
    assert_eq!(fs::read_to_string(&file).unwrap(), "not a folder");
}

#[test]
fn a_folder_with_something_else_in_it_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("thesis.tex"), "precious").unwrap();
    refuse(
        &["collect", "--samples", "10", "--out", text(folder.path())],
        1,
        "thesis.tex",
    );
    let data = folder.path().join("data");
    collect_small(&data, &[]);
    refuse(
        &[
            "collect",
            "--samples",
            "20",
            "--points",
            "401",
            "--out",
            text(&data),
        ],
        1,
        "points_per_cloud",
    );
}

#[test]
fn sizes_that_make_no_context_are_named() {
    let mlp = ["train", "--resolutions", "8,8,8"];
    refuse(
        &mlp,
        1,
        "--resolutions is of --net hybrid, the network is an mlp",
    );
    let two = ["train", "--net", "hybrid", "--channels", "8,8"];
    refuse(
        &two,
        1,
        "--channels has 2 values, expected 3, one per stage",
    );
}

#[test]
fn a_truncated_data_file_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    collect_small(&data, &[]);
    let shard = data.join("train/shard-00000.h5");
    let bytes = fs::read(&shard).unwrap();
    fs::write(&shard, &bytes[..bytes.len() / 2]).unwrap();
    refuse(
        &["train", "--data", text(&data), "--out", text(&run)],
        1,
        text(&shard),
    );
    refuse(
        &["train", "--data", "/no/such/set", "--out", text(&run)],
        1,
        "there is no data set in /no/such/set; `tdcr collect --out /no/such/set` makes one",
    );
}

#[test]
fn a_broken_or_foreign_model_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    collect_small(&data, &[]);
    train_tiny(&data, &run, &[]);
    let model = run.join("model.safetensors");
    let predict = |command: &str, expected: &str| {
        refuse(
            &[
                "predict",
                "--model",
                text(&model),
                "--command",
                command,
                "--out",
                "/no/folder/x.ply",
            ],
            1,
            expected,
        );
    };
    predict(
        "0.01,0.02",
        "the command has 2 entries; robot `2m` has 6 tendons",
    );
    predict("0.01,0.02,0.05,0,0,0", "command entry 3 is 0.05 m");
    predict(COMMAND, "cannot write point cloud /no/folder/x.ply");
    let eval = ["eval", "--model", text(&model), "--data", text(&data)];
    refuse(
        &[&eval[..], &["--points", "401"]].concat(),
        1,
        "--points is 401; expected 1 to 400",
    );
    let other = folder.path().join("other");
    crate::succeed_json(&[
        "collect",
        "--robot",
        "3m",
        "--samples",
        "10",
        "--points",
        "400",
        "--out",
        text(&other),
    ]);
    refuse(
        &[
            "eval",
            "--model",
            text(&model),
            "--data",
            text(&other),
            "--points",
            "400",
            "--emd-points",
            "100",
        ],
        1,
        "the model is of robot `2m`, the data set of a different robot, `3m`",
    );
    let run_again = [
        "train",
        "--data",
        text(&data),
        "--out",
        text(&run),
        "--steps",
        "41",
    ];
    refuse(&run_again, 1, "cannot be resumed");
    let bytes = fs::read(&model).unwrap();
    fs::write(&model, &bytes[..bytes.len() - 7]).unwrap();
    predict(COMMAND, "model.safetensors: not a whole safetensors file");
    fs::write(&model, "a letter").unwrap();
    predict(COMMAND, "model.safetensors: not a whole safetensors file");
}

#[test]
fn a_data_set_of_another_subject_than_the_models_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let set = |name: &str, options: &[&str]| {
        let data = folder.path().join(name);
        collect_small(&data, options);
        data
    };
    let plain = set("plain", &[]);
    let loaded = set("loaded", &["--payload", "0:0.02"]);
    let train = |data: &PathBuf| {
        let trained = train_tiny(data, &data.with_extension("run"), &[]);
        trained["model"].as_str().unwrap().to_owned()
    };
    let (model, loaded_model) = (train(&plain), train(&loaded));
    let eval = |model: &str, data: PathBuf, expected: &str| {
        refuse(
            &["eval", "--model", model, "--data", text(&data)],
            1,
            expected,
        );
    };
    eval(
        &model,
        set("base", &["--base"]),
        "the model was trained on clouds without the base, the data set shows clouds with the base",
    );
    eval(
        &model,
        loaded,
        "the model was trained without payloads, the data set was made with payloads of 0:0.02 kg",
    );
    eval(
        &loaded_model,
        set("heavy", &["--payload", "0:0.03"]),
        "the model was trained with payloads of 0:0.02 kg, the data set was made with payloads of 0:0.03 kg",
    );
    let predict = |model: &str, options: &[&str], expected: &str| {
        let arguments = ["predict", "--model", model, "--command", COMMAND];
        refuse(&[&arguments[..], options].concat(), 1, expected);
    };
    predict(
        &loaded_model,
        &[],
        "the model was trained with payloads of 0:0.02 kg: say --payload KG, 0 for none",
    );
    predict(
        &loaded_model,
        &["--payload", "-1"],
        "the payload is -1 kg; expected a finite mass",
    );
    predict(&model, &["--payload", "0.01"], "leave out --payload");
}

#[test]
fn a_folder_of_another_robot_or_design_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    collect_small(&data, &[]);
    let again = |options: &[&str], expected: &str| {
        let arguments = [&crate::SMALL_SET[..], &["--out", text(&data)], options].concat();
        refuse(&arguments, 1, expected);
    };
    again(&["--robot", "3m"], "holds another data set: its `");
    again(
        &["--design", "sobol"],
        "its `origin.simulated.design` is \"uniform\", not \"sobol\"",
    );
    again(
        &["--base"],
        "its `origin.simulated.recipe.subject.base` is \"hidden\", not \"shown\"",
    );
    again(
        &["--design", "grid"],
        "20 commands are no grid in 6 dimensions, expected 1 (1 levels) or 64 (2 levels)",
    );
    again(
        &["--payload", "0.03:0"],
        "`payload` is 0.03:0, expected MIN:MAX in kg",
    );
}

#[test]
fn a_stream_with_payloads_that_are_no_masses_is_refused() {
    refuse(
        &[
            "train",
            "--stream",
            "2m",
            "--payload",
            "-1:0.03",
            "--out",
            "/tmp/never",
        ],
        1,
        "`payload` is -1:0.03, expected MIN:MAX in kg with 0 <= MIN <= MAX",
    );
}

/// What an option requires may conflict with what is given; then it would do nothing, and say nothing.
#[test]
fn an_option_that_would_do_nothing_is_refused() {
    let command = "0.034,0.007,0.001,0.026,0.015,0.019";
    for arguments in [
        &["settle", "--command", command, "--seed", "3"][..],
        &["settle", "--commands", "nosuch.csv", "--seed", "3"],
        &["settle", "--command", command, "--out", "never.csv"],
        &["settle", "--random", "2", "--out", "never.csv"],
        &["train", "--data", "nosuch", "--fresh", "3"],
        &["train", "--data", "nosuch", "--base"],
        &["train", "--data", "nosuch", "--scene", "nosuch.toml"],
        &["reach", "--tip", "0,0,0.3", "--steps", "3"],
        &["reach", "--path", "nosuch.csv", "--start", command],
        &[
            "pretension",
            "--rig",
            "nosuch.toml",
            "--current",
            "0.1",
            "--step",
            "3",
            "--patience",
            "9",
        ],
        &[
            "jog",
            "--rig",
            "nosuch.toml",
            "--bend",
            "0.1",
            "--step",
            "0.01",
        ],
    ] {
        refuse(arguments, 2, "cannot be used with");
    }
}
