//! Sets whose files do not belong together, or claim too much.

use std::fs;

use tdcr_learn::data::{DataError, DataSet, Finding, Split, check};
use tempfile::tempdir;

use crate::common::{chunked, collect, meta};

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
