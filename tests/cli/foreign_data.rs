//! Other people's clouds: predictions that are scored, splits that are given, training on in the units of a model.

use std::fs;
use std::path::Path;

use serde_json::Value;
use tdcr::learn::data::{DataSet, NpzArray, NpzValues, Sample, Split, write_npz};

use crate::{
    TINY_NETWORK, collect_small, refuse, stderr, succeed, succeed_json, tdcr, text, train_tiny,
};

const POINTS: [&str; 4] = ["--points", "400", "--emd-points", "100"];

/// Writes clouds and commands as an archive of predictions.
fn write_predictions(path: &Path, samples: &[Sample]) {
    let points: Vec<[f32; 3]> = samples
        .iter()
        .flat_map(|s| s.cloud.points.clone())
        .collect();
    let commands: Vec<f32> = samples.iter().flat_map(|s| s.condition.values()).collect();
    let shape = [samples.len(), points.len() / samples.len(), 3];
    let of_commands = [samples.len(), commands.len() / samples.len()];
    let arrays = [
        NpzArray {
            name: "points",
            shape: &shape,
            values: NpzValues::Floats(points.as_flattened()),
        },
        NpzArray {
            name: "commands",
            shape: &of_commands,
            values: NpzValues::Floats(&commands),
        },
    ];
    write_npz(path, &arrays).unwrap();
}

fn eval<'a>(clouds: &'a Path, data: &'a Path) -> Vec<&'a str> {
    let files = ["--predictions", text(clouds), "--data", text(data)];
    [&["eval"], &files[..], &POINTS].concat()
}

#[test]
fn anyones_clouds_are_scored_with_the_table_of_a_networks() {
    let folder = tempfile::tempdir().unwrap();
    let [data, run, csv, clouds] =
        ["data", "run", "commands.csv", "clouds.npz"].map(|name| folder.path().join(name));
    let size = ["collect", "--samples", "40", "--points", "400"];
    succeed_json(&[&size[..], &["--out", text(&data)]].concat());
    let trained = train_tiny(&data, &run, &[]);
    let model = trained["model"].as_str().unwrap();
    let of_network = [
        &["eval", "--model", model, "--data", text(&data)],
        &POINTS[..],
    ]
    .concat();
    let network = succeed_json(&[&of_network[..], &["--worst", "9"]].concat());
    let mut tests: Vec<&Value> = network["worst"].as_array().unwrap().iter().collect();
    tests.sort_by_key(|test| test["test"].as_u64());
    let line = |test: &&Value| {
        let values = test["command"].as_array().unwrap().iter();
        values.map(Value::to_string).collect::<Vec<_>>().join(",")
    };
    fs::write(&csv, tests.iter().map(line).collect::<Vec<_>>().join("\n")).unwrap();
    let files = ["--commands", text(&csv), "--out", text(&clouds)];
    let predict = ["predict", "--model", model, "--points", "400"];
    succeed_json(&[&predict[..], &files].concat());

    let scored = succeed_json(&[&eval(&clouds, &data)[..], &["--worst", "9"]].concat());
    for key in [
        "cd_nearest",
        "cd_mean",
        "cd_floor",
        "cd_perfect",
        "cd_perfect_selected",
        "emd_floor",
        "tests",
        "true_points",
        "distinct_true_points",
    ] {
        assert_eq!(scored[key], network[key], "{key}");
    }
    for key in ["evaluations", "precision", "training_precision"] {
        assert!(scored[key].is_null(), "{key}");
    }
    // All clouds have the noise of seed 0, which `eval` gives to the first alone.
    let of_first = |scores: &Value| {
        let worst = scores["worst"].as_array().unwrap().iter();
        let mut first = worst.filter(|test| test["test"] == 0);
        first.next().unwrap()["cd"].as_f64().unwrap()
    };
    assert!((of_first(&scored) / of_first(&network) - 1.0).abs() < 1e-3);
    assert!(scored["cd"].as_f64().unwrap() > scored["cd_floor"].as_f64().unwrap());

    let page = folder.path().join("scores.html");
    let shown = ["--quiet", "--report", text(&page)];
    let table = succeed(&[&eval(&clouds, &data)[..], &shown].concat());
    assert!(
        table.starts_with("  ") && table.contains("\npredictions "),
        "{table}"
    );
    assert!(!table.contains("evaluations of the network"), "{table}");
    let page = fs::read_to_string(&page).unwrap();
    assert!(page.contains("clouds.npz") && !page.contains("Sampler"));
}

#[test]
fn clouds_that_are_not_of_the_test_commands_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [data, clouds] = ["data", "clouds.npz"].map(|name| folder.path().join(name));
    collect_small(&data, &[]);
    let truth = DataSet::open(&data)
        .unwrap()
        .read_split(Split::Test)
        .unwrap();
    // The true clouds themselves are no worse than the floor: nothing is between them and the truth.
    write_predictions(&clouds, &truth);
    assert_eq!(succeed_json(&eval(&clouds, &data))["cd"], 0.0);

    let refused = |samples: &[Sample], expected: &str| {
        write_predictions(&clouds, samples);
        refuse(&eval(&clouds, &data), 1, expected);
    };
    let [first, second] = [0, 1].map(|k| truth[k].clone());
    refused(
        &truth[..1],
        "1 predicted clouds, expected 2, one for each test command",
    );
    refused(
        &[second, first.clone()],
        "predicted cloud 0 is of the command [",
    );
    let cut = |sample: &Sample| {
        let mut sample = sample.clone();
        sample.cloud.points.truncate(399);
        sample
    };
    let few: Vec<Sample> = truth.iter().map(cut).collect();
    refused(&few, "--points is 400; expected 1 to 399");
    let mut broken = truth.clone();
    broken[1].cloud.points[7][2] = f32::NAN;
    refused(
        &broken,
        "clouds.npz: array `points`: point 7 of cloud 1 is not finite",
    );
    let other = [first.condition.motors, vec![0.0]].concat();
    let mut longer = truth.clone();
    longer
        .iter_mut()
        .for_each(|s| s.condition.motors.clone_from(&other));
    refused(&longer, "the command has 7 values, expected 6");
    let flat = [NpzArray {
        name: "points",
        shape: &[2, 3],
        values: NpzValues::Floats(&[0.0; 6]),
    }];
    write_npz(&clouds, &flat).unwrap();
    refuse(
        &eval(&clouds, &data),
        1,
        "array `points`: shape [2, 3], expected (T, N, 3)",
    );
    let of_model = [&eval(&clouds, &data)[..], &["--sampler-steps", "4"]].concat();
    refuse(&of_model, 1, "are of a model; clouds are scored");
}

#[test]
fn an_import_takes_a_given_split() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (data, out, set, csv) = (path("data"), path("out"), path("set"), path("split.csv"));
    collect_small(&data, &[]);
    let export = ["data", "export", text(&data), "--format", "npz"];
    succeed_json(&[&export[..], &["--out", text(&out)]].concat());
    let train = out.join("train");
    let split = |k: usize| match k {
        3 | 5 | 15 => "test",
        0 => "val",
        _ => "train",
    };
    let lines: String = (0..16)
        .map(|k| format!("cloud-{k:05},{}\n", split(k)))
        .collect();
    fs::write(&csv, &lines).unwrap();
    let options = [
        "--out",
        text(&set),
        "--points",
        "300",
        "--split",
        text(&csv),
    ];
    let import = [&["data", "import", text(&train)], &options[..]].concat();
    assert_eq!(succeed_json(&import)["clouds"], 16);
    let original = DataSet::open(&data)
        .unwrap()
        .read_split(Split::Train)
        .unwrap();
    let found = DataSet::open(&set).unwrap();
    for kind in Split::ALL {
        let expected = (0..16).filter(|&k| split(k) == kind.folder());
        let expected: Vec<_> = expected.map(|k| original[k].condition.clone()).collect();
        assert_eq!(found.conditions(kind).unwrap(), expected);
    }
    assert!(succeed(&["data", "check", text(&set)]).contains("good"));
    train_tiny(&set, &path("run"), &["--points", "300"]);
    // Another split makes another set; a cloud in no split is named.
    fs::write(&csv, lines.replace("cloud-00001,train", "cloud-00001,val")).unwrap();
    refuse(&import, 1, "its `origin.imported.split.");
    fs::write(&csv, lines.replace("cloud-00001,train\n", "")).unwrap();
    refuse(
        &import,
        1,
        "split.csv: file: no line for cloud `cloud-00001.npz`",
    );
}

#[test]
fn a_run_goes_on_from_a_model_on_other_data_in_the_models_units() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (simulated, recorded) = (path("simulated"), path("recorded"));
    collect_small(&simulated, &[]);
    collect_small(&recorded, &["--seed", "1"]);
    // Imported clouds have no symmetries that are known.
    train_tiny(&simulated, &path("first"), &["--symmetry", "none"]);
    let model = path("first").join("model.safetensors");
    let init = ["--init", text(&model)];
    let out = path("second");
    let places = ["--data", text(&recorded), "--out", text(&out)];
    let without = [&TINY_NETWORK[..], &places, &init].concat();
    refuse(&without, 1, "its normalisation.motor_m");
    let units = ["--normalisation-from", text(&model)];
    let arguments = [&without[..], &units].concat();
    succeed_json(&arguments);
    let normalisation = |run: &Path| {
        let file = fs::read(run.join("model.safetensors")).unwrap();
        let header = String::from_utf8_lossy(&file).into_owned();
        let (_, rest) = header.split_once(r#"\"normalisation\":{"#).unwrap();
        rest.split_once('}').unwrap().0.to_owned()
    };
    assert_eq!(normalisation(&out), normalisation(&path("first")));
    // It ends as it would have where it is interrupted, and is another run in units of its own.
    assert_eq!(succeed_json(&arguments)["steps"], 40);
    refuse(
        &[&TINY_NETWORK[..], &places].concat(),
        1,
        "cannot be resumed",
    );
    let stream = [&TINY_NETWORK[..], &["--stream", "2m"], &units].concat();
    refuse(&stream, 2, "cannot be used with");

    // Commands in another unit are no mistake that can be seen for sure, but are said.
    let ticks = path("ticks");
    fs::create_dir(&ticks).unwrap();
    let samples = DataSet::open(&recorded)
        .unwrap()
        .read_split(Split::Train)
        .unwrap();
    for (k, sample) in samples.iter().enumerate() {
        let ctrl: Vec<f32> = sample.condition.motors.iter().map(|m| 1e4 * m).collect();
        let json = serde_json::json!({ "ctrl": ctrl }).to_string();
        fs::write(ticks.join(format!("{k:02}.json")), json).unwrap();
        let points = NpzArray {
            name: "points",
            shape: &[400, 3],
            values: NpzValues::Floats(sample.cloud.points.as_flattened()),
        };
        write_npz(&ticks.join(format!("{k:02}.npz")), &[points]).unwrap();
    }
    let set = path("set");
    succeed(&[
        "data",
        "import",
        text(&ticks),
        "--out",
        text(&set),
        "--points",
        "400",
    ]);
    let third = path("third");
    let places = ["--data", text(&set), "--out", text(&third)];
    let output = tdcr(&[&TINY_NETWORK[..], &places, &init, &units].concat())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let warned = "the largest value of motor 1 in ";
    assert!(stderr(&output).contains(warned), "{}", stderr(&output));
}
