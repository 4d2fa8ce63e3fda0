//! Sets whose files do not belong together, or claim too much.

use std::fs;
use std::path::Path;

use tdcr_learn::data::{DataError, DataSet, Finding, Split, check};
use tempfile::tempdir;

use crate::common::{CHUNKED, chunked, collect, meta};

#[test]
fn a_missing_shard_is_reported() {
    let dir = tempdir().unwrap();
    collect(dir.path(), &meta());
    fs::remove_file(dir.path().join("train/shard-00001.h5")).unwrap();
    let set = DataSet::open(dir.path()).unwrap();
    let error = set.read_split(Split::Train).unwrap_err();
    assert!(
        matches!(
            error,
            DataError::SampleCount {
                expected: 35,
                found: 25,
                ..
            }
        ),
        "{error}"
    );
    fs::remove_file(dir.path().join("val/shard-00000.h5")).unwrap();
    assert!(matches!(
        set.read_split(Split::Val),
        Err(DataError::NoShards { .. })
    ));
    fs::remove_dir(dir.path().join("val")).unwrap();
    assert!(matches!(
        set.read_split(Split::Val),
        Err(DataError::Io { .. })
    ));
}

#[test]
fn some_samples_are_those_of_all() {
    let ours = tempdir().unwrap();
    collect(ours.path(), &meta());
    for dir in [ours.path(), Path::new(CHUNKED)] {
        let set = DataSet::open(dir).unwrap();
        for split in Split::ALL {
            let (all, some) = (set.read_split(split).unwrap(), set.samples(split).unwrap());
            assert_eq!(some.len(), all.len());
            assert_eq!(some.points_per_cloud(), all[0].cloud.len());
            assert_eq!(some.condition_dim(), all[0].condition.values().count());
            for first in 0..all.len() {
                for last in first..=all.len() {
                    assert_eq!(some.read(first..last).unwrap(), all[first..last]);
                }
            }
            let beyond = some.read(0..all.len() + 1).unwrap_err().to_string();
            let expected = format!("there is no sample {}, expected 0 to", all.len());
            assert!(beyond.starts_with(&expected), "{beyond}");
        }
    }
}

#[test]
fn a_damaged_sample_is_refused_and_the_others_are_read() {
    let dir = tempdir().unwrap();
    collect(dir.path(), &meta());
    let set = DataSet::open(dir.path()).unwrap();
    let samples = set.samples(Split::Val).unwrap();
    let sound = samples.read(0..4).unwrap();
    let shard = dir.path().join("val/shard-00000.h5");
    let mut bytes = fs::read(&shard).unwrap();
    let x = sound[2].cloud.points.as_flattened();
    let stored: Vec<u8> = x.iter().flat_map(|x| x.to_le_bytes()).collect();
    let place = bytes
        .windows(stored.len())
        .position(|window| *window == stored[..]);
    let place = place.unwrap();
    bytes[place..place + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    fs::write(&shard, bytes).unwrap();
    assert_eq!(samples.read(0..2).unwrap(), sound[..2]);
    assert_eq!(samples.read(3..4).unwrap(), sound[3..]);
    let error = samples.read(1..4).unwrap_err();
    assert!(
        matches!(
            error,
            DataError::NotFinite {
                dataset: "data",
                sample: 2,
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn a_meta_of_another_version_is_refused() {
    let dir = chunked();
    let mut other = serde_json::to_value(meta()).unwrap();
    other["format"] = 99.into();
    fs::write(dir.path().join("meta.json"), other.to_string()).unwrap();
    let error = DataSet::open(dir.path()).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("meta.json: the data set is of format 99, expected 2"),
        "{error}"
    );
}

#[test]
fn a_meta_of_more_than_a_data_set_may_hold_is_refused_before_memory_is_asked_for() {
    let dir = chunked();
    for (field, value, expected) in [
        (
            "count",
            u64::MAX,
            "18446744073709551615 samples cannot be split, expected at most 10000000",
        ),
        (
            "count",
            1_000_000_000_000,
            "1000000000000 samples cannot be split, expected at most 10000000",
        ),
        (
            "motors",
            u64::MAX,
            "data set field `motors` is 18446744073709551615, expected 1 to 4096",
        ),
        ("points_per_cloud", u64::MAX, "expected 1 to 10000000"),
        ("samples_per_shard", u64::MAX, "expected 1 to 10000000"),
    ] {
        let mut large = serde_json::to_value(meta()).unwrap();
        large[field] = value.into();
        fs::write(dir.path().join("meta.json"), large.to_string()).unwrap();
        let error = DataSet::open(dir.path()).unwrap_err().to_string();
        assert!(
            error.contains("meta.json") && error.contains(expected),
            "{error}"
        );
    }
    // As many as a data set may have: refused by the samples that are missing, at once.
    let mut large = meta();
    large.count = 10_000_000;
    large.points_per_cloud = 5;
    fs::write(
        dir.path().join("meta.json"),
        serde_json::to_string(&large).unwrap(),
    )
    .unwrap();
    let began = std::time::Instant::now();
    assert!(
        DataSet::open(dir.path())
            .unwrap()
            .read_split(Split::Val)
            .is_err()
    );
    assert!(began.elapsed().as_secs() < 2);
}

#[test]
fn a_sound_set_has_no_findings_and_each_fault_has_one() {
    let dir = tempdir().unwrap();
    collect(dir.path(), &meta());
    assert_eq!(check(dir.path()).unwrap(), []);

    // A shard of train instead of val's: known commands, and values that no longer reach the ends.
    let twice = tempdir().unwrap();
    collect(twice.path(), &meta());
    let [train, val] = ["train/shard-00003.h5", "val/shard-00000.h5"];
    let samples = DataSet::open(twice.path()).unwrap();
    assert_eq!(samples.conditions(Split::Val).unwrap().len(), 4);
    fs::copy(
        twice.path().join("test/shard-00000.h5"),
        twice.path().join(val),
    )
    .unwrap();
    let findings = check(twice.path()).unwrap();
    let duplicates = findings
        .iter()
        .filter(|f| matches!(f, Finding::Duplicate { .. }));
    assert_eq!(duplicates.count(), 4);
    let said = findings[0].to_string();
    assert!(
        said.starts_with("sample 0 of test has the condition of sample 0 of val, ["),
        "{said}"
    );
    assert!(said.ends_with("a split knows what another asks"), "{said}");
    assert!(dir.path().join(train).exists());

    // Files that speak of other values than there are.
    let mut units = samples.normalisation().clone();
    units.scale *= 1.00005;
    units.save(dir.path()).unwrap();
    assert_eq!(check(dir.path()).unwrap(), []);
    units.scale *= 1.01;
    units.save(dir.path()).unwrap();
    let error = check(dir.path()).unwrap_err();
    assert!(
        matches!(
            error,
            DataError::Disagrees {
                dataset: "scale",
                ..
            }
        ),
        "{error}"
    );
}
