//! Shards that are not what they should be.

use std::fs;
use std::path::{Path, PathBuf};

use hdf5_pure::FileBuilder;
use tdcr_learn::data::{DataError, DataSet, Normalisation, Split};
use tempfile::{TempDir, tempdir};

use super::error;
use crate::common::{CHUNKED, chunked, collect, meta};

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

/// A shard that h5py wrote with the newest features: sound, but newer than the reader.
#[test]
fn a_shard_with_chunks_of_a_newer_version_is_not_called_damaged() {
    let dir = chunked();
    let latest = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/latest.h5");
    let shard = dir.path().join("val/shard-00000.h5");
    fs::copy(latest, &shard).unwrap();
    let said = DataSet::open(dir.path())
        .and_then(|set| set.read_split(Split::Val))
        .unwrap_err()
        .to_string();
    let expected = "cannot read dataset `data`: its data layout is of version 5, newer than this reader knows (up to 4)";
    assert!(said.contains(expected), "{said}");
    assert!(said.contains("h5repack"), "{said}");
}

#[cfg(unix)]
#[test]
fn a_device_is_no_shard() {
    let dir = chunked();
    let shard = dir.path().join("val/shard-00000.h5");
    fs::remove_file(&shard).unwrap();
    std::os::unix::fs::symlink("/dev/zero", &shard).unwrap();
    let read = DataSet::open(dir.path()).and_then(|set| set.read_split(Split::Val));
    let said = read.unwrap_err().to_string();
    assert!(said.contains("not a regular file"), "{said}");
}
