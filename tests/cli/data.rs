//! Data sets looked at, checked, and moved.

use std::fs;
use std::path::Path;

use crate::{collect_small, refuse, succeed, succeed_json, text};

/// Arguments that import clouds of four points from a folder, with more options.
fn import_small<'a>(clouds: &'a Path, out: &'a Path, options: &[&'a str]) -> Vec<&'a str> {
    let what = ["data", "import", text(clouds), "--points", "4"];
    [&what[..], &["--out", text(out)], options].concat()
}

#[test]
fn a_data_set_is_described_drawn_and_found_good() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("loaded");
    collect_small(&data, &["--base", "--payload", "0:0.03"]);
    let info = &succeed_json(&["data", "info", text(&data)])[0];
    assert_eq!(
        [&info["train"], &info["val"], &info["test"], &info["points"]],
        [16, 2, 2, 400]
    );
    assert_eq!(
        (&info["robot"], &info["base"]),
        (&"2m".into(), &true.into())
    );
    assert_eq!(info["motors"].as_array().unwrap().len(), 6);
    assert!(info["payload"]["range"][1].as_f64().unwrap() <= 0.0301);
    assert!(succeed(&["data", "check", text(&data)]).contains("loaded: good"));

    let page = folder.path().join("page.html");
    succeed(&[
        "data",
        "view",
        text(&data),
        text(&data),
        "--out",
        text(&page),
    ]);
    let page = fs::read_to_string(&page).unwrap();
    assert_eq!(page.matches("loaded, 20 tips").count(), 2);
    assert_eq!(page.matches("motor 6</text>").count(), 2);
    assert!(page.contains("payload (kg)") && page.contains("data:image/png;base64,"));
    // Packed pictures have any letters.
    let words: String = page
        .split("base64,")
        .enumerate()
        .filter_map(|(i, part)| {
            if i == 0 {
                Some(part)
            } else {
                part.split_once('"').map(|(_, words)| words)
            }
        })
        .collect();
    assert!(words.contains("payload (kg)") && !words.contains("NaN") && !words.contains("{{"));
    let sheet = folder.path().join("sheet.png");
    succeed(&["data", "view", text(&data), "--out", text(&sheet)]);
    assert!(fs::read(&sheet).unwrap().starts_with(b"\x89PNG"));
    let both = [
        "data",
        "view",
        text(&data),
        text(&data),
        "--out",
        text(&sheet),
    ];
    refuse(&both, 1, "a .png shows the clouds of one data set");
    let none = ["data", "view", text(&data), "--out", "clouds.txt"];
    refuse(&none, 1, "none of the extensions .html, .svg and .png");

    // A split that knows what another asks.
    fs::copy(
        data.join("val/shard-00000.h5"),
        data.join("test/shard-00000.h5"),
    )
    .unwrap();
    let output = crate::tdcr(&["data", "check", text(&data)])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        said.contains("sample 0 of test has the condition of sample 0 of val"),
        "{said}"
    );
}

#[test]
fn clouds_in_millimetres_are_warned_of_and_imported_with_their_unit() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let clouds = path("clouds");
    fs::create_dir(&clouds).unwrap();
    for k in 0..10 {
        let ply = format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
             end_header\n{} 0 0\n",
            330 + k
        );
        fs::write(clouds.join(format!("{k}.ply")), ply).unwrap();
        fs::write(
            clouds.join(format!("{k}.json")),
            format!("{{\"ctrl\": [{k}]}}"),
        )
        .unwrap();
    }
    let import = |out: &str, units: &[&str]| {
        let out = path(out);
        let output = crate::tdcr(&import_small(&clouds, &out, units)).output();
        let output = output.unwrap();
        assert!(output.status.success());
        (out, crate::stderr(&output))
    };
    let (metres, said) = import("metres", &[]);
    assert!(
        said.contains("import: 10 steps") && said.contains("import: done"),
        "{said}"
    );
    assert!(
        said.contains("the farthest point is 339.0000 m from the origin, expected 0.002 to 20 m"),
        "{said}"
    );
    assert!(said.contains("--units mm"), "{said}");
    let output = crate::tdcr(&["data", "check", text(&metres)])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stdout).contains("the farthest point is 339.0000 m"));
    let (millimetres, said) = import("millimetres", &["--units", "mm"]);
    assert!(!said.contains("farthest"), "{said}");
    assert!(succeed(&["data", "check", text(&millimetres)]).contains("millimetres: good"));
    let info = &succeed_json(&["data", "info", text(&millimetres)])[0];
    assert!((info["scale"].as_f64().unwrap() - 0.339).abs() < 1e-6);
    assert!(
        info["origin"]
            .as_str()
            .unwrap()
            .contains("10 clouds in millimetres from")
    );
    // A data set that was begun in one unit is not gone on with in another.
    refuse(
        &import_small(&clouds, &metres, &["--units", "mm"]),
        1,
        "origin.imported.source",
    );
}

#[test]
fn a_network_trains_on_imported_clouds() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (data, out, again) = (path("data"), path("out"), path("again"));
    collect_small(&data, &[]);
    let export = [
        "data",
        "export",
        text(&data),
        "--format",
        "ply",
        "--out",
        text(&out),
    ];
    assert_eq!(succeed_json(&export)["clouds"], 20);
    let train = out.join("train");
    let import = [
        "data",
        "import",
        text(&train),
        "--out",
        text(&again),
        "--points",
        "300",
    ];
    assert_eq!(succeed_json(&import)["clouds"], 16);
    let trained = crate::train_tiny(&again, &path("run"), &[]);
    assert!(trained["validation_cd"].as_f64().unwrap() > 0.0);
    let info = &succeed_json(&["data", "info", text(&again)])[0];
    assert!(info["robot"].is_null());
    succeed(&[
        "data",
        "view",
        text(&again),
        "--out",
        text(&path("page.html")),
    ]);
    let model = trained["model"].as_str().unwrap();
    // The clouds have 300 points: fewer than usual are compared, and that is said.
    let scored = ["eval", "--model", model, "--data", text(&again)];
    let output = crate::tdcr(&[&scored[..], &["--json"]].concat())
        .output()
        .unwrap();
    let said = crate::stderr(&output);
    assert!(
        said.contains("Chamfer distances are on 300 points, not on 10000"),
        "{said}"
    );
    assert!(
        said.contains("earth mover's distances are on 300 points, not on 2000"),
        "{said}"
    );
    let scores: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(scores["cd"].as_f64().unwrap() > 0.0 && scores["cd_floor"].is_null());
    assert_eq!(
        (&scores["points"], &scores["emd_points"]),
        (&300.into(), &300.into())
    );
    let with = |options: &[&'static str]| [&scored[..], options].concat();
    let fewer = succeed_json(&with(&["--points", "100"]));
    assert_eq!(
        (&fewer["points"], &fewer["emd_points"]),
        (&100.into(), &100.into())
    );
    for (options, expected) in [
        (
            &["--points", "301"][..],
            "--points is 301; expected 1 to 300",
        ),
        (
            &["--points", "100", "--emd-points", "101"],
            "--emd-points is 101; expected 1 to 100",
        ),
        (
            &["--emd-points", "0"],
            "--emd-points is 0; expected 1 to 300",
        ),
    ] {
        refuse(&with(options), 1, expected);
    }
}
