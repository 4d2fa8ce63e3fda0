//! Making a data set: whatever interrupts it, the result is the same, and nothing else is overwritten.

use std::collections::BTreeMap;
use std::fs;
use std::ops::ControlFlow::{Break, Continue};
use std::path::Path;
use std::sync::LazyLock;

use serde_json::json;
use tdcr_learn::data::{Collector, DataError, DataSet, Sample, Split};
use tempfile::tempdir;

use crate::common::{
    collect, files, loaded_meta, loaded_sample, meta, restore, sample, write_missing_blocks,
};

/// The files of a data set that was made without interruption.
static UNINTERRUPTED: LazyLock<BTreeMap<String, Vec<u8>>> = LazyLock::new(|| {
    let dir = tempdir().unwrap();
    collect(dir.path(), &meta());
    files(dir.path())
});

fn assert_same(dir: &Path) {
    let (found, expected) = (files(dir), &*UNINTERRUPTED);
    assert_eq!(
        found.keys().collect::<Vec<_>>(),
        expected.keys().collect::<Vec<_>>()
    );
    for (name, bytes) in expected {
        assert!(found[name] == *bytes, "{name} differs");
    }
}

fn write_block(collector: &Collector, block: std::ops::Range<usize>) {
    let samples: Vec<Sample> = block.clone().map(sample).collect();
    collector.write_block(block.start, &samples).unwrap();
}

#[test]
fn a_data_set_consists_of_the_files_of_the_layout() {
    let names: Vec<String> = UNINTERRUPTED.keys().cloned().collect();
    let shards = |split: &str, count| {
        (0..count)
            .map(|k| format!("{split}/shard-{k:05}.h5"))
            .collect::<Vec<_>>()
    };
    let mut expected = vec![
        "global_motors_scope-all.json".to_owned(),
        "global_norm_scope-all_anchor-origin.json".to_owned(),
        "meta.json".to_owned(),
    ];
    // 43 samples: 35 to train in shards of 10, 4 and 4.
    expected.extend(shards("test", 1));
    expected.extend(shards("train", 4));
    expected.extend(shards("val", 1));
    assert_eq!(names, expected);
}

#[test]
fn the_normalisation_files_have_the_layout_that_others_read() {
    let parse =
        |name: &str| serde_json::from_slice::<serde_json::Value>(&UNINTERRUPTED[name]).unwrap();
    let max = [42.0 / 65536.0, 142.0 / 65536.0];
    let min = [0.0, 100.0 / 65536.0];
    assert_eq!(
        parse("global_motors_scope-all.json"),
        json!({"all": {"min": min, "max": max, "scale": [max[0] - min[0], max[1] - min[1]]}})
    );
    let scale = f64::hypot(f64::hypot(42.0 / 1024.0, 5.0 / 1024.0), 0.125) as f32;
    assert_eq!(
        parse("global_norm_scope-all_anchor-origin.json"),
        json!({"all": {"center": [0.0, 0.0, 0.0], "scale": f64::from(scale)}})
    );
}

#[test]
fn an_interruption_after_any_block_changes_no_byte() {
    let blocks = Collector::open(tempdir().unwrap().path(), &meta())
        .unwrap()
        .missing_blocks()
        .len();
    assert_eq!(blocks, 6);
    for done in 0..=blocks {
        let dir = tempdir().unwrap();
        let collector = Collector::open(dir.path(), &meta()).unwrap();
        for block in collector.missing_blocks().into_iter().take(done) {
            write_block(&collector, block);
        }
        drop(collector);
        let collector = Collector::open(dir.path(), &meta()).unwrap();
        assert_eq!(collector.missing_blocks().len(), blocks - done);
        write_missing_blocks(&collector);
        collector.finish(|_, _| Continue(())).unwrap();
        assert_same(dir.path());
    }
}

#[test]
fn an_interruption_at_any_step_of_finishing_changes_no_byte() {
    for interrupted_at in 1..=12 {
        let dir = tempdir().unwrap();
        let collector = Collector::open(dir.path(), &meta()).unwrap();
        write_missing_blocks(&collector);
        let interrupted = collector.finish(|step, steps| {
            assert_eq!(steps, 12);
            match step == interrupted_at {
                true => Break(()),
                false => Continue(()),
            }
        });
        assert!(matches!(interrupted, Err(DataError::Interrupted)));
        assert!(matches!(
            DataSet::open(dir.path()),
            Err(DataError::Incomplete { .. })
        ));
        let collector = Collector::open(dir.path(), &meta()).unwrap();
        assert!(collector.missing_blocks().is_empty());
        collector.finish(|_, _| Continue(())).unwrap();
        assert_same(dir.path());
    }
}

#[test]
fn an_interruption_between_any_two_files_changes_no_byte() {
    let staged = tempdir().unwrap();
    let collector = Collector::open(staged.path(), &meta()).unwrap();
    write_missing_blocks(&collector);
    drop(collector);
    let (staged, finished) = (files(staged.path()), &*UNINTERRUPTED);
    // `meta.json` comes last, so any subset of the other files can be there without it.
    for (left_out, _) in finished.iter().filter(|(name, _)| *name != "meta.json") {
        let dir = tempdir().unwrap();
        restore(dir.path(), &staged);
        restore(dir.path(), finished);
        fs::remove_file(dir.path().join("meta.json")).unwrap();
        fs::rename(
            dir.path().join(left_out),
            dir.path().join(left_out.clone() + ".tmp"),
        )
        .unwrap();
        Collector::open(dir.path(), &meta())
            .unwrap()
            .finish(|_, _| Continue(()))
            .unwrap();
        assert_same(dir.path());
    }
    // After it, the staging folder may still be there, in part.
    for (left, bytes) in &staged {
        let dir = tempdir().unwrap();
        restore(dir.path(), finished);
        restore(dir.path(), &[(left.clone(), bytes.clone())].into());
        let collector = Collector::open(dir.path(), &meta()).unwrap();
        assert!(collector.missing_blocks().is_empty());
        collector.finish(|_, _| Continue(())).unwrap();
        assert_same(dir.path());
    }
}

#[test]
fn an_interruption_while_opening_changes_no_byte() {
    for left in [".partial/lock", ".partial/meta.json.tmp"] {
        let dir = tempdir().unwrap();
        restore(dir.path(), &[(left.to_owned(), b"{".to_vec())].into());
        collect(dir.path(), &meta());
        assert_same(dir.path());
    }
}

#[test]
fn a_block_that_is_not_whole_is_made_again() {
    let dir = tempdir().unwrap();
    let collector = Collector::open(dir.path(), &meta()).unwrap();
    let missing = &collector.missing_blocks()[1..2];
    write_missing_blocks(&collector);
    let path = dir.path().join(".partial/block-00000008.h5");
    let whole = fs::read(&path).unwrap();
    for length in (0..whole.len()).step_by(23).chain([whole.len() - 1]) {
        fs::write(&path, &whole[..length]).unwrap();
        assert_eq!(collector.missing_blocks(), *missing, "{length}");
    }
    fs::rename(&path, path.with_added_extension("tmp")).unwrap();
    assert_eq!(collector.missing_blocks(), *missing);
    write_missing_blocks(&collector);
    collector.finish(|_, _| Continue(())).unwrap();
    assert_same(dir.path());
}

#[test]
fn threads_in_any_order_give_the_same_bytes() {
    let dir = tempdir().unwrap();
    let collector = Collector::open(dir.path(), &meta()).unwrap();
    let blocks = collector.missing_blocks();
    std::thread::scope(|scope| {
        for thread in 0..3 {
            let (collector, blocks) = (&collector, &blocks);
            let blocks = blocks.iter().rev().skip(thread).step_by(3);
            scope.spawn(move || blocks.for_each(|block| write_block(collector, block.clone())));
        }
    });
    collector.finish(|_, _| Continue(())).unwrap();
    assert_same(dir.path());
}

#[test]
fn a_complete_data_set_is_left_as_it_is() {
    let dir = tempdir().unwrap();
    collect(dir.path(), &meta());
    let collector = Collector::open(dir.path(), &meta()).unwrap();
    assert!(collector.missing_blocks().is_empty());
    let refused = collector.write_block(0, &(0..8).map(sample).collect::<Vec<_>>());
    assert!(matches!(refused, Err(DataError::Complete { .. })));
    collector.finish(|_, _| Continue(())).unwrap();
    assert_same(dir.path());
}

/// Writing to the device `/dev/full` fails as writing to a full disk does.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_reported_by_path_and_costs_no_other_block() {
    let dir = tempdir().unwrap();
    let collector = Collector::open(dir.path(), &meta()).unwrap();
    write_block(&collector, 0..8);
    std::os::unix::fs::symlink(
        "/dev/full",
        dir.path().join(".partial/block-00000008.h5.tmp"),
    )
    .unwrap();
    let error = collector
        .write_block(8, &(8..16).map(sample).collect::<Vec<_>>())
        .unwrap_err();
    assert!(error.to_string().contains("block-00000008.h5"), "{error}");
    assert!(
        matches!(error, DataError::Io { source, .. } if source.kind() == std::io::ErrorKind::StorageFull)
    );
    assert_eq!(collector.missing_blocks()[0], 8..16);
    write_missing_blocks(&collector);

    fs::create_dir(dir.path().join("val")).unwrap();
    std::os::unix::fs::symlink("/dev/full", dir.path().join("val/shard-00000.h5.tmp")).unwrap();
    let error = collector.finish(|_, _| Continue(())).unwrap_err();
    assert!(error.to_string().contains("val/shard-00000.h5"), "{error}");
    Collector::open(dir.path(), &meta())
        .unwrap()
        .finish(|_, _| Continue(()))
        .unwrap();
    assert_same(dir.path());
}

#[test]
fn what_is_written_is_read_back() {
    let dir = tempdir().unwrap();
    collect(dir.path(), &meta());
    let set = DataSet::open(dir.path()).unwrap();
    assert_eq!(set.meta(), Some(&meta()));
    let splits = tdcr_learn::data::split_indices(43, 7).unwrap();
    for split in Split::ALL {
        let expected: Vec<Sample> = splits
            .of(split)
            .iter()
            .map(|&index| sample(index))
            .collect();
        assert_eq!(set.read_split(split).unwrap(), expected);
        let clouds = set.cloud_set(split).unwrap();
        assert_eq!(clouds.len(), expected.len());
        for (k, sample) in expected.iter().enumerate() {
            assert_eq!(
                clouds.condition(k),
                set.normalisation()
                    .condition(&sample.condition.to_vec())
                    .unwrap()
            );
            let mut points = clouds.cloud(k).to_vec();
            set.normalisation().denormalise_points(&mut points);
            for (found, expected) in std::iter::zip(&points, sample.cloud.points.as_flattened()) {
                assert!((found - expected).abs() < 1e-7);
            }
        }
    }
}

#[test]
fn payloads_are_the_last_of_the_motors_and_an_array_of_their_own() {
    let dir = tempdir().unwrap();
    let collector = Collector::open(dir.path(), &loaded_meta()).unwrap();
    for block in collector.missing_blocks() {
        let samples: Vec<Sample> = block.clone().map(loaded_sample).collect();
        collector.write_block(block.start, &samples).unwrap();
    }
    assert!(collector.missing_blocks().is_empty());
    collector.finish(|_, _| Continue(())).unwrap();

    let set = DataSet::open(dir.path()).unwrap();
    let split = &tdcr_learn::data::split_indices(43, 7).unwrap();
    for (k, sample) in set.read_split(Split::Train).unwrap().iter().enumerate() {
        assert_eq!(*sample, loaded_sample(split.train[k]));
    }
    let clouds = set.cloud_set(Split::Val).unwrap();
    assert_eq!(clouds.condition_dim, 3);
    for (k, &index) in split.val.iter().enumerate() {
        let expected = index as f32 / 42.0;
        assert!((clouds.condition(k)[2] - expected).abs() < 1e-6);
    }
    // A shard without payloads does not belong here, and one whose copies differ is refused.
    let plain = tempdir().unwrap();
    collect(plain.path(), &meta());
    let shard = "val/shard-00000.h5";
    let whole = fs::read(dir.path().join(shard)).unwrap();
    fs::copy(plain.path().join(shard), dir.path().join(shard)).unwrap();
    let error = set.read_split(Split::Val).unwrap_err();
    assert!(matches!(error, DataError::PayloadArray { .. }), "{error}");
    let stored = (split.val[0] as f32 / 2048.0).to_le_bytes();
    let row = |bytes: &[u8]| bytes.windows(4).rposition(|window| window == stored);
    let mut damaged = whole.clone();
    let place = row(&whole).unwrap();
    damaged[place + 3] ^= 0x80;
    fs::write(dir.path().join(shard), damaged).unwrap();
    let error = set.read_split(Split::Val).unwrap_err();
    assert!(
        matches!(error, DataError::Disagrees { sample: 0, .. }),
        "{error}"
    );
}
