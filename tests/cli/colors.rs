//! Colours on the whole road: learned, predicted, scored, and refused where there are none.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tdcr::learn::data::read_cloud;
use tdcr::sim::cloud::PointCloud;

use crate::{
    COMMAND, TINY_NETWORK, collect_small, refuse, stderr, succeed_json, tdcr, text, train_tiny,
};

const OTHER: &str = "0.02,0.02,0.02,0.02,0.02,0.02";

/// What a model predicts under [`COMMAND`], 300 points, in a file of this name.
fn predicted(model: &str, file: &Path) -> PointCloud {
    let how = ["--command", COMMAND, "--points", "300", "--out", text(file)];
    succeed_json(&[&["predict", "--model", model], &how[..]].concat());
    let cloud = read_cloud(file).unwrap();
    assert_eq!(cloud.len(), 300);
    cloud
}

fn distinct(cloud: &PointCloud) -> BTreeSet<[u8; 3]> {
    cloud.colors.iter().copied().collect()
}

fn scores(model: &str, data: &Path) -> Value {
    let points = ["--points", "400", "--emd-points", "100"];
    let scored = ["eval", "--model", model, "--data", text(data)];
    succeed_json(&[&scored[..], &points].concat())
}

#[test]
fn colours_are_learned_predicted_and_scored() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (data, cloud) = (path("data"), path("cloud.ply"));
    collect_small(&data, &[]);
    let plain = train_tiny(&data, &path("plain"), &[]);
    let plain = plain["model"].as_str().unwrap();
    assert_eq!(
        distinct(&predicted(plain, &cloud)).len(),
        1,
        "one colour stands for none"
    );
    assert_eq!(scores(plain, &data).get("color"), Some(&Value::Null));

    let colored = train_tiny(&data, &path("colored"), &["--colors"]);
    let colored = colored["model"].as_str().unwrap();
    assert!(distinct(&predicted(colored, &cloud)).len() > 100);
    let scored = scores(colored, &data);
    let error = scored["color"].as_f64().unwrap();
    assert!(error > 0.0 && error < 0.6, "{error}");
    assert!(scored["cd"].as_f64() > scored["cd_floor"].as_f64());

    // The run in a folder stays what it is.
    let (data, run) = (text(&data), path("plain"));
    let set = ["--data", data, "--out", text(&run)];
    let arguments = [&TINY_NETWORK[..], &set, &["--colors"]].concat();
    refuse(
        &arguments,
        1,
        r#"shape.channels was "xyz", expected "xyz-rgb""#,
    );
}

#[test]
fn a_stream_has_colours() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let stream = ["--stream", "2m", "--stream-points", "300", "--window", "4"];
    let how = ["--colors", "--out", text(&run)];
    let trained = succeed_json(&[&TINY_NETWORK[..], &stream, &how].concat());
    let cloud = folder.path().join("cloud.ply");
    let model = trained["model"].as_str().unwrap();
    assert!(distinct(&predicted(model, &cloud)).len() > 100);
}

#[test]
fn archives_hold_predicted_colours() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    collect_small(&path("data"), &[]);
    let model = |run: &str, options: &[&str]| {
        let trained = train_tiny(&path("data"), &path(run), options);
        trained["model"].as_str().unwrap().to_owned()
    };
    let (plain, colored) = (model("plain", &[]), model("colored", &["--colors"]));
    let archive = predicted(&colored, &path("cloud.npz"));
    assert!(archive == predicted(&colored, &path("cloud.ply")));
    let none = predicted(&plain, &path("plain.npz"));
    // Grey is what an archive without colours is read as.
    assert_eq!(distinct(&none), [[128; 3]].into());

    fs::write(path("commands.csv"), format!("{COMMAND}\n{OTHER}\n")).unwrap();
    let batch = |model: &str, out: &str| {
        let (commands, out) = (path("commands.csv"), path(out));
        let files = ["--commands", text(&commands), "--out", text(&out)];
        let how = ["predict", "--model", model, "--points", "300"];
        succeed_json(&[&how[..], &files].concat());
        out
    };
    let clouds = batch(&colored, "clouds");
    let cloud = |k: usize| read_cloud(&clouds.join(format!("cloud-{k:05}.ply"))).unwrap();
    let (first, second) = (cloud(0), cloud(1));
    assert!(first == archive && second.colors != first.colors);
    let all = fs::read(batch(&colored, "all.npz")).unwrap();
    let header = b"{'descr': '|u1', 'fortran_order': False, 'shape': (2, 300, 3, ), }";
    assert_eq!(places(&all, header), 1);
    let colors = [first.colors, second.colors].concat();
    assert_eq!(places(&all, colors.as_flattened()), 1);
    let without = fs::read(batch(&plain, "plain-all.npz")).unwrap();
    assert_eq!(
        (places(&all, b"rgb.npy"), places(&without, b"rgb.npy")),
        (2, 0)
    );
}

/// How often `needle` stands in `bytes`.
fn places(bytes: &[u8], needle: &[u8]) -> usize {
    let windows = bytes.windows(needle.len());
    windows.filter(|window| *window == needle).count()
}

/// Imports ten clouds of two motors into the folder `name`, their points with these properties after x, y, z, and values
/// of them.
fn import(folder: &Path, name: &str, properties: &str, values: fn(u32) -> String) -> PathBuf {
    let clouds = folder.join(format!("{name}-clouds"));
    fs::create_dir(&clouds).unwrap();
    for k in 0..10 {
        let vertex = |i: u32| format!("0.0{k} {} 0.2{}\n", 1e-3 * f64::from(i), values(i));
        let vertices: String = (0..300).map(vertex).collect();
        let axes = "property float x\nproperty float y\nproperty float z\n";
        let head = format!("ply\nformat ascii 1.0\nelement vertex 300\n{axes}{properties}");
        let file = head + "end_header\n" + &vertices;
        fs::write(clouds.join(format!("{k}.ply")), file).unwrap();
        let motors = format!("{{\"ctrl\": [0.0{k}, 0.01]}}");
        fs::write(clouds.join(format!("{k}.json")), motors).unwrap();
    }
    let data = folder.join(name);
    let into = ["--out", text(&data), "--points", "300"];
    succeed_json(&[&["data", "import", text(&clouds)], &into[..]].concat());
    data
}

#[test]
fn clouds_that_were_imported_without_colours_have_none_to_learn_or_to_score() {
    let folder = tempfile::tempdir().unwrap();
    let grey = import(folder.path(), "grey", "", |_| String::new());
    let run = |name: &str| folder.path().join(name);
    train_tiny(&grey, &run("plain"), &[]);
    let refused = run("refused");
    let set = ["--data", text(&grey), "--out", text(&refused), "--colors"];
    let expected = "training set: all points have the colour [128, 128, 128], expected several";
    refuse(&[&TINY_NETWORK[..], &set].concat(), 1, expected);

    let channels = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let red = import(folder.path(), "red", channels, |i| {
        format!(" {} 0 0", i % 256)
    });
    let trained = train_tiny(&red, &run("colored"), &["--colors"]);
    let model = trained["model"].as_str().unwrap();
    let scored = |data: &Path| {
        let points = ["--points", "200", "--emd-points", "50"];
        let files = ["--model", model, "--data", text(data), "--json"];
        let output = tdcr(&[&["eval"], &files[..], &points].concat()).output();
        let output = output.unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        let scores: Value = serde_json::from_slice(&output.stdout).unwrap();
        (scores["color"].as_f64(), stderr(&output))
    };
    let unscored = "the predicted colours are not scored";
    let (error, said) = scored(&red);
    assert!(error.is_some_and(|error| error > 0.0) && !said.contains(unscored));
    let (error, said) = scored(&grey);
    assert_eq!(error, None);
    assert!(
        said.contains(unscored) && said.contains(text(&grey)),
        "{said}"
    );
}

#[test]
fn the_weight_of_colours_is_asked_for_with_them_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    collect_small(&data, &[]);
    train_tiny(&data, &run, &["--colors", "--color-weight", "0.2"]);
    let refused = |out: &Path, options: &[&str], code: i32, expected: &str| {
        let set = ["--data", text(&data), "--out", text(out)];
        let arguments = [&TINY_NETWORK[..], &set, options].concat();
        refuse(&arguments, code, expected);
    };
    let kept = "settings.color_weight was 0.2, expected 0.05";
    refused(&run, &["--colors"], 1, kept);
    let other = folder.path().join("other");
    let none = ["--colors", "--color-weight", "0"];
    let expected = "color_weight is 0, expected a positive number";
    refused(&other, &none, 1, expected);
    refused(&other, &["--color-weight", "0.2"], 2, "--colors");
}
