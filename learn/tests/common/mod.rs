//! A small data set that stands for a large one.

#![allow(
    dead_code,
    clippy::unwrap_used,
    reason = "each test file uses its part; a failed unwrap is a failed test"
)]

use std::collections::BTreeMap;
use std::fs;
use std::ops::ControlFlow::Continue;
use std::path::Path;

use tdcr_learn::data::{Collector, Condition, Design, Meta, Origin, PayloadRange, Recipe, Sample};
use tdcr_sim::cloud::PointCloud;
use tempfile::{TempDir, tempdir};

pub const MOTORS: usize = 2;
pub const POINTS: usize = 6;

/// Written by `tests/data/make_chunked_set.py`, that is by h5py and the HDF5 C library.
pub const CHUNKED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/chunked");

/// A copy of h5py's data set, to be damaged.
pub fn chunked() -> TempDir {
    let dir = tempdir().unwrap();
    restore(dir.path(), &files(Path::new(CHUNKED)));
    dir
}

pub fn meta() -> Meta {
    Meta {
        format: Meta::FORMAT,
        tdcr_version: "0.1.0".to_owned(),
        seed: 7,
        count: 43,
        motors: MOTORS,
        points_per_cloud: POINTS,
        samples_per_shard: 10,
        origin: Origin::Simulated {
            recipe: Recipe::default(),
            design: Design::Uniform,
        },
    }
}

/// Distinct in every number, and exact in `f32`.
pub fn sample(index: usize) -> Sample {
    let i = index as f32;
    Sample {
        condition: Condition {
            motors: (0..MOTORS)
                .map(|j| (i + 100.0 * j as f32) / 65536.0)
                .collect(),
            payload: None,
        },
        cloud: PointCloud {
            points: (0..POINTS)
                .map(|k| [i / 1024.0, -(k as f32) / 1024.0, 0.125])
                .collect(),
            colors: (0..POINTS).map(|k| [index as u8, k as u8, 255]).collect(),
        },
    }
}

/// [`meta`] of a set with payloads.
pub fn loaded_meta() -> Meta {
    let mut meta = meta();
    if let Origin::Simulated { recipe, .. } = &mut meta.origin {
        recipe.subject.payload = Some(PayloadRange {
            min: 0.0,
            max: 0.03,
        });
    }
    meta
}

/// [`sample`] with a payload.
pub fn loaded_sample(index: usize) -> Sample {
    let mut sample = sample(index);
    sample.condition.payload = Some(index as f32 / 2048.0);
    sample
}

pub fn write_missing_blocks(collector: &Collector) {
    for block in collector.missing_blocks() {
        let samples: Vec<Sample> = block.clone().map(sample).collect();
        collector.write_block(block.start, &samples).unwrap();
    }
}

/// Makes the whole of [`meta`]'s data set without interruption.
pub fn collect(dir: &Path, meta: &Meta) {
    let collector = Collector::open(dir, meta).unwrap();
    write_missing_blocks(&collector);
    collector.finish(|_, _| Continue(())).unwrap();
}

/// Contents of every file under `dir`, by path relative to it.
pub fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            for (rest, bytes) in files(&path) {
                found.insert(format!("{name}/{rest}"), bytes);
            }
        } else {
            found.insert(name, fs::read(&path).unwrap());
        }
    }
    found
}

/// Writes files as [`files`] returns them.
pub fn restore(dir: &Path, files: &BTreeMap<String, Vec<u8>>) {
    for (name, bytes) in files {
        let path = dir.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
}
