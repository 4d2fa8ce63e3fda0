//! Reading data sets, others' and damaged ones.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod common;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use common::{CHUNKED, chunked, collect, meta};
use hdf5_pure::FileBuilder;
use proptest::prelude::*;
use tdcr_learn::data::{DataError, DataSet, Finding, Normalisation, Sample, Split, check};
use tdcr_learn::net::Channels;
use tempfile::{TempDir, tempdir};

fn error(dir: &TempDir) -> DataError {
    let set = DataSet::open(dir.path()).unwrap();
    let (raw, normalised) = (set.read_split(Split::Val), set.cloud_set(Split::Val));
    assert_eq!(
        raw.unwrap_err().to_string(),
        normalised.unwrap_err().to_string()
    );
    set.read_split(Split::Val).unwrap_err()
}

#[test]
fn a_compressed_set_written_by_h5py_is_read() {
    let set = DataSet::open(Path::new(CHUNKED)).unwrap();
    assert_eq!(set.meta(), None);
    let samples = set.read_split(Split::Train).unwrap();
    assert_eq!(samples.len(), 5);
    let f32s = |values: [f64; 3]| values.map(|value| value as f32);
    for (i, Sample { condition, cloud }) in samples.iter().enumerate() {
        let motors = &condition.motors;
        assert_eq!(condition.payload, None);
        let step = 0.01 * i as f64;
        assert_eq!(*motors, [step as f32, (0.01 * (i as f64 + 1.0)) as f32]);
        for k in 0..5 {
            assert_eq!(cloud.points[k], f32s([0.1 * k as f64, step, -0.2]));
            assert_eq!(cloud.colors[k], [k as u8, i as u8, 255]);
        }
    }
    let clouds = set.cloud_set(Split::Train).unwrap();
    assert_eq!(clouds.colors, None);
    let colored = set.cloud_set_in(Split::Train, set.normalisation(), Channels::XyzRgb);
    let colored = colored.unwrap();
    assert_eq!(colored.points, clouds.points);
    let mut rows = vec![];
    colored.gather(3, [4, 1].into_iter(), Channels::XyzRgb, &mut rows);
    let row = |k: usize| {
        let point = &clouds.cloud(3)[3 * k..3 * k + 3];
        [point, &[k as f32 / 255.0, 3.0 / 255.0, 1.0]].concat()
    };
    assert_eq!(rows, [row(4), row(1)].concat());
    assert_eq!(
        (clouds.len(), clouds.condition_dim, clouds.points_per_cloud),
        (5, 2, 5)
    );
    for i in 0..5 {
        for &condition in clouds.condition(i) {
            assert!((condition - 0.25 * i as f32).abs() < 1e-6);
        }
    }
    let radius = |point: &[f32; 3]| point.iter().map(|x| x * x).sum::<f32>().sqrt();
    let largest = clouds
        .points
        .as_chunks()
        .0
        .iter()
        .map(radius)
        .fold(0.0, f32::max);
    assert!((largest - 1.0).abs() < 1e-6);
}

/// The arrays of a good shard of one sample, two points and two motors.
fn good_shard() -> Vec<(&'static str, Vec<u64>, Vec<f32>)> {
    let scale = DataSet::open(Path::new(CHUNKED))
        .unwrap()
        .normalisation()
        .scale as f32;
    vec![
        ("data", vec![1, 2, 3], vec![0.1; 6]),
        ("rgb", vec![1, 2, 3], vec![7.0; 6]),
        ("motors", vec![1, 2], vec![0.0, 0.01]),
        ("motors_norm", vec![1, 2], vec![0.0, 0.0]),
        ("data_norm", vec![1, 2, 3], vec![0.1 / scale; 6]),
        ("center", vec![1, 3], vec![0.0; 3]),
        ("scale", vec![1], vec![scale]),
    ]
}

/// Writes the shard, `rgb` as bytes unless it is `mistyped`, anything else as floats unless it is.
fn write_shard(dir: &TempDir, arrays: &[(&str, Vec<u64>, Vec<f32>)], mistyped: &str) -> PathBuf {
    let mut builder = FileBuilder::new();
    for (name, shape, values) in arrays {
        let dataset = builder.create_dataset(name);
        if (*name == "rgb") == (*name == mistyped) {
            dataset.with_f32_data(values).with_shape(shape);
        } else {
            let bytes: Vec<u8> = values.iter().map(|&value| value as u8).collect();
            dataset.with_u8_data(&bytes).with_shape(shape);
        }
    }
    let path = dir.path().join("val/shard-00000.h5");
    builder.write(&path).unwrap();
    path
}

#[test]
fn the_good_shard_of_these_tests_is_good() {
    let dir = chunked();
    write_shard(&dir, &good_shard(), "");
    let set = DataSet::open(dir.path()).unwrap();
    assert_eq!(
        set.read_split(Split::Val).unwrap()[0].cloud.colors,
        [[7; 3]; 2]
    );
    assert_eq!(set.cloud_set(Split::Val).unwrap().conditions, [0.0, 0.0]);
}

#[test]
fn a_missing_array_is_reported_by_name() {
    for left_out in 0..7 {
        let dir = chunked();
        let mut arrays = good_shard();
        let (name, ..) = arrays.remove(left_out);
        let path = write_shard(&dir, &arrays, "");
        let error = error(&dir);
        assert!(
            matches!(&error, DataError::MissingDataset { path: p, dataset, .. } if *p == path && *dataset == name),
            "{error}"
        );
    }
}

#[test]
fn a_wrong_shape_is_reported_with_the_right_one() {
    for (wrong, shape) in [
        (0, vec![6]),
        (0, vec![2, 1, 3]),
        (0, vec![1, 3, 2]),
        (1, vec![2, 3]),
        (2, vec![2]),
        (2, vec![2, 1]),
        (2, vec![1, 1, 2]),
        (3, vec![2, 1]),
        (4, vec![1, 6]),
        (5, vec![3]),
        (6, vec![1, 1]),
    ] {
        let dir = chunked();
        let mut arrays = good_shard();
        arrays[wrong].1 = shape;
        write_shard(&dir, &arrays, "");
        let error = error(&dir);
        assert!(matches!(error, DataError::WrongShape { .. }), "{error}");
    }
}

#[test]
fn a_shape_beyond_what_the_file_can_hold_is_refused_before_it_is_allocated() {
    let dir = chunked();
    let path = dir.path().join("val/shard-00000.h5");
    let bytes = fs::read(&path).unwrap();
    let encode = |shape: [u64; 3]| shape.map(u64::to_le_bytes).concat();
    let (shape, absurd) = (encode([1, 5, 3]), encode([1 << 40, 5, 3]));
    let position = bytes
        .windows(24)
        .position(|window| window == shape)
        .unwrap();
    let absurd = [&bytes[..position], &absurd, &bytes[position + 24..]].concat();
    fs::write(&path, absurd).unwrap();
    let error = error(&dir);
    assert!(
        matches!(
            error,
            DataError::TooLarge {
                dataset: "data",
                ..
            }
        ),
        "{error}"
    );
}

/// Zeros take hardly a byte when they are compressed, and none in chunks that are not stored.
#[test]
fn arrays_that_a_file_does_not_hold_are_refused_before_they_are_allocated() {
    let dir = chunked();
    let mut builder = FileBuilder::new();
    let samples = 1_000_000;
    for (name, shape, _) in good_shard() {
        let shape = [&[samples], &shape[1..]].concat();
        let count = shape.iter().product::<u64>() as usize;
        let array = builder.create_dataset(name);
        if name == "rgb" {
            array.with_u8_data(&vec![0; count]);
        } else {
            array.with_f32_data(&vec![0.0; count]);
        }
        array.with_shape(&shape).with_chunks(&shape).with_deflate(9);
    }
    let path = dir.path().join("val/shard-00000.h5");
    builder.write(&path).unwrap();
    let length = fs::metadata(&path).unwrap().len();
    let error = error(&dir);
    assert!(
        matches!(&error, DataError::TooLarge { source, .. } if source.held == length && source.asked > source.limit),
        "{error}"
    );
}

#[test]
fn an_empty_array_is_reported() {
    let dir = chunked();
    let mut arrays = good_shard();
    for (_, shape, values) in &mut arrays {
        shape[0] = 0;
        values.clear();
    }
    write_shard(&dir, &arrays, "");
    assert!(matches!(
        error(&dir),
        DataError::WrongShape {
            dataset: "data",
            ..
        }
    ));
}

#[test]
fn a_wrong_type_is_reported_with_the_right_one() {
    for (name, ..) in good_shard() {
        let dir = chunked();
        write_shard(&dir, &good_shard(), name);
        let error = error(&dir);
        assert!(
            matches!(&error, DataError::WrongType { dataset, .. } if *dataset == name),
            "{error}"
        );
    }
}

#[test]
fn a_number_that_is_not_finite_is_reported_by_sample() {
    for array in [0, 2] {
        let dir = chunked();
        let mut arrays = good_shard();
        arrays[array].2[1] = f32::NAN;
        write_shard(&dir, &arrays, "");
        let error = error(&dir);
        assert!(
            matches!(error, DataError::NotFinite { sample: 0, .. }),
            "{error}"
        );
    }
}

#[test]
fn copies_normalised_in_another_way_are_refused() {
    for array in [3, 5, 6] {
        let dir = chunked();
        let mut arrays = good_shard();
        arrays[array].2[0] += 0.01;
        let name = arrays[array].0;
        write_shard(&dir, &arrays, "");
        let set = DataSet::open(dir.path()).unwrap();
        let error = set.cloud_set(Split::Val).unwrap_err();
        assert!(
            matches!(&error, DataError::Disagrees { dataset, .. } if *dataset == name),
            "{error}"
        );
    }
}

#[test]
fn a_shard_of_other_motors_or_points_than_the_set_is_refused() {
    let dir = tempdir().unwrap();
    collect(dir.path(), &meta());
    fs::copy(
        format!("{CHUNKED}/val/shard-00000.h5"),
        dir.path().join("val/shard-00000.h5"),
    )
    .unwrap();
    assert!(matches!(
        error(&dir),
        DataError::WrongShape {
            dataset: "data",
            ..
        }
    ));

    let dir = chunked();
    let normalisation = Normalisation {
        motor_min: vec![0.0; 3],
        motor_max: vec![1.0; 3],
        scale: 1.0,
    };
    normalisation.save(dir.path()).unwrap();
    assert!(matches!(
        error(&dir),
        DataError::WrongShape {
            dataset: "motors",
            ..
        }
    ));
}

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

/// A small shard of ours and one of h5py's, whole.
static WHOLE: LazyLock<[Vec<u8>; 2]> = LazyLock::new(|| {
    let dir = tempdir().unwrap();
    collect(dir.path(), &meta());
    [dir.path(), Path::new(CHUNKED)].map(|dir| fs::read(dir.join("val/shard-00000.h5")).unwrap())
});

/// One folder for all damaged shards, which are many.
static DAMAGED: LazyLock<TempDir> = LazyLock::new(chunked);

/// Reads a set whose val shard holds `bytes`; a panic fails the test, whatever is returned.
fn read_damaged(dir: &TempDir, bytes: &[u8]) -> Result<(), DataError> {
    let path = dir.path().join("val/shard-00000.h5");
    // A file written in place of another is flushed to the disk by some file systems, which is slow.
    fs::remove_file(&path).unwrap();
    fs::write(&path, bytes).unwrap();
    let set = DataSet::open(dir.path())?;
    set.read_split(Split::Val)?;
    set.cloud_set(Split::Val)?;
    Ok(())
}

#[test]
fn a_truncated_shard_is_refused_at_every_length() {
    let dir = chunked();
    for whole in WHOLE.iter() {
        for length in 0..whole.len() {
            let refused = read_damaged(&dir, &whole[..length]);
            assert!(
                matches!(refused, Err(DataError::Unreadable { .. })),
                "{length}"
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn no_damage_to_a_shard_makes_the_reader_panic(
        file in 0..2_usize,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = WHOLE[file].clone();
        for (position, value) in damage {
            let position = position.index(bytes.len());
            bytes[position] = value;
        }
        // Damage to the numbers themselves cannot be told from numbers.
        let _ = read_damaged(&DAMAGED, &bytes);
    }
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
