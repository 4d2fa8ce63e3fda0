//! Rigs from the command line: scan, home, jog, pretension, capture.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use serde_json::Value;

use crate::{refuse, stderr, succeed, succeed_json, tdcr, text};

/// The example's rig with two small cameras, which are quick.
pub(crate) fn small_rig(folder: &Path) -> PathBuf {
    let whole = include_str!("../../examples/rig-sim.toml");
    let end = whole.match_indices("[[cameras]]").nth(2).unwrap().0;
    let path = folder.join("rig.toml");
    fs::write(&path, whole[..end].replace("[640, 480]", "[160, 120]")).unwrap();
    let robot = include_str!("../../examples/paper-robot.toml");
    fs::write(folder.join("paper-robot.toml"), robot).unwrap();
    path
}

pub(crate) fn capture<'a>(rig: &'a Path, out: &'a Path) -> Vec<&'a str> {
    let size = ["--commands", "20", "--points", "300", "--voxel", "0.004"];
    let where_to = ["capture", "--rig", text(rig), "--out", text(out)];
    [&where_to[..], &size].concat()
}

#[test]
fn a_rig_is_scanned_homed_and_captured_with_and_its_data_set_trains() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let scan = succeed_json(&["scan", "--rig", text(&rig)]);
    assert_eq!(scan["servos"].as_array().unwrap().len(), 6);
    assert_eq!(scan["servos"][5]["status"], "no error");
    assert_eq!(scan["cameras"].as_array().unwrap().len(), 2);
    let homed = succeed_json(&["home", "--rig", text(&rig), "--here"]);
    assert_eq!(homed["servos"][0]["position"], 0);
    let out = folder.path().join("data");
    let planned = succeed_json(&[&capture(&rig, &out)[..], &["--dry-run"]].concat());
    assert!(!out.exists());
    let report = succeed_json(&capture(&rig, &out));
    assert_eq!(
        (report["samples"].as_u64(), report["moving"].as_u64()),
        (Some(20), Some(0))
    );
    // All of it is in a log.
    let log = report["log"].as_str().unwrap();
    assert!(log.ends_with("data/log.mcap"));
    let logged = succeed_json(&["log", "info", log]);
    assert_eq!(logged["whole"], true);
    let topics = logged["topics"].as_array().unwrap().iter();
    let topics: Vec<&str> = topics
        .map(|topic| topic["topic"].as_str().unwrap())
        .collect();
    for topic in ["/servos/registers", "/command", "/cameras/east/depth"] {
        assert!(topics.contains(&topic), "{topics:?}");
    }
    // What was done is what was said.
    let journal = fs::read_to_string(out.join("capture.jsonl")).unwrap();
    let line = journal
        .lines()
        .find(|line| line.contains("\"index\":7,"))
        .unwrap();
    let recorded: Value = serde_json::from_str(line).unwrap();
    assert_eq!(recorded["entry"]["ticks"], planned["moves"][7]["ticks"]);
    let info = succeed_json(&["data", "info", text(&out)]);
    let origin = info[0]["origin"].as_str().unwrap();
    assert_eq!(
        origin,
        "recording of robot paper robot on rig rig-sim, seed 0"
    );
    succeed(&["data", "check", text(&out)]);
    let run = folder.path().join("run");
    crate::train_tiny(&out, &run, &[]);
    let model = run.join("model.safetensors");
    let sizes = ["--points", "300", "--emd-points", "100"];
    let score = ["eval", "--model", text(&model), "--data", text(&out)];
    let scores = succeed_json(&[&score[..], &sizes].concat());
    assert!(scores["cd"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_capture_that_is_killed_is_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let [whole, killed] = ["whole", "killed"].map(|name| folder.path().join(name));
    succeed(&capture(&rig, &whole));
    let mut kills = 0;
    for wait in 1..200 {
        let mut child = tdcr(&capture(&rig, &killed))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        sleep(Duration::from_millis(400 * wait));
        child.kill().unwrap();
        match child.wait().unwrap().success() {
            true => break,
            false => kills += 1,
        }
    }
    assert!(kills > 0);
    let report = succeed_json(&capture(&rig, &killed));
    assert_eq!(report["captured"], 0);
    // Each run has a log of its own, and nothing is left to log.
    assert!(killed.join("log-2.mcap").exists() && report["log"].is_null());
    // The same commands, in the same splits, but for the ticks that servos stand off their goals.
    let motors = |dir: &Path| succeed_json(&["data", "info", text(dir)])[0]["motors"].clone();
    let [whole, found] = [&whole, &killed].map(|dir| numbers(&motors(dir)));
    assert_eq!((whole.len(), found.len()), (12, 12));
    for (a, b) in whole.iter().zip(&found) {
        assert!((a - b).abs() < 1.5e-4, "{a} {b}");
    }
    succeed(&["data", "check", text(&killed)]);
}

/// All numbers of a value, in their order.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Number(number) => number.as_f64().into_iter().collect(),
        Value::Array(list) => list.iter().flat_map(numbers).collect(),
        Value::Object(map) => map.values().flat_map(numbers).collect(),
        _ => Vec::new(),
    }
}

#[test]
fn keys_jog_a_rig_and_capture_what_is_imported() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let out = folder.path().join("jog");
    let keys = folder.path().join("keys");
    // Module 2 bends, is captured, tensions far beyond what its limits allow, and is captured straight.
    fs::write(&keys, format!("2wwwwddc{}hcq", "+".repeat(200))).unwrap();
    let output = tdcr(&["jog", "--rig", text(&rig), "--out", text(&out), "--json"])
        .stdin(fs::File::open(&keys).unwrap())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let jogged: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(jogged["captured"], 2);
    assert!(jogged["refused"].as_u64().unwrap() > 10, "{jogged}");
    assert!(jogged["moves"].as_u64().unwrap() > 7, "{jogged}");
    let said = stderr(&output);
    assert!(
        said.contains("expected 1 to 60 N") || said.contains("its servo allows"),
        "{said}"
    );
    let motors = fs::read(out.join("jog-0000.json")).unwrap();
    let motors: Value = serde_json::from_slice(&motors).unwrap();
    assert_eq!(motors["ctrl"].as_array().unwrap().len(), 6);
    // Where the servos stood, and where they were told to be.
    let [ticks, goals] = ["ticks", "goals"].map(|key| numbers(&motors[key]));
    assert_eq!((ticks.len(), goals.len()), (6, 6));
    for (position, goal) in ticks.iter().zip(&goals) {
        assert!((position - goal).abs() <= 100.0, "{motors}");
    }
    assert_ne!(ticks, goals, "servos under a tension stand off their goals");
    assert!(out.join("jog-0001.ply").exists());
    assert!(jogged["log"].as_str().unwrap().ends_with("jog/log.mcap"));
    assert!(out.join("log.mcap").exists());
}

#[test]
fn tendons_are_tensioned_alike() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let scale = |current: &str| {
        let found = succeed_json(&["pretension", "--rig", text(&rig), "--current", current]);
        let servos = found["servos"].as_array().unwrap().clone();
        assert_eq!(servos.len(), 6);
        servos
            .iter()
            .map(|servo| servo["pull"].as_f64().unwrap())
            .collect::<Vec<_>>()
    };
    for pull in scale("0.3") {
        assert!((0.27..0.33).contains(&pull), "{pull}");
    }
    refuse(
        &["pretension", "--rig", text(&rig), "--current", "5"],
        1,
        "expected below 0.75 A",
    );
    // Nobody is there to turn gears; tendons at 6 N take 58 mA on spools of 5 mm.
    let by_hand = ["pretension", "--rig", text(&rig), "--by-hand"];
    let output = tdcr(
        &[
            &by_hand[..],
            &[
                "--current",
                "0.06,0.06,0.06,0.3,0.06,0.06",
                "--patience",
                "3",
            ],
        ]
        .concat(),
    )
    .output()
    .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let said = stderr(&output);
    let told = "turn the bevel gear of tendon 4 further: servo 4 pulls with";
    assert!(
        said.contains(told) && said.contains("expected 0.3 A"),
        "{said}"
    );
    refuse(
        &[&by_hand[..], &["--current", "0.06,0.06"]].concat(),
        1,
        "a single one or 6",
    );
    refuse(
        &[&by_hand[..], &["--current", "0.06", "--step", "5"]].concat(),
        2,
        "--step",
    );
    refuse(
        &["pretension", "--rig", text(&rig), "--current", "0.1,0.2"],
        1,
        "--by-hand",
    );
}

#[test]
fn the_empty_scene_is_recorded_for_the_masks_of_a_rig() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let log = folder.path().join("empty.mcap");
    let record = ["background", "--rig", text(&rig), "--out", text(&log)];
    let recorded = succeed_json(&[&record[..], &["--pictures", "6"]].concat());
    assert_eq!(
        (&recorded["pictures"], &recorded["cameras"]),
        (&6.into(), &2.into())
    );
    let info = succeed_json(&["log", "info", text(&log)]);
    assert_eq!(info["whole"], true);
    refuse(&record, 1, "empty.mcap: File exists");
    let refused = [&record[..], &["--pictures", "4"]].concat();
    refuse(&refused, 2, "4 is not in 5..=1000");
    let masks = fs::read_to_string(&rig).unwrap();
    let with = masks.replace(
        "[masks]\n",
        "[masks]\nbackground = { log = \"empty.mcap\" }\n",
    );
    fs::write(&rig, with).unwrap();
    let out = folder.path().join("data");
    let few = ["--commands", "10", "--points", "300", "--voxel", "0.004"];
    let capture = ["capture", "--rig", text(&rig), "--out", text(&out)];
    let report = succeed_json(&[&capture[..], &few, &["--no-log"]].concat());
    assert_eq!(report["samples"], 10);
    assert!(report["log"].is_null() && !out.join("log.mcap").exists());
    let other = folder.path().join("other");
    let masks = ["--masks", text(folder.path())];
    let capture = ["capture", "--rig", text(&rig), "--out", text(&other)];
    refuse(
        &[&capture[..], &few, &masks].concat(),
        1,
        "camera0/000000.png",
    );
    fs::remove_file(&log).unwrap();
    let third = folder.path().join("third");
    let capture = ["capture", "--rig", text(&rig), "--out", text(&third)];
    refuse(&[&capture[..], &few].concat(), 1, "masks.background.log");
}

#[test]
fn wrong_rigs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let rig = folder.path().join("rig.toml");
    refuse(&["scan", "--rig", text(&rig)], 1, "cannot read");
    refuse(&["scan"], 2, "<PORT>");
    refuse(&["scan", "/dev/null"], 1, "/dev/null is not a serial port");
    fs::write(&rig, "name = \"mine\"\nrobot = 7\n").unwrap();
    refuse(&["home", "--rig", text(&rig)], 1, "line 2, column 9");
    let whole = include_str!("../../examples/rig-sim.toml");
    let robot = include_str!("../../examples/paper-robot.toml");
    fs::write(folder.path().join("paper-robot.toml"), robot).unwrap();
    let real = whole.replacen(
        "link = \"simulated\"",
        "link = { serial = \"/dev/null\" }",
        1,
    );
    let end = real.find("[[cameras]]").unwrap();
    fs::write(&rig, &real[..end]).unwrap();
    refuse(&["capture", "--rig", text(&rig)], 1, "not a serial port");
}

/// The way of SAM 2: pictures out of a log, masks made of them, and the log captured again by these.
#[test]
fn masks_of_a_logs_pictures_give_the_same_clouds() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let rig = small_rig(folder.path());
    let file = fs::read_to_string(&rig).unwrap();
    let (head, rest) = file.split_once("[masks]").unwrap();
    let (_, rest) = rest.split_once("[simulation]").unwrap();
    let alone = format!("{head}[simulation]{rest}").replace("\"table\"", "\"nothing\"");
    fs::write(&rig, &alone).unwrap();
    let few = ["--commands", "10", "--points", "200", "--voxel", "0.004"];
    let capture = |rig: &Path, out: &str, more: &[&str]| {
        let out = path(out);
        let to = ["capture", "--rig", text(rig), "--out", text(&out)];
        succeed_json(&[&to[..], &few, more].concat())
    };
    capture(&rig, "first", &[]);
    let (log, frames, masks) = (path("first/log.mcap"), path("frames"), path("masks"));
    let written = succeed_json(&["log", "pictures", text(&log), "--out", text(&frames)]);
    assert_eq!(
        written["pictures"],
        serde_json::json!({ "camera0": 10, "camera1": 10 })
    );
    for camera in ["camera0", "camera1"] {
        fs::create_dir_all(masks.join(camera)).unwrap();
        for sample in 0..10 {
            let name = format!("{camera}/{sample:06}.png");
            mask_what_stands_out(&frames.join(&name), &masks.join(&name));
        }
    }
    let replay = path("replay.toml");
    let recorded = "link = { recorded = \"first/log.mcap\" }";
    fs::write(&replay, alone.replace("link = \"simulated\"", recorded)).unwrap();
    capture(&replay, "second", &["--no-log", "--masks", text(&masks)]);
    let compared = succeed_json(&["compare", text(&path("second")), text(&path("first"))]);
    assert_eq!(compared["pairs"], 10);
    let distance = compared["cd"]["mean"].as_f64().unwrap();
    assert!(distance < 1e-9, "{}", compared["cd"]);
}

/// A mask of what is of another colour than the picture's corner.
fn mask_what_stands_out(picture: &Path, mask: &Path) {
    let file = BufReader::new(fs::File::open(picture).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let (colors, _) = pixels.as_chunks::<3>();
    let grey: Vec<u8> = colors
        .iter()
        .map(|c| 255 * u8::from(*c != colors[0]))
        .collect();
    assert!(grey.contains(&255), "{}", picture.display());
    let mut encoder = png::Encoder::new(fs::File::create(mask).unwrap(), info.width, info.height);
    encoder.set_color(png::ColorType::Grayscale);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&grey).unwrap();
}

/// A first try on a rig: it is a data set, and is told of as what it is.
#[test]
fn two_samples_are_a_data_set_that_knows_its_robot() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let out = folder.path().join("data");
    let two = ["--commands", "2", "--points", "300", "--voxel", "0.004"];
    let to = [
        "capture",
        "--rig",
        text(&rig),
        "--out",
        text(&out),
        "--no-log",
    ];
    let captured = tdcr(&[&to[..], &two].concat()).output().unwrap();
    let said = stderr(&captured);
    assert!(captured.status.success(), "{said}");
    assert!(said.contains("2 samples: 1 train, 0 val, 1 test"), "{said}");
    succeed(&["data", "check", text(&out)]);
    let info = &succeed_json(&["data", "info", text(&out)])[0];
    assert_eq!(
        (&info["robot"], &info["base"]),
        (&"paper robot".into(), &false.into())
    );
    assert_eq!(
        info["motor_units"],
        serde_json::json!(["m"; 6].map(Value::from))
    );
    let told = succeed(&["data", "info", text(&out)]);
    assert!(
        !told.contains("not known") && !told.contains("motor units"),
        "{told}"
    );
    let page = folder.path().join("data.html");
    succeed(&["data", "view", text(&out), "--out", text(&page)]);
    let page = fs::read_to_string(page).unwrap();
    assert!(page.contains("Positions of the tip") && !page.contains("Reachable workspace"));
    assert!(page.contains("data, 2 tips") && page.contains("command (mm)"));
    let run = folder.path().join("run");
    let train = ["train", "--data", text(&out), "--out", text(&run)];
    refuse(
        &[&train[..], &["--steps", "10"]].concat(),
        1,
        "has no sample in val",
    );
}

#[test]
fn a_dry_run_of_a_million_commands_tells_of_each_and_ends_when_asked_to() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let million = ["--commands", "1000000", "--dry-run"];
    let mut child = tdcr(&[&["capture", "--rig", text(&rig)], &million[..]].concat())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    // The head, and the first commands, long before the last is found.
    let told: Vec<String> = lines.by_ref().take(20).map(Result::unwrap).collect();
    assert!(
        told[0].contains("positions") && told[19].trim_start().starts_with("18 "),
        "{told:?}"
    );
    let id = child.id().to_string();
    let sent = std::process::Command::new("kill")
        .args(["-INT", &id])
        .status();
    assert!(sent.unwrap().success());
    lines.for_each(drop);
    let ended = child.wait_with_output().unwrap();
    let said = stderr(&ended);
    assert_eq!(ended.status.code(), Some(130), "{said}");
    assert!(said.contains("dry run: 1000000 steps"), "{said}");
    // As JSON it is one value.
    let few = [
        "capture",
        "--rig",
        text(&rig),
        "--dry-run",
        "--commands",
        "12",
    ];
    let told = succeed_json(&few);
    assert_eq!(told["moves"].as_array().unwrap().len(), 12);
    assert_eq!(told["ranges"].as_array().unwrap().len(), 6);
    assert!(told["moving_seconds"].as_f64().unwrap() > 1.0);
    // A rehearsal refuses what the capture would.
    let masks = folder.path().join("nosuch");
    let unmasked = [&few[..], &["--masks", text(&masks)]].concat();
    refuse(&unmasked, 1, "nosuch/camera0/000000.png");
}

#[test]
fn quiet_commands_of_a_rig_say_nothing_and_jog_has_its_folder_alone() {
    let folder = tempfile::tempdir().unwrap();
    let rig = small_rig(folder.path());
    let pretension = [
        "pretension",
        "--rig",
        text(&rig),
        "--current",
        "0.05",
        "--quiet",
    ];
    let quiet = tdcr(&pretension).output().unwrap();
    assert!(
        quiet.status.success() && stderr(&quiet).is_empty(),
        "{}",
        stderr(&quiet)
    );
    let out = folder.path().join("jog");
    let jog = ["jog", "--rig", text(&rig), "--out", text(&out), "--quiet"];
    let mut first = tdcr(&jog)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    while !out.join("log.mcap").exists() {
        assert!(first.try_wait().unwrap().is_none());
        sleep(Duration::from_millis(20));
    }
    let second = tdcr(&jog).stdin(Stdio::null()).output().unwrap();
    let said = stderr(&second);
    assert_eq!(second.status.code(), Some(1), "{said}");
    assert!(said.contains("another process"), "{said}");
    drop(first.stdin.take());
    assert!(first.wait().unwrap().success());
}
