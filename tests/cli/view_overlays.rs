//! What `tdcr view` shows over a robot: data sets, networks, recordings, studies.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};
use tdcr::hw::log::{Entry, LogReader, LogRecord};

use crate::capture::{capture, small_rig};
use crate::view::{Server, distance, doubles, tip};
use crate::{collect_small, refuse, succeed, succeed_json, text, train_tiny};

/// Role, points and mean distance (m) of a message of a cloud, and its first point.
fn cloud(message: &[u8]) -> (f64, f64, f64, [f32; 3]) {
    let head = doubles(&message[..40]);
    let point = message[40..52].chunks_exact(4);
    let point: Vec<f32> = point
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect();
    assert_eq!(message.len(), 40 + 15 * head[2] as usize);
    (head[1], head[2], head[3], [point[0], point[1], point[2]])
}

#[test]
fn a_sample_of_a_data_set_lies_on_the_robot_under_its_command() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    collect_small(&data, &["--robot", "3m"]);
    let server = Server::start(&["--data", text(&data)]);
    let mut page = server.open();
    let overlays = page.next_words();
    assert_eq!(overlays["type"], "overlays");
    assert_eq!(
        overlays["data"][0],
        json!({"split": "train", "samples": 16})
    );
    assert_eq!(page.words()["name"], "3m", "the robot of the data set");
    page.send(1.0, json!({"type": "sample", "split": "test", "index": 1}));
    let (role, points, apart, _) = cloud(&page.numbers(1.0));
    assert_eq!((role, points), (0.0, 400.0));
    assert!(apart > 0.0 && apart < 5e-3, "{apart} m");
    for (split, index, expected) in [("test", 99, "99"), ("some", 0, "train, val or test")] {
        page.send(
            2.0,
            json!({"type": "sample", "split": split, "index": index}),
        );
        let refused = page.words();
        assert!(
            refused["reason"].as_str().unwrap().contains(expected),
            "{refused}"
        );
    }
    let wrong = text(folder.path());
    refuse(&["view", "--no-browser", "--data", wrong], 1, "data set");
}

#[test]
fn the_cloud_of_a_network_follows_the_robot_and_says_how_far_it_is_off() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    collect_small(&data, &[]);
    let model = train_tiny(&data, &run, &[])["model"]
        .as_str()
        .unwrap()
        .to_owned();
    let server = Server::start(&["--model", &model]);
    let mut page = server.open();
    assert_eq!(page.next_words()["model"]["robot"], "2m");
    page.words();
    page.send(1.0, json!({"type": "predict", "on": true}));
    let (role, points, apart, first) = cloud(&page.numbers(1.0));
    assert_eq!((role, points), (1.0, 1024.0));
    assert!(apart > 0.0 && apart < 0.5, "{apart} m");
    let command = vec![0.01; 6];
    page.ask(2.0, json!({"type": "command", "command": command}));
    let (.., moved) = cloud(&page.numbers(1.0));
    assert_ne!(first, moved);
    // As `tdcr predict` has it.
    let out = folder.path().join("cloud.ply");
    let at = "0.01,0.01,0.01,0.01,0.01,0.01";
    let points = ["--points", "1024", "--seed", "0"];
    let predict = [
        "predict",
        "--model",
        &model,
        "--command",
        at,
        "--out",
        text(&out),
    ];
    succeed(&[&predict[..], &points].concat());
    let written = fs::read(&out).unwrap();
    let end = b"end_header\n";
    let body = written.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    let x = f32::from_le_bytes(written[body..body + 4].try_into().unwrap());
    assert!((x - moved[0]).abs() < 1e-4, "{x} m, not {} m", moved[0]);

    let other = Server::start(&["--model", &model, "--robot", "3m"]);
    let mut page = other.open();
    page.words();
    page.send(1.0, json!({"type": "predict", "on": true}));
    let refused = page.words();
    let reason = refused["reason"].as_str().unwrap();
    assert!(reason.contains("takes 6 values"), "{reason}");
}

#[test]
fn a_point_of_a_study_shows_the_robot_of_its_row() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("study.toml"), folder.path().join("out"));
    let study = "robot = \"2m\"\nwant = [\"tip\"]\n[[vary]]\nwhat = \"modules\"\nvalues = [1, 2]\n[[vary]]\nwhat = \"payload\"\n\
                 range = [0.0, 0.02]\nsteps = 3\n";
    fs::write(&file, study).unwrap();
    succeed(&["study", text(&file), "--out", text(&out)]);
    let table = fs::read_to_string(out.join("table.csv")).unwrap();
    let titles: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let server = Server::start(&["--study", text(&out)]);
    let mut page = server.open();
    let scatter = page.next_words()["study"].clone();
    assert_eq!(scatter["rows"], json!([0, 1, 2, 3, 4, 5]));
    page.words();
    let first = titles
        .iter()
        .position(|title| title.starts_with("tip"))
        .unwrap();
    for (row, line) in table.lines().skip(1).enumerate() {
        let frame = page.ask(1.0 + row as f64, json!({"type": "row", "row": row}));
        let cells: Vec<&str> = line.split(',').collect();
        let expected = [0, 1, 2].map(|axis| cells[first + axis].parse::<f64>().unwrap());
        assert!(
            distance(tip(&frame), expected) < 1e-9,
            "row {row}: {expected:?}"
        );
    }
    page.send(20.0, json!({"type": "row", "row": 6}));
    loop {
        let words = page.words();
        if words["type"] == "refused" {
            assert!(
                words["reason"].as_str().unwrap().contains("rows 0 to 5"),
                "{words}"
            );
            break;
        }
    }
}

/// Pixels of the last colours before a time (s) that the camera has taken whose pictures come first.
fn last_picture(log: &Path, at: f64) -> Vec<u8> {
    let mut reader = LogReader::open(log).unwrap();
    let (mut first, mut camera, mut last) = (None, None, Vec::new());
    while let Some(entry) = reader.next_entry().unwrap() {
        let Entry::Message(message) = entry else {
            continue;
        };
        let first = *first.get_or_insert(message.log_time);
        let time = (message.log_time - first) as f64 * 1e-9;
        if let Ok(Some(LogRecord::Color { serial, image })) =
            LogRecord::decode(&message.channel, &message.data)
            && time <= at
            && *camera.get_or_insert(serial.clone()) == serial
        {
            last = image.pixels.into_flattened();
        }
    }
    last
}

#[test]
fn a_recording_is_scrubbed_through() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let out = folder.path().join("set");
    succeed(&capture(&rig, &out));
    let log = out.join("log.mcap");
    let info = succeed_json(&["log", "info", text(&log)]);
    let robot = folder.path().join("paper-robot.toml");
    let server = Server::start(&["--log", text(&log), "--robot", text(&robot)]);
    let mut page = server.open();
    let contents = page.next_words()["log"].clone();
    let clouds = contents["clouds"].as_array().unwrap();
    assert!(!clouds.is_empty(), "{info}");
    let first = page.words();
    assert_eq!(first["type"], "robot");
    let at = clouds.last().unwrap().as_f64().unwrap();
    page.send(1.0, json!({"type": "moment", "time": at}));
    let moment: Value = page.words();
    assert_eq!(moment["type"], "moment");
    assert_eq!(moment["servos"].as_array().unwrap().len(), 6);
    assert!(moment["command"].is_array(), "{moment}");
    let (role, points, ..) = cloud(&page.numbers(1.0));
    assert!(role == 2.0 && points > 100.0, "{role}, {points}");
    // The picture is the last that the first camera took before the moment.
    let shown = page.numbers(3.0);
    assert_eq!(doubles(&shown[8..40]), [0.0, 2.0, 160.0, 120.0]);
    assert!(shown[40..] == last_picture(&log, at));
    let late = page.ask(2.0, json!({"type": "moment", "time": at}));
    // The first cloud is that of a look at home.
    let first = clouds[1].as_f64().unwrap();
    let early = page.ask(3.0, json!({"type": "moment", "time": first}));
    assert!(distance(tip(&late), tip(&early)) > 1e-3);
}
