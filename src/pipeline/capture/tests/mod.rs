//! Captures in memory, undisturbed and disturbed.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod faults;
mod resumption;

use std::path::Path;

use tdcr_hw::rig::{Pace, RigFile};
use tdcr_learn::data::{DataSet, Split, check};

use super::*;

/// The example's rig with two small cameras, which are quick.
fn rig() -> Rig {
    rig_with(|text| text)
}

/// The same with changes to its file.
fn rig_with(change: impl FnOnce(String) -> String) -> Rig {
    rig_at(Pace::Computed, change)
}

/// The same, whose time passes as `pace` says.
fn rig_at(pace: Pace, change: impl FnOnce(String) -> String) -> Rig {
    let text = include_str!("../../../../examples/rig-sim.toml");
    let end = text.match_indices("[[cameras]]").nth(2).unwrap().0;
    let text = text[..end].replace("[640, 480]", "[160, 120]");
    // Robots are named from the folder of the file.
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/rig.toml");
    let file = RigFile::parse(&change(text), &path).unwrap();
    Rig::open_file(file, pace).unwrap()
}

fn settings(commands: usize) -> CaptureSettings {
    CaptureSettings {
        commands,
        given: None,
        repeat: 1,
        payloads: Vec::new(),
        points: 200,
        voxel: 0.004,
        seed: 5,
        sentinel_every: 6,
        masks: None,
        no_log: true,
    }
}

/// Every command of a data set, in the order of its samples.
fn commands(dir: &Path) -> Vec<Vec<f32>> {
    assert!(check(dir).unwrap().is_empty());
    let set = DataSet::open(dir).unwrap();
    let mut commands = Vec::new();
    for split in Split::ALL {
        let samples = set.samples(split).unwrap();
        for sample in samples.read(0..samples.len()).unwrap() {
            assert_eq!(sample.cloud.len(), 200);
            commands.push(sample.condition.motors);
        }
    }
    commands
}

/// Labels are where servos stood, some ticks off their goals, which depends on where they came from: 20 ticks are 0.15 mm.
fn assert_alike(found: &[Vec<f32>], expected: &[Vec<f32>]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 1.5e-4, "{found} {expected}");
    }
}

/// Samples that a capture which ended says to have kept.
fn kept(ended: &PipelineError) -> usize {
    match ended {
        PipelineError::Capture(CaptureStop::Ended { kept, .. }) => *kept,
        other => panic!("{other}"),
    }
}

/// Indices of the samples in a journal, ascending.
fn journalled(dir: &Path) -> Vec<u64> {
    let journal = std::fs::read_to_string(dir.join(JOURNAL)).unwrap();
    let lines = journal
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let mut indices: Vec<u64> = lines
        .filter_map(|line| line["entry"]["index"].as_u64())
        .collect();
    indices.sort_unstable();
    indices
}

/// Every condition and cloud of a data set.
fn contents(dir: &Path) -> Vec<(Vec<f32>, Vec<[f32; 3]>)> {
    let set = DataSet::open(dir).unwrap();
    let of_split = |split| {
        let samples = set.samples(split).unwrap();
        samples.read(0..samples.len()).unwrap()
    };
    let samples = Split::ALL.into_iter().flat_map(of_split);
    samples
        .map(|sample| (sample.condition.motors, sample.cloud.points))
        .collect()
}
