//! Colours on the whole road: learned, predicted, scored, and refused where there are none.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::{TINY_NETWORK, collect_small, refuse, succeed_json, text, train_tiny};

const COMMAND: &str = "0.034,0.007,0.001,0.026,0.015,0.019";

/// The colours that a model predicts under [`COMMAND`], of 300 points.
fn predicted(model: &str, cloud: &Path) -> BTreeSet<[u8; 3]> {
    let how = [
        "--command",
        COMMAND,
        "--points",
        "300",
        "--out",
        text(cloud),
    ];
    succeed_json(&[&["predict", "--model", model], &how[..]].concat());
    let ply = fs::read(cloud).unwrap();
    let head = b"end_header\n";
    let start = ply.windows(head.len()).position(|w| w == head).unwrap() + head.len();
    // Three floats, then three bytes.
    let rows = ply[start..].as_chunks::<15>().0;
    assert_eq!(rows.len(), 300);
    rows.iter().map(|row| [row[12], row[13], row[14]]).collect()
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
        predicted(plain, &cloud).len(),
        1,
        "one colour stands for none"
    );
    assert!(scores(plain, &data).get("color").is_none());

    let colored = train_tiny(&data, &path("colored"), &["--colors"]);
    let colored = colored["model"].as_str().unwrap();
    assert!(predicted(colored, &cloud).len() > 100);
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
    assert!(predicted(trained["model"].as_str().unwrap(), &cloud).len() > 100);
}

#[test]
fn clouds_that_were_imported_without_colours_have_none_to_learn() {
    let folder = tempfile::tempdir().unwrap();
    let (clouds, data) = (folder.path().join("clouds"), folder.path().join("data"));
    fs::create_dir(&clouds).unwrap();
    for k in 0..10 {
        let vertices: String = (0..300)
            .map(|i| format!("0.0{k} {} 0.2\n", 1e-3 * f64::from(i)))
            .collect();
        let axes = "property float x\nproperty float y\nproperty float z\n";
        let head = format!("ply\nformat ascii 1.0\nelement vertex 300\n{axes}end_header\n");
        fs::write(clouds.join(format!("{k}.ply")), head + &vertices).unwrap();
        let motors = format!("{{\"ctrl\": [0.0{k}, 0.01]}}");
        fs::write(clouds.join(format!("{k}.json")), motors).unwrap();
    }
    let into = ["--out", text(&data), "--points", "300"];
    succeed_json(&[&["data", "import", text(&clouds)], &into[..]].concat());
    let run = folder.path().join("run");
    train_tiny(&data, &run, &[]);
    let colored = folder.path().join("colored");
    let set = ["--data", text(&data), "--out", text(&colored), "--colors"];
    let expected = "training set: all points have the colour [128, 128, 128], expected several";
    refuse(&[&TINY_NETWORK[..], &set].concat(), 1, expected);
}
