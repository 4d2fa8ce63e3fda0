//! `tdcr compare`.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::{refuse, succeed, succeed_json, text};

/// A small data set in `folder`.
fn collected(folder: &Path, name: &str, points: &str, options: &[&str]) -> PathBuf {
    let data = folder.join(name);
    let collect = ["collect", "--points", points, "--out", text(&data)];
    succeed(&[&collect, options].concat());
    data
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[test]
fn configurations_in_common_are_compared_in_whatever_order_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let few = collected(folder, "few", "400", &["--samples", "10"]);
    // Its first ten samples are those of the other, in splits of its own.
    let more = collected(folder, "more", "400", &["--samples", "14"]);
    let page = folder.join("page.html");
    let compare = ["compare", text(&few), text(&more), "--worst", "2"];
    let found = succeed_json(&[&compare[..], &["--report", text(&page)]].concat());
    assert_eq!(found["pairs"], 10);
    assert_eq!(found["unpaired"], serde_json::json!([0, 4]));
    // All points of equal clouds; of fewer points other ones are drawn.
    assert_eq!(found["points"], 400);
    for distance in ["cd", "tip"] {
        assert_eq!(found[distance]["max"], 0.0, "{distance}");
    }
    assert_eq!(found["tip_source"], "settled");
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.contains("<title>few beside more</title>"));
    assert!(html.contains("data-cloud=\"prediction\"") && !html.contains("data-cloud=\"nearest\""));
    assert_eq!(html.matches("<article class=\"example\">").count(), 4);

    // By places, most are of other commands.
    let by_place = succeed_json(&[&compare[..], &["--match", "index"]].concat());
    assert_eq!(by_place["pairs"], 10);
    assert!(number(&by_place["tip"]["max"]) > 0.02 && number(&by_place["cd"]["max"]) > 1e-4);
    let worst = by_place["worst"].as_array().unwrap();
    let at = |k: &Value| number(&by_place["configurations"][k.as_u64().unwrap() as usize]["cd"]);
    assert_eq!(at(&worst[0]), number(&by_place["cd"]["max"]));
    assert!(worst.len() == 2 && at(&worst[0]) >= at(&worst[1]));
    let said = succeed(&[&compare[..], &["--match", "index"]].concat());
    let cd = format!("{:.4}e-4 m²", 1e4 * at(&worst[0]));
    assert!(said.contains(&cd) && said.contains("over 10 configurations in common (0 and 4"));

    let other = collected(folder, "other", "400", &["--samples", "10", "--seed", "1"]);
    let nothing = ["compare", text(&few), text(&other)];
    refuse(
        &nothing,
        1,
        "no configuration of the first data set is one of the second within 0.001",
    );
    let larger = collected(
        folder,
        "larger",
        "400",
        &["--samples", "10", "--robot", "3m"],
    );
    let motors = ["compare", text(&few), text(&larger)];
    refuse(
        &motors,
        1,
        "commands of the first data set have 6 numbers, those of the second 9",
    );
    let points = ["compare", text(&few), text(&more), "--points", "401"];
    refuse(&points, 1, "--points is 401; expected 1 to 400");
}

#[test]
fn clouds_of_a_real_robot_are_compared_with_the_simulator() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let data = collected(
        folder,
        "data",
        "1500",
        &["--samples", "10", "--noise", "d435"],
    );
    let (clouds, real) = (folder.join("clouds"), folder.join("real"));
    // Clouds of which nobody says whose they are.
    succeed(&[
        "data",
        "export",
        text(&data),
        "--format",
        "npz",
        "--out",
        text(&clouds),
    ]);
    fs::create_dir(folder.join("flat")).unwrap();
    for split in ["train", "val", "test"] {
        for file in fs::read_dir(clouds.join(split)).unwrap() {
            let file = file.unwrap();
            let name = format!("{split}-{}", file.file_name().to_str().unwrap());
            fs::copy(file.path(), folder.join("flat").join(name)).unwrap();
        }
    }
    let flat = folder.join("flat");
    succeed(&[
        "data",
        "import",
        text(&flat),
        "--points",
        "1500",
        "--out",
        text(&real),
    ]);
    refuse(
        &["compare", text(&real)],
        1,
        "does not say which robot it shows",
    );
    let model = succeed_json(&["compare", text(&real), "--robot", "2m"]);
    assert_eq!(
        (&model["pairs"], &model["b"]),
        (&Value::from(10), &Value::Null)
    );
    assert_eq!(model["tip_source"], "laid");
    // The noise of the cameras moves no tip far.
    assert!(number(&model["tip"]["max"]) < 3e-3, "{}", model["tip"]);
    assert!(number(&model["cd"]["median"]) < 1e-4, "{}", model["cd"]);

    // A robot whose tendons are softer ends up elsewhere, in the clouds as in truth.
    let spec = folder.join("soft.toml");
    let written = succeed(&["export", "--robot", "2m", "--format", "toml"]);
    fs::write(&spec, written.replace("gain = 500.0", "gain = 100.0")).unwrap();
    let [laid, truly] = [&real, &data].map(|set| {
        let found = succeed_json(&["compare", text(set), "--robot", text(&spec)]);
        number(&found["tip"]["mean"])
    });
    assert!(
        truly > 5e-3 && (laid - truly).abs() < 1e-3 + 0.1 * truly,
        "{laid} {truly}"
    );
    // Of a recorded set the robot is known, and where its tip is, is not.
    let recorded = collected(folder, "recorded", "1500", &["--samples", "10"]);
    let meta = recorded.join("meta.json");
    let mut said: Value = serde_json::from_slice(&fs::read(&meta).unwrap()).unwrap();
    let recipe = said["origin"]["simulated"]["recipe"].take();
    said["origin"] = serde_json::json!({"recorded": {"recording": {
        "rig": "desk",
        "robot": recipe["subject"]["robot"],
        "base": recipe["subject"]["base"],
        "voxel_size": recipe["voxel_size"],
        "settings": null,
    }}});
    fs::write(&meta, said.to_string()).unwrap();
    let rig = succeed_json(&["compare", text(&recorded)]);
    assert_eq!(
        (&rig["pairs"], &rig["tip_source"]),
        (&Value::from(10), &Value::from("laid"))
    );
    assert!(number(&rig["tip"]["max"]) < 1.5e-3, "{}", rig["tip"]);

    // Beside the set that it was exported from, the tip is known as well.
    let both = succeed_json(&["compare", text(&real), text(&data)]);
    assert_eq!(
        (&both["pairs"], &both["tip_source"]),
        (&Value::from(10), &Value::from("laid"))
    );
}
