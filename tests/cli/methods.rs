//! Several methods beside each other: `tdcr eval` with files of predictions and models.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tdcr::learn::data::{DataSet, NpzArray, NpzValues, Sample, Split, write_npz};

use crate::{collect_small, refuse, succeed, succeed_json, text, train_tiny};

const POINTS: [&str; 4] = ["--points", "400", "--emd-points", "100"];

/// What a file says of its method beside its clouds.
#[derive(Clone, Copy, Default)]
struct Said<'a> {
    method: Option<&'a str>,
    training: Option<f32>,
    prediction: Option<f32>,
}

/// Writes the true clouds, moved along x by `shift` (m), as somebody's predictions.
fn write_shifted(path: &Path, samples: &[Sample], shift: f32, said: Said<'_>) {
    let points: Vec<[f32; 3]> = (samples.iter().flat_map(|sample| &sample.cloud.points))
        .map(|&[x, y, z]| [x + shift, y, z])
        .collect();
    let commands: Vec<f32> = samples.iter().flat_map(|s| s.condition.values()).collect();
    let count = samples.len();
    let shapes = [
        vec![count, points.len() / count, 3],
        vec![count, commands.len() / count],
    ];
    let mut arrays = vec![
        NpzArray {
            name: "points",
            shape: &shapes[0],
            values: NpzValues::Floats(points.as_flattened()),
        },
        NpzArray {
            name: "commands",
            shape: &shapes[1],
            values: NpzValues::Floats(&commands),
        },
    ];
    let times = [said.training, said.prediction].map(|time| time.map(|seconds| [seconds]));
    let names = ["training_seconds", "prediction_seconds"];
    for (name, time) in names.into_iter().zip(&times) {
        if let Some(seconds) = time {
            let values = NpzValues::Floats(seconds);
            let shape = &[];
            arrays.push(NpzArray {
                name,
                shape,
                values,
            });
        }
    }
    if let Some(method) = said.method {
        arrays.push(NpzArray {
            name: "method",
            shape: &[],
            values: NpzValues::Text(method),
        });
    }
    write_npz(path, &arrays).unwrap();
}

/// A small data set, its test samples, and files of predictions: one that says its method and times, one that does not.
fn somebodys(folder: &Path) -> (PathBuf, Vec<Sample>, [PathBuf; 2]) {
    let data = folder.join("data");
    collect_small(&data, &[]);
    let truth = DataSet::open(&data)
        .unwrap()
        .read_split(Split::Test)
        .unwrap();
    let files = ["a.npz", "guess.npz"].map(|name| folder.join(name));
    let said = Said {
        method: Some("größer"),
        training: Some(321.0),
        prediction: Some(0.0625),
    };
    write_shifted(&files[0], &truth, 0.004, said);
    write_shifted(&files[1], &truth, 0.001, Said::default());
    (data, truth, files)
}

fn eval<'a>(files: &[&'a Path], data: &'a Path) -> Vec<&'a str> {
    let files = files.iter().flat_map(|file| ["--predictions", text(file)]);
    let fixed = ["eval", "--data", text(data)].into_iter().chain(POINTS);
    fixed.chain(files).collect()
}

fn row<'a>(scores: &'a Value, key: &str) -> &'a Value {
    let mut rows = scores["methods"].as_array().unwrap().iter();
    rows.find(|row| row["key"] == key).unwrap()
}

#[test]
fn methods_are_scored_beside_each_other_as_each_is_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (data, _, [a, guess]) = somebodys(folder.path());
    let model = train_tiny(&data, &folder.path().join("run"), &[]);
    let model = model["model"].as_str().unwrap();
    let together = [&eval(&[&a, &guess], &data)[..], &["--model", model]].concat();
    let scores = succeed_json(&together);
    let keys: Vec<&str> = (scores["methods"].as_array().unwrap().iter())
        .map(|row| row["key"].as_str().unwrap())
        .collect();
    let expected = [
        "network",
        "größer",
        "guess",
        "nearest",
        "mean",
        "perfect",
        "perfect-selected",
        "floor",
    ];
    assert_eq!(keys, expected);
    for (file, key) in [(&a, "größer"), (&guess, "guess")] {
        let alone = succeed_json(&eval(&[file], &data));
        assert_eq!(alone.get("methods"), None);
        for score in ["cd", "emd", "emd_squared", "tip"] {
            assert_eq!(row(&scores, key)[score], alone[score], "{key} {score}");
        }
        let quantiles = &row(&scores, key)["quantiles"];
        assert_eq!(quantiles, &alone["network_quantiles"]);
        assert_eq!(row(&scores, key)["worst"], alone["worst"]);
        for score in ["cd_nearest", "cd_mean", "cd_floor"] {
            assert_eq!(scores[score], alone[score], "{score}");
        }
    }
    let network = row(&scores, "network");
    assert_eq!(network["cd"], scores["cd"]);
    assert!(network["prediction_seconds"].as_f64().unwrap() > 0.0);
    assert!(network["training_seconds"].is_null());
    let (said, silent) = (row(&scores, "größer"), row(&scores, "guess"));
    let times =
        |row: &Value| ["training_seconds", "prediction_seconds"].map(|key| row[key].as_f64());
    assert_eq!(times(said), [Some(321.0), Some(0.0625)]);
    assert_eq!(times(silent), [None, None]);
    let floor = row(&scores, "floor");
    let [cd, of_floor] = [said, floor].map(|row| row["cd"].as_f64().unwrap());
    assert_eq!(said["cd_over_floor"].as_f64(), Some(cd / of_floor));
    // Both clouds are the true ones, one of them moved four times as far.
    assert!(silent["cd"].as_f64() < said["cd"].as_f64());
    // The best test is the one with the least distance.
    let least = said["quantiles"]["cd"]["min"].as_f64();
    assert_eq!(said["best"]["cd"].as_f64(), least);
    assert!(floor["best"].is_null() && floor["quantiles"].is_null());
}

#[test]
fn one_table_page_and_picture_show_all_methods() {
    let folder = tempfile::tempdir().unwrap();
    let (data, _, [a, guess]) = somebodys(folder.path());
    let [page, png, svg] = ["page.html", "sheet.png", "curves.svg"].map(|n| folder.path().join(n));
    let shown = ["--quiet", "--worst", "1", "--report", text(&page)];
    let drawn = ["--picture", text(&png)];
    let table = succeed(&[&eval(&[&a, &guess], &data)[..], &shown, &drawn].concat());
    let heading = table.lines().next().unwrap();
    for column in [
        "CD (1e-4 m²)",
        "CD / floor",
        "EMD (mm)",
        "sq. EMD (1e-4 m²)",
        "training (CPU s)",
        "prediction (ms)",
    ] {
        assert!(heading.contains(column), "{heading}");
    }
    let cells = |name: &str| -> Vec<&str> {
        let line = table.lines().find(|line| line.starts_with(name)).unwrap();
        assert_eq!(line.chars().count(), heading.chars().count(), "{line}");
        line[name.len()..].split_whitespace().collect()
    };
    assert_eq!(cells("größer")[4..], ["321", "62.5"]);
    assert_eq!(cells("guess")[4..], ["-", "-"]);
    assert_eq!(cells("nearest training command")[4..], ["-", "-"]);
    assert_eq!(cells("sampling floor")[1], "1.0");
    assert_eq!(table.matches("best: test").count(), 2);
    assert_eq!(table.matches("worst: test").count(), 2);

    let page = fs::read_to_string(&page).unwrap();
    for expected in [
        "<h3>größer, best: test",
        "<h3>größer, worst: test",
        "<h3>guess, best: test",
        "<h3>guess, worst: test",
        "<td>321</td><td>62.5</td>",
        "<td>–</td><td>–</td>",
        "Of 2 methods, guess is the nearest",
        "a.npz",
        ">Größer</text>",
    ] {
        assert!(page.contains(expected), "{expected}");
    }
    assert_eq!(fs::read(&png).unwrap()[..4], *b"\x89PNG");
    let curves = [&eval(&[&a, &guess], &data)[..], &["--picture", text(&svg)]].concat();
    succeed(&curves);
    let svg = fs::read_to_string(&svg).unwrap();
    for name in [
        "größer",
        "guess",
        "nearest training command",
        "sampling floor",
    ] {
        assert!(svg.contains(&format!(">{name}</text>")), "{name}");
    }
}

#[test]
fn methods_that_do_not_fit_together_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let (data, truth, [a, guess]) = somebodys(folder.path());
    let other = folder.path().join("other.npz");
    let refused = |expected: &str| refuse(&eval(&[&a, &guess, &other], &data), 1, expected);
    let name = |method: &'static str| Said {
        method: Some(method),
        ..Said::default()
    };
    write_shifted(&other, &truth[..1], 0.0, Said::default());
    refused("other.npz: 1 predicted clouds, expected 2, one for each test command");
    let turned: Vec<Sample> = truth.iter().rev().cloned().collect();
    write_shifted(&other, &turned, 0.0, Said::default());
    refused("other.npz: predicted cloud 0 is of the command [");
    write_shifted(&other, &truth, 0.0, name("größer"));
    refused("other.npz: two predictors have the key `größer`");
    write_shifted(&other, &truth, 0.0, name("floor"));
    refused("other.npz: two predictors have the key `floor`");
    write_shifted(&other, &truth, 0.0, name("nearest"));
    refused("other.npz: two predictors have the key `nearest`");
    let mut few = truth.clone();
    for sample in &mut few {
        sample.cloud.points.truncate(399);
    }
    write_shifted(&other, &few, 0.0, Said::default());
    refused("other.npz: --points is 400; expected 1 to 399");
    write_shifted(&other, &truth, 0.0, name(" "));
    refused("other.npz: array `method`, data: \" \", expected a name of 1 to 60");
    let said = Said {
        training: Some(-1.0),
        ..Said::default()
    };
    write_shifted(&other, &truth, 0.0, said);
    refused("other.npz: array `training_seconds`, data: -1, expected a finite number of seconds");
    // What one may do with files of different sizes is to compare as many points as all have.
    write_shifted(&other, &few, 0.0, Said::default());
    let files = ["--predictions", text(&other), "--predictions", text(&a)];
    let usual = [
        &["eval", "--data", text(&data), "--emd-points", "50"],
        &files[..],
    ]
    .concat();
    assert_eq!(succeed_json(&usual)["points"], 399);
}
