//! Predictions for many commands, as archives, and outside the training range.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tdcr::learn::train::Model;

use crate::{
    COMMAND, collect_small, refuse, stderr, succeed, succeed_json, tdcr, text, train_tiny,
};

const COMMANDS: &str =
    "# six tendons\n0.034,0.007,0.001,0.026,0.015,0.019\n\n0.02,0.02,0.02,0.02,0.02,0.02\n";

/// A model of small data, in a folder.
fn model(folder: &Path, options: &[&str]) -> String {
    let (data, run) = (folder.join("data"), folder.join("run"));
    collect_small(&data, options);
    let trained = train_tiny(&data, &run, &[]);
    trained["model"].as_str().unwrap().to_owned()
}

fn predict(model: &str, options: &[&str]) -> Value {
    succeed_json(&[&["predict", "--model", model, "--points", "50"], options].concat())
}

/// The number of bytes of `needle`'s first place in `bytes`.
fn contains(bytes: &[u8], needle: &[u8]) -> bool {
    bytes.windows(needle.len()).any(|window| window == needle)
}

#[test]
fn many_commands_are_predicted_as_each_alone() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), &[]);
    let file = |name: &str| folder.path().join(name);
    fs::write(file("commands.csv"), COMMANDS).unwrap();
    let json = "[[0.034,0.007,0.001,0.026,0.015,0.019],[0.02,0.02,0.02,0.02,0.02,0.02]]";
    fs::write(file("commands.json"), json).unwrap();
    let batch = |commands: &str, out: &str| {
        let (commands, out) = (file(commands), file(out));
        predict(
            &model,
            &["--commands", text(&commands), "--out", text(&out)],
        )
    };
    let many = batch("commands.csv", "clouds");
    assert_eq!(many.as_array().unwrap().len(), 2);
    batch("commands.json", "again");
    for (index, command) in [
        "0.034,0.007,0.001,0.026,0.015,0.019",
        "0.02,0.02,0.02,0.02,0.02,0.02",
    ]
    .iter()
    .enumerate()
    {
        let alone = file("alone.ply");
        let single = predict(&model, &["--command", command, "--out", text(&alone)]);
        assert_eq!(single["min"], many[index]["min"]);
        let alone = fs::read(alone).unwrap();
        for dir in ["clouds", "again"] {
            let cloud = PathBuf::from(dir).join(format!("cloud-{index:05}.ply"));
            assert!(fs::read(folder.path().join(cloud)).unwrap() == alone);
        }
    }
    let all = batch("commands.csv", "all.npz");
    assert_eq!(all[1]["max"], many[1]["max"]);
    let archive = fs::read(file("all.npz")).unwrap();
    assert!(contains(&archive, b"'shape': (2, 50, 3, )"));
    assert!(contains(&archive, b"'shape': (2, 6, )"));
    // The first coordinate of the last cloud's PLY stands in the archive too.
    let ply = fs::read(file("clouds/cloud-00001.ply")).unwrap();
    let body = ply.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    assert!(contains(&archive, &ply[body..body + 12]));
    let alone = file("alone.npz");
    predict(
        &model,
        &[
            "--command",
            "0.02,0.02,0.02,0.02,0.02,0.02",
            "--out",
            text(&alone),
        ],
    );
    let alone = fs::read(alone).unwrap();
    assert!(contains(&alone, b"'shape': (50, 3, )") && contains(&alone, &ply[body..body + 12]));
}

#[test]
fn wrong_files_of_commands_are_named_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), &["--payload", "0:0.03"]);
    let batch = |name: &str, content: &str, expected: &str| {
        let file = folder.path().join(name);
        fs::write(&file, content).unwrap();
        let out = folder.path().join("out");
        let arguments = ["predict", "--model", &model, "--commands", text(&file)];
        refuse(
            &[&arguments[..], &["--out", text(&out)]].concat(),
            1,
            expected,
        );
    };
    batch(
        "a.csv",
        "0,0,0,0,0,0,0.01\n0,0,0,0,0,0\n",
        "a.csv line 2: the command has 5 entries",
    );
    batch(
        "a.csv",
        "0,0,0,0,0,0,-1\n",
        "a.csv line 1: the payload is -1 kg",
    );
    batch("a.csv", "0,zero\n", "a.csv line 1: `zero` is not a number");
    batch("a.csv", "# nothing\n", "a.csv has no commands");
    batch(
        "a.json",
        "[[0,0,0,0,0,0,0],[0]]",
        "a.json entry 1: the command has 0 entries",
    );
    batch("a.json", "{}", "a.json is not a list of lists of numbers");
    let file = folder.path().join("good.csv");
    fs::write(&file, "0,0,0,0,0,0,0\n").unwrap();
    let arguments = ["predict", "--model", &model, "--commands", text(&file)];
    refuse(
        &[&arguments[..], &["--out", "x.ply"]].concat(),
        1,
        "--out x.ply is named like a file; expected a .npz file, or a folder for a PLY file each",
    );
    refuse(
        &[&arguments[..], &["--payload", "0"]].concat(),
        2,
        "cannot be used with",
    );
    refuse(&["predict", "--model", &model], 2, "--command");
}

#[test]
fn what_lies_outside_the_training_range_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), &["--payload", "0.01:0.02"]);
    let out = folder.path().join("cloud.ply");
    let options = [
        "--command",
        "0.02,0.02,0.04,0.02,0.02,0.02",
        "--out",
        text(&out),
    ];
    let inside = predict(&model, &[&options[..], &["--payload", "0.015"]].concat());
    // No random command is at its very limit.
    let outside = inside["out_of_range"].as_array().unwrap();
    assert_eq!(outside.len(), 1, "{outside:?}");
    assert_eq!(
        (&outside[0]["index"], &outside[0]["value"]),
        (&2.into(), &0.04.into())
    );
    assert!(outside[0]["max"].as_f64().unwrap() < 0.04);
    let loaded = [
        "predict",
        "--model",
        &model,
        "--points",
        "50",
        "--payload",
        "0.05",
    ];
    let output = tdcr(&[&loaded[..], &options].concat()).output().unwrap();
    let said = stderr(&output);
    assert!(output.status.success());
    assert!(
        said.contains("the command: tendon 3 is 0.04 m, outside the training range 0."),
        "{said}"
    );
    assert!(
        said.contains("the payload is 0.05 kg, outside the training range 0 to 0.01"),
        "{said}"
    );
}

/// The `uncertainty` (m) of each point in the rows of a PLY file of predicted points.
fn uncertainties(ply: &[u8]) -> Vec<f32> {
    let end = b"property float uncertainty\nend_header\n";
    let body = ply.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    let rows = ply[body..].chunks_exact(19);
    rows.map(|row| f32::from_le_bytes(row[15..].try_into().unwrap()))
        .collect()
}

#[test]
fn files_say_how_uncertain_each_point_is() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), &[]);
    let file = |name: &str| folder.path().join(name);
    let predict = |name: &str, options: &[&str]| {
        let (out, command) = (file(name), ["--command", COMMAND, "--out"]);
        predict(&model, &[&command[..], &[text(&out)], options].concat())
    };
    let said = predict("cloud.ply", &[]);
    let mut values = uncertainties(&fs::read(file("cloud.ply")).unwrap());
    let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    assert_eq!(values.len(), 50);
    values.sort_by(f32::total_cmp);
    let median = 0.5 * (f64::from(values[24]) + f64::from(values[25]));
    let number = |key: &str| said["uncertainty"][key].as_f64().unwrap();
    assert!((number("median") - median).abs() < 1e-9 && median > 0.0);
    assert!((number("max") - f64::from(values[49])).abs() < 1e-9);
    let at = said["uncertainty"]["max_at"].as_array().unwrap();
    for axis in 0..3 {
        let [min, at, max] = [&said["min"], &said["uncertainty"]["max_at"], &said["max"]]
            .map(|corner| corner[axis].as_f64().unwrap());
        assert!(min <= at && at <= max);
    }
    assert_eq!(at.len(), 3);
    predict("cloud.npz", &[]);
    let archive = fs::read(file("cloud.npz")).unwrap();
    assert!(contains(&archive, b"uncertainty.npy") && contains(&archive, b"'shape': (50, )"));
    assert!(contains(&archive, &bytes));
    let more = predict("more.ply", &["--prior-samples", "3"]);
    assert_eq!(more["min"], said["min"]);
    assert_ne!(more["uncertainty"]["median"], said["uncertainty"]["median"]);
    let line = succeed(&[
        "predict",
        "--model",
        &model,
        "--command",
        COMMAND,
        "--points",
        "50",
        "--out",
        text(&file("cloud.ply")),
    ]);
    let expected = format!("uncertainty {:.2} mm (median)", 1e3 * median);
    assert!(line.contains(&expected), "{line}");
}

#[test]
fn archives_of_many_commands_hold_the_uncertainty_of_each() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), &[]);
    let file = |name: &str| folder.path().join(name);
    fs::write(file("commands.csv"), COMMANDS).unwrap();
    let commands = file("commands.csv");
    for out in ["all.npz", "clouds"] {
        let out = file(out);
        predict(
            &model,
            &["--commands", text(&commands), "--out", text(&out)],
        );
    }
    let archive = fs::read(file("all.npz")).unwrap();
    assert!(contains(&archive, b"'shape': (2, 50, )"));
    let clouds = ["clouds/cloud-00000.ply", "clouds/cloud-00001.ply"];
    let values = clouds.map(|cloud| uncertainties(&fs::read(file(cloud)).unwrap()));
    let bytes: Vec<u8> = (values.concat().iter())
        .flat_map(|x| x.to_le_bytes())
        .collect();
    assert!(contains(&archive, &bytes));
}

#[test]
fn predicted_files_are_read_back_whatever_else_they_hold() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), &[]);
    for name in ["cloud.ply", "cloud.npz"] {
        let out = folder.path().join(name);
        let said = predict(&model, &["--command", COMMAND, "--out", text(&out)]);
        let cloud = tdcr::learn::data::read_cloud(&out).unwrap();
        assert_eq!(cloud.len(), 50);
        for axis in 0..3 {
            let low = cloud
                .points
                .iter()
                .map(|p| p[axis])
                .fold(f32::MAX, f32::min);
            assert_eq!(
                f64::from(low) as f32,
                said["min"][axis].as_f64().unwrap() as f32
            );
        }
    }
}

#[test]
fn a_handful_of_points_is_predicted_without_uncertainty() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), &[]);
    let out = folder.path().join("cloud.ply");
    let options = ["--command", COMMAND, "--points", "15", "--out", text(&out)];
    let said = succeed_json(&[&["predict", "--model", &model], &options[..]].concat());
    assert!(said["uncertainty"].is_null());
    assert!(!contains(&fs::read(&out).unwrap(), b"uncertainty"));
}

#[test]
fn a_tolerance_lays_the_steps_of_a_prediction() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), &[]);
    let out = folder.path().join("cloud.ply");
    let files = ["--command", COMMAND, "--out", text(&out)];
    let evaluations = |options: &[&str]| {
        let predicted = predict(&model, &[&files, options].concat());
        predicted["evaluations"].as_u64().unwrap()
    };
    // Of a refined network, whose correction is the last one.
    assert_eq!(evaluations(&[]), 18);
    assert_eq!(evaluations(&["--sampler-denoise", "1"]), 16);
    let [coarse, fine] = ["1e-2", "1e-4"].map(|t| evaluations(&["--sampler-tolerance", t]));
    assert!((2..fine).contains(&coarse), "{coarse}, {fine}");
    let few = ["--sampler-tolerance", "1e-4", "--sampler-steps", "7"];
    assert_eq!(evaluations(&few), 9);

    let refused = |options: &[&str], code: i32, expected: &str| {
        let arguments = ["predict", "--model", &model];
        refuse(&[&arguments, &files[..], options].concat(), code, expected);
    };
    let heun = ["--sampler", "heun", "--sampler-tolerance", "0.01"];
    let expected = "sampler tolerance is 0.01, expected none with heun and euler";
    refused(&heun, 1, expected);
    refused(
        &["--sampler-tolerance", "0"],
        1,
        "sampler tolerance is 0, expected 1e-6 to 1",
    );
    refused(
        &["--sampler-denoise", "1.5"],
        1,
        "sampler denoising time is 1.5, expected 0 to below 1",
    );
    refused(
        &["--sampler-spare", "2"],
        1,
        "sampler spare points is 2, expected a share, 0 to 1",
    );
    let both = ["--sampler-tolerance", "0.01", "--sampler-power", "2"];
    refused(&both, 2, "cannot be used with");
}

#[test]
fn a_cloud_that_is_not_finite_is_refused_and_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let name = model(folder.path(), &[]);
    let mut model = Model::load(Path::new(&name)).unwrap();
    model.network.params_mut().fill(3e38);
    model.save(Path::new(&name)).unwrap();
    let said = "the network's cloud for the command [0.034, 0.007, 0.001, 0.026, 0.015, 0.019] is not finite";
    for out in ["cloud.ply", "cloud.npz"] {
        let out = folder.path().join(out);
        let arguments = [
            "predict",
            "--model",
            &name,
            "--command",
            COMMAND,
            "--out",
            text(&out),
        ];
        refuse(&arguments, 1, said);
        assert!(!out.exists());
    }
    let (commands, out) = (
        folder.path().join("commands.csv"),
        folder.path().join("many.npz"),
    );
    fs::write(&commands, COMMANDS).unwrap();
    let arguments = [
        "predict",
        "--model",
        &name,
        "--commands",
        text(&commands),
        "--out",
        text(&out),
    ];
    refuse(&arguments, 1, said);
    assert!(!out.exists());
    let data = folder.path().join("data");
    let sizes = ["--points", "300", "--emd-points", "100"];
    let arguments = ["eval", "--model", &name, "--data", text(&data)];
    refuse(&[&arguments[..], &sizes].concat(), 1, "is not finite");
}

/// The model's own cloud under a command is wanted: the command is found again, or one that looks the same.
#[test]
fn a_command_is_found_for_a_cloud() {
    let folder = tempfile::tempdir().unwrap();
    let set = folder.path().join("clouds");
    let options = ["--samples", "60", "--points", "300", "--out", text(&set)];
    succeed(&[&["collect"][..], &options].concat());
    let run = folder.path().join("fitted");
    let options = [
        "--width",
        "32",
        "--depth",
        "2",
        "--steps",
        "600",
        "--clouds",
        "4",
        "--points",
        "128",
        "--refinement-steps",
        "0",
    ];
    let train = ["train", "--data", text(&set), "--out", text(&run)];
    let trained = succeed_json(&[&train[..], &options].concat());
    let model = trained["model"].as_str().unwrap();
    let wanted = folder.path().join("wanted.ply");
    let command = "0.034,0.007,0.012,0.026,0.015,0.019";
    let predict = [
        "predict",
        "--model",
        model,
        "--command",
        command,
        "--points",
        "600",
    ];
    succeed(&[&predict[..], &["--seed", "3", "--out", text(&wanted)]].concat());

    let reach = [
        "reach",
        "--cloud",
        text(&wanted),
        "--model",
        model,
        "--points",
        "300",
    ];
    let found = succeed_json(&reach);
    let distances = found["distances"].as_array().unwrap();
    assert!(distances.len() <= 21);
    let first = distances[0].as_f64().unwrap();
    let last = found["mean_distance"].as_f64().unwrap();
    assert!(last < 0.6 * first, "{found}");
    assert!(
        distances
            .windows(2)
            .all(|two| two[1].as_f64() <= two[0].as_f64())
    );
    assert_eq!(found["out_of_range"], Value::Array(Vec::new()));
    assert_eq!(found["command"].as_array().unwrap().len(), 6);

    refuse(
        &[&reach[..], &["--tip", "0,0,0.3"]].concat(),
        2,
        "cannot be used with",
    );
    refuse(
        &[&reach[..], &["--start", "0.01"]].concat(),
        1,
        "--start has 1 numbers; expected 6",
    );
    refuse(
        &[&reach[..], &["--payload", "0.01"]].concat(),
        1,
        "trained without payloads",
    );
}
