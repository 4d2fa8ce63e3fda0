//! Every reader of bytes that someone else may have written, as a function of the bytes.
//!
//! What a reader returns does not matter: it must not panic, abort, or take memory and time that its input does not
//! warrant. The tests beside this file and the fuzz targets in `fuzz/` call the same functions.

use std::fs;
use std::io::Cursor;
use std::ops::ControlFlow::{self, Break, Continue};
use std::path::Path;

use serde::Deserialize;
use serde_json::json;
use tdcr::hw;
use tdcr::hw::dynamixel::joined::sections;
use tdcr::hw::dynamixel::{Bus, BusSettings, Decoder, Instruction, Item, Status};
use tdcr::hw::log::{Contents, Entry, LogReader, LogRecord, repair};
use tdcr::hw::rig::RigFile;
use tdcr::hw::servo::{ServoBus, ServoId, Setting, Torque};
use tdcr::learn::data::{
    DataSet, ImportSettings, Split, import, merge, read_cloud, read_predictions,
};
use tdcr::learn::train::{Model, TrainingState};
use tdcr::pipeline::recording::{Columns, GivenPriors, RecordingFile};
use tdcr::pipeline::{PipelineError, Scores};
use tdcr::sim::formats::load_scene;
use tdcr::sim::geometry::Shape;
use tdcr::sim::render::Visuals;
use tdcr::sim::robot::{Robot, RobotSpec};
use tdcr::sim::scene::Scene;
use tdcr::study::Study;

// A line of servos for tests.
#[path = "../../hw/tests/servos/driver/noise.rs"]
mod noise;

use noise::NoiseTransport;

// Parts of the program that no library has: here they are read with all that they need.
#[path = "../../src/cli/commands.rs"]
#[allow(dead_code, reason = "the program needs more of it")]
mod commands;
#[path = "../../src/pipeline/journal.rs"]
#[allow(dead_code, reason = "the program needs more of it")]
mod journal;
#[path = "../../src/pipeline/line_file.rs"]
#[allow(dead_code, reason = "the program needs more of it")]
mod line_file;

/// A reader's name, and the reader.
pub type Reader = (&'static str, fn(&[u8]));

/// All readers.
pub const READERS: [Reader; 30] = [
    ("robot_toml", robot_toml),
    ("robot_json", robot_json),
    ("mjcf", mjcf),
    ("urdf", urdf),
    ("stl", stl),
    ("meta", meta),
    ("part", part),
    ("motor_ranges", motor_ranges),
    ("point_scale", point_scale),
    ("shard", shard),
    ("npy", npy),
    ("npz", npz),
    ("pcd", pcd),
    ("ply", ply),
    ("motors", motors),
    ("split_file", split_file),
    ("model", model),
    ("training_state", training_state),
    ("journal", journal),
    ("commands", commands),
    ("servo_frames", servo_frames),
    ("servo_answers", servo_answers),
    ("rig_log", rig_log),
    ("columns", columns),
    ("priors", priors),
    ("recording", recording),
    ("predictions", predictions),
    ("study_file", study_file),
    ("rig_file", rig_file),
    ("scene_file", scene_file),
];

/// Robot files (TOML).
pub fn robot_toml(bytes: &[u8]) {
    robot("robot.toml", bytes);
}

/// Robot files (JSON).
pub fn robot_json(bytes: &[u8]) {
    robot("robot.json", bytes);
}

/// MuJoCo models.
pub fn mjcf(bytes: &[u8]) {
    robot("robot.xml", bytes);
    in_file("robot.xml", bytes, |path| {
        // What is read of it as a scene is one, and can be written.
        if let Ok((scene, _)) = load_scene(path) {
            let written = scene.to_toml().unwrap();
            Scene::from_toml(&written, Path::new("")).unwrap();
        }
    });
}

/// URDF models.
pub fn urdf(bytes: &[u8]) {
    robot("robot.urdf", bytes);
}

fn robot(name: &str, bytes: &[u8]) {
    in_file(name, bytes, |path| {
        // What is read is a robot.
        if let Ok(spec) = RobotSpec::load(&path.to_string_lossy()) {
            drop(Robot::new(spec));
        }
    });
}

/// Triangle meshes.
pub fn stl(bytes: &[u8]) {
    in_file("mesh.stl", bytes, |path| drop(Shape::read_stl(path)));
}

const MOTOR_RANGES: &str = "global_motors_scope-all.json";
const POINT_SCALE: &str = "global_norm_scope-all_anchor-origin.json";
const SHARD: &str = "val/shard-00000.h5";

/// Files of a small data set of 2 motors, written by h5py.
const DATA_SET: [(&str, &[u8]); 3] = [
    (
        MOTOR_RANGES,
        include_bytes!("../../learn/tests/data/chunked/global_motors_scope-all.json"),
    ),
    (
        POINT_SCALE,
        include_bytes!("../../learn/tests/data/chunked/global_norm_scope-all_anchor-origin.json"),
    ),
    (
        SHARD,
        include_bytes!("../../learn/tests/data/chunked/val/shard-00000.h5"),
    ),
];

/// What a data set was made with.
pub fn meta(bytes: &[u8]) {
    data_set("meta.json", bytes);
}

/// Which part of a data set a folder holds.
pub fn part(bytes: &[u8]) {
    in_folder(|dir| {
        fs::write(dir.join("part.json"), bytes).expect("a file can be written");
        drop(DataSet::open(dir));
        let out = dir.join("merged");
        drop(merge(&[dir.to_owned()], &out, |_, _| Break(())));
    });
}

/// Ranges of a data set's motors.
pub fn motor_ranges(bytes: &[u8]) {
    data_set(MOTOR_RANGES, bytes);
}

/// Scale of a data set's points.
pub fn point_scale(bytes: &[u8]) {
    data_set(POINT_SCALE, bytes);
}

/// Shards of a data set (HDF5).
pub fn shard(bytes: &[u8]) {
    data_set(SHARD, bytes);
}

/// Reads the small data set with `bytes` in the file `name`.
fn data_set(name: &str, bytes: &[u8]) {
    in_folder(|dir| {
        fs::create_dir(dir.join("val")).expect("a folder can be made");
        for (file, whole) in DATA_SET {
            fs::write(dir.join(file), whole).expect("a file can be written");
        }
        fs::write(dir.join(name), bytes).expect("a file can be written");
        if let Ok(set) = DataSet::open(dir) {
            drop(set.read_split(Split::Val));
            let samples = set.samples(Split::Val);
            drop(samples.map(|samples| samples.read(0..1)));
            drop(set.cloud_set(Split::Val));
        }
    });
}

/// Clouds of NumPy.
pub fn npy(bytes: &[u8]) {
    cloud("cloud.npy", bytes);
}

/// Archives of NumPy.
pub fn npz(bytes: &[u8]) {
    cloud("cloud.npz", bytes);
}

/// Clouds of the Point Cloud Library.
pub fn pcd(bytes: &[u8]) {
    cloud("cloud.pcd", bytes);
}

/// Clouds in PLY files.
pub fn ply(bytes: &[u8]) {
    cloud("cloud.ply", bytes);
}

fn cloud(name: &str, bytes: &[u8]) {
    in_file(name, bytes, |path| drop(read_cloud(path)));
}

/// Clouds of several commands, to be scored.
pub fn predictions(bytes: &[u8]) {
    in_file("clouds.npz", bytes, |path| drop(read_predictions(path)));
}

/// Files of studies.
pub fn study_file(bytes: &[u8]) {
    in_file("study.toml", bytes, |path| drop(Study::load(path)));
}

/// Files of rigs.
pub fn rig_file(bytes: &[u8]) {
    in_file("rig.toml", bytes, |path| drop(RigFile::load(path)));
}

/// Files of scenes.
pub fn scene_file(bytes: &[u8]) {
    in_file("scene.toml", bytes, |path| {
        // What is read is a scene, and can be written and seen.
        if let Ok(scene) = Scene::load(path) {
            drop(scene.to_toml());
            Visuals::default().add_scene(&scene);
        }
    });
}

/// Motors beside a cloud that is imported.
pub fn motors(bytes: &[u8]) {
    in_folder(|dir| {
        let clouds = dir.join("clouds");
        fs::create_dir(&clouds).expect("a folder can be made");
        // Too few for a data set: the motors are read, and nothing is written.
        fs::write(clouds.join("cloud.ply"), "").expect("a file can be written");
        fs::write(clouds.join("cloud.json"), bytes).expect("a file can be written");
        drop(import(
            &clouds,
            &dir.join("set"),
            &ImportSettings::default(),
            go_on,
            go_on,
        ));
    });
}

fn go_on(_: usize, _: usize) -> ControlFlow<()> {
    Continue(())
}

/// Splits given to an import (CSV), for the clouds `a.ply`, `b.ply` and `c.ply`.
pub fn split_file(bytes: &[u8]) {
    in_folder(|dir| {
        let clouds = dir.join("clouds");
        fs::create_dir(&clouds).expect("a folder can be made");
        for name in ["a", "b", "c"] {
            // The clouds are empty: the splits are read, and no data set is written.
            fs::write(clouds.join(format!("{name}.ply")), "").expect("a file can be written");
            let motors = clouds.join(format!("{name}.json"));
            fs::write(motors, r#"{"ctrl": [0.01]}"#).expect("a file can be written");
        }
        let file = dir.join("split.csv");
        fs::write(&file, bytes).expect("a file can be written");
        let settings = ImportSettings {
            split: Some(file),
            ..ImportSettings::default()
        };
        drop(import(&clouds, &dir.join("set"), &settings, go_on, go_on));
    });
}

/// Trained networks (safetensors).
pub fn model(bytes: &[u8]) {
    in_file("model.safetensors", bytes, |path| drop(Model::load(path)));
}

/// Training runs (safetensors).
pub fn training_state(bytes: &[u8]) {
    in_file("state.safetensors", bytes, |path| {
        drop(TrainingState::load(path));
    });
}

/// Finished pieces of an evaluation.
pub fn journal(bytes: &[u8]) {
    #[derive(Deserialize)]
    #[allow(dead_code, reason = "it is read, not used")]
    struct Entry {
        index: usize,
        scores: Scores,
    }
    in_file("journal", bytes, |path| {
        drop(journal::Journal::open::<Entry>(path, &journal_key()));
    });
}

/// A journal of two pieces.
pub fn journal_file() -> Vec<u8> {
    let file = tempfile::NamedTempFile::new().expect("a file can be made");
    let opened = journal::Journal::open::<serde_json::Value>(file.path(), &journal_key());
    let (journal, _) = opened.expect("a journal can be written");
    for index in 0..2 {
        let piece = json!({ "index": index, "scores": {} });
        journal.add(&piece).expect("a journal can be written");
    }
    fs::read(file.path()).expect("a file can be read")
}

/// Whose work the journal is.
fn journal_key() -> serde_json::Value {
    json!({ "format": 1 })
}

/// Commands: JSON where the first byte is of a list, else CSV.
pub fn commands(bytes: &[u8]) {
    let name = match bytes.first() {
        Some(b'[') => "commands.json",
        _ => "commands.csv",
    };
    in_file(name, bytes, |path| {
        drop(commands::read_commands(path, |_| Ok(())));
    });
}

/// Frames on a line of servos.
pub fn servo_frames(mut bytes: &[u8]) {
    let mut decoder = Decoder::new();
    while !bytes.is_empty() || !decoder.pending().is_empty() {
        let taken = decoder.fill(bytes);
        bytes = &bytes[taken..];
        let _ = sections(decoder.pending(), servos().map(|id| (id, 4))).count();
        while let Some(frame) = decoder.next_frame() {
            let _ = (Instruction::decode(&frame), Status::decode(&frame));
        }
        if taken == 0 {
            decoder.give_up();
        }
    }
}

/// What servos answer to a driver.
pub fn servo_answers(bytes: &[u8]) {
    let ids: Vec<ServoId> = servos().collect();
    let mut bus = Bus::new(NoiseTransport::new(bytes), BusSettings::default());
    drop(bus.scan());
    assert_eq!(bus.present(&ids).len(), ids.len());
    assert_eq!(bus.set(Setting::Torque(&ids, Torque::On)).len(), ids.len());
    assert_eq!(bus.read_items(&ids, Item::GoalPosition).len(), ids.len());
}

fn servos() -> impl Iterator<Item = ServoId> {
    (1..4).filter_map(ServoId::new)
}

/// Has `read` read a file `name` of these bytes.
fn in_file(name: &str, bytes: &[u8], read: impl FnOnce(&Path)) {
    in_folder(|dir| {
        let path = dir.join(name);
        fs::write(&path, bytes).expect("a file can be written");
        read(&path);
    });
}

/// Makes a folder for `work`, and removes it.
fn in_folder(work: impl FnOnce(&Path)) {
    let dir = tempfile::tempdir().expect("a folder can be made");
    work(dir.path());
}

/// Logs of rigs, read and repaired.
pub fn rig_log(bytes: &[u8]) {
    let mut reader = LogReader::new(Cursor::new(bytes)).expect("memory can be read");
    while let Some(entry) = reader.next_entry().expect("memory can be read") {
        if let Entry::Message(message) = entry {
            drop(LogRecord::decode(&message.channel, &message.data));
        }
    }
    in_file("log.mcap", bytes, |path| {
        let whole = path.with_extension("whole");
        if let Ok(found) = repair(path, &whole) {
            assert_eq!(found, *reader.recovery());
            let repaired = Contents::of(&whole).expect("it was just written");
            assert_eq!(repaired.recovery.messages, found.messages);
            assert!(repaired.recovery.is_whole(), "{:?}", repaired.recovery);
        }
    });
}

/// Column maps of recordings.
pub fn columns(bytes: &[u8]) {
    let robot = RobotSpec::standard("2m").expect("a standard robot");
    in_file("columns.toml", bytes, |path| {
        // What is read has what lies between servos and tendons.
        if let Ok(columns) = Columns::load(path, &robot) {
            drop(columns.transmission(&robot));
        }
    });
}

/// Priors of unknowns.
pub fn priors(bytes: &[u8]) {
    in_file("priors.toml", bytes, |path| drop(GivenPriors::load(path)));
}

/// A column map of all kinds of columns.
const COLUMNS: &str = include_str!("columns.toml");

/// Recordings.
pub fn recording(bytes: &[u8]) {
    let columns: Columns = toml::from_str(COLUMNS).expect("a column map");
    drop(RecordingFile::parse(
        bytes,
        &columns,
        Path::new("recording.csv"),
    ));
}
