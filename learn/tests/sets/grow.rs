//! A data set that grows ends as if it had been of its size from the start, whatever interrupts it.

use std::collections::BTreeMap;
use std::fs;
use std::ops::ControlFlow::Continue;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::LazyLock;

use tdcr_learn::data::{Collector, DataError, DataSet, Design, Meta, Origin, Sample, Split};
use tempfile::{TempDir, tempdir};

use crate::common::{
    collect, files, loaded_meta, loaded_sample, meta, restore, sample, write_missing_blocks,
};

/// The set of 43 samples, made at once.
static AT_ONCE: LazyLock<BTreeMap<String, Vec<u8>>> = LazyLock::new(|| {
    let dir = tempdir().unwrap();
    collect(dir.path(), &meta());
    files(dir.path())
});

fn of_count(count: usize) -> Meta {
    Meta { count, ..meta() }
}

/// A complete set of fewer samples.
fn smaller(count: usize) -> TempDir {
    let dir = tempdir().unwrap();
    collect(dir.path(), &of_count(count));
    dir
}

fn assert_same(dir: &Path) {
    let found = files(dir);
    assert!(
        found.keys().eq(AT_ONCE.keys()),
        "{:?}",
        found.keys().collect::<Vec<_>>()
    );
    for (name, bytes) in &*AT_ONCE {
        assert!(found[name] == *bytes, "{name} differs");
    }
}

#[test]
fn a_set_that_grows_keeps_its_samples_and_ends_as_one_made_at_once() {
    for count in [10, 16, 29, 42] {
        let dir = smaller(count);
        let collector = Collector::open(dir.path(), &meta()).unwrap();
        let mut told = vec![];
        collector
            .keep_samples(|done, all| {
                told.push((done, all));
                Continue(())
            })
            .unwrap();
        let kept = count / 8;
        assert_eq!(
            told,
            (1..=kept).map(|done| (done, kept)).collect::<Vec<_>>()
        );
        assert_eq!(collector.missing_blocks().len(), 6 - kept, "{count}");
        // The smaller set can be read until the larger one is there.
        let set = DataSet::open(dir.path()).unwrap();
        assert_eq!(set.meta(), Some(&of_count(count)));
        assert!(set.read_split(Split::Test).is_ok());
        write_missing_blocks(&collector);
        collector.finish(|_, _| Continue(())).unwrap();
        assert_same(dir.path());
    }
}

#[test]
fn kept_samples_are_read_from_the_smaller_set_with_their_payloads() {
    let dir = tempdir().unwrap();
    let write = |collector: &Collector, blocks: &[std::ops::Range<usize>]| {
        for block in blocks {
            let samples: Vec<Sample> = block.clone().map(loaded_sample).collect();
            collector.write_block(block.start, &samples).unwrap();
        }
    };
    let open = |count| {
        let meta = Meta {
            count,
            ..loaded_meta()
        };
        let collector = Collector::open(dir.path(), &meta).unwrap();
        collector.keep_samples(|_, _| Continue(())).unwrap();
        collector
    };
    let collector = open(24);
    write(&collector, &collector.missing_blocks());
    collector.finish(|_, _| Continue(())).unwrap();
    let collector = open(43);
    let missing = collector.missing_blocks();
    assert_eq!(missing, [24..32, 32..40, 40..43]);
    write(&collector, &missing);
    collector.finish(|_, _| Continue(())).unwrap();
    let set = DataSet::open(dir.path()).unwrap();
    let splits = tdcr_learn::data::split_indices(43, 7).unwrap();
    for split in Split::ALL {
        let expected = splits.of(split).iter().map(|&index| loaded_sample(index));
        assert_eq!(set.read_split(split).unwrap(), expected.collect::<Vec<_>>());
    }
}

#[test]
fn growth_that_is_interrupted_anywhere_changes_no_byte() {
    // Before finishing: after any block that is kept or made.
    for done in 0..=6 {
        let dir = smaller(29);
        let collector = Collector::open(dir.path(), &meta()).unwrap();
        let kept = catch_unwind(AssertUnwindSafe(|| {
            collector.keep_samples(|step, _| {
                assert_ne!(step, done, "interruption");
                Continue(())
            })
        }));
        assert_eq!(kept.is_err(), (1..=3).contains(&done));
        for block in collector.missing_blocks().into_iter().take(done) {
            let samples: Vec<Sample> = block.clone().map(sample).collect();
            collector.write_block(block.start, &samples).unwrap();
        }
        drop(collector);
        // Asked for as it was, the smaller set is complete, and what was staged for the larger one stays.
        let staged = files(dir.path());
        let as_it_was = Collector::open(dir.path(), &of_count(29)).unwrap();
        assert!(as_it_was.missing_blocks().is_empty());
        as_it_was.finish(|_, _| Continue(())).unwrap();
        assert!(files(dir.path()) == staged);
        let collector = Collector::open(dir.path(), &meta()).unwrap();
        collector.keep_samples(|_, _| Continue(())).unwrap();
        write_missing_blocks(&collector);
        collector.finish(|_, _| Continue(())).unwrap();
        assert_same(dir.path());
    }
    // While finishing, the smaller set's files are replaced one by one.
    for interrupted_at in 1..=12 {
        let dir = smaller(29);
        let collector = Collector::open(dir.path(), &meta()).unwrap();
        write_missing_blocks(&collector);
        let interrupted = catch_unwind(AssertUnwindSafe(|| {
            collector.finish(|step, _| {
                assert_ne!(step, interrupted_at, "interruption");
                Continue(())
            })
        }));
        assert!(interrupted.is_err());
        match DataSet::open(dir.path()) {
            Ok(set) => {
                assert_eq!(set.meta(), Some(&of_count(29)));
                assert!(
                    Split::ALL
                        .map(|split| set.read_split(split))
                        .iter()
                        .all(Result::is_ok)
                );
            }
            Err(error) => assert!(matches!(error, DataError::Incomplete { .. }), "{error}"),
        }
        let collector = Collector::open(dir.path(), &meta()).unwrap();
        collector.keep_samples(|_, _| Continue(())).unwrap();
        assert!(collector.missing_blocks().is_empty());
        collector.finish(|_, _| Continue(())).unwrap();
        assert_same(dir.path());
    }
}

#[test]
fn an_unfinished_set_grows_too() {
    let dir = tempdir().unwrap();
    let collector = Collector::open(dir.path(), &of_count(20)).unwrap();
    write_missing_blocks(&collector);
    drop(collector);
    let collector = Collector::open(dir.path(), &meta()).unwrap();
    collector.keep_samples(|_, _| Continue(())).unwrap();
    // Of 20 samples the last four are no whole block of 43.
    assert_eq!(collector.missing_blocks().len(), 4);
    write_missing_blocks(&collector);
    collector.finish(|_, _| Continue(())).unwrap();
    assert_same(dir.path());
}

#[test]
fn a_set_that_cannot_take_the_size_says_so_by_field_and_says_the_way_on() {
    let refused = |dir: &Path, meta: &Meta, expected: &str| {
        let before = files(dir);
        let error = Collector::open(dir, meta).unwrap_err();
        assert!(matches!(error, DataError::OtherCount { .. }), "{error}");
        let said = error.to_string();
        assert!(said.contains(expected), "{said}");
        assert!(said.contains("choose another folder"), "{said}");
        assert!(files(dir) == before);
    };
    let dir = smaller(29);
    let fewer = "holds 29 samples and `samples` is 20: a data set can grow, not shrink; ask for 29";
    refused(dir.path(), &of_count(20), fewer);
    // What is begun counts once it holds samples.
    drop(Collector::open(dir.path(), &meta()).unwrap());
    let growing = Collector::open(dir.path(), &meta()).unwrap();
    growing.keep_samples(|_, _| Continue(())).unwrap();
    drop(growing);
    refused(
        dir.path(),
        &of_count(40),
        "holds 43 samples and `samples` is 40",
    );
    for design in [Design::LatinHypercube, Design::Grid] {
        let of_design = |count| {
            let mut meta = of_count(count);
            if let Origin::Simulated { design: found, .. } = &mut meta.origin {
                *found = design;
            }
            meta
        };
        let dir = tempdir().unwrap();
        collect(dir.path(), &of_design(29));
        let expected = format!(
            "the places of a {} design depend on how many",
            design.name()
        );
        refused(dir.path(), &of_design(43), &expected);
    }
    let imported = |count| Meta {
        origin: Origin::Imported {
            source: "clouds".to_owned(),
            split: None,
        },
        ..of_count(count)
    };
    let dir = tempdir().unwrap();
    collect(dir.path(), &imported(29));
    refused(
        dir.path(),
        &imported(43),
        "its clouds were imported all at once",
    );
}

#[test]
fn a_set_that_another_process_lets_grow_is_left_alone() {
    let dir = smaller(29);
    let growing = Collector::open(dir.path(), &meta()).unwrap();
    let error = Collector::open(dir.path(), &meta()).unwrap_err();
    assert!(matches!(error, DataError::InUse { .. }), "{error}");
    write_missing_blocks(&growing);
    growing.finish(|_, _| Continue(())).unwrap();
    assert_same(dir.path());
}

#[test]
fn a_damaged_smaller_set_is_named_and_nothing_of_it_replaced() {
    let dir = smaller(29);
    let whole = files(dir.path());
    let shard = dir.path().join("val/shard-00000.h5");
    let bytes = fs::read(&shard).unwrap();
    fs::write(&shard, &bytes[..bytes.len() / 2]).unwrap();
    let collector = Collector::open(dir.path(), &meta()).unwrap();
    let error = collector.keep_samples(|_, _| Continue(())).unwrap_err();
    assert!(error.to_string().contains("val/shard-00000.h5"), "{error}");
    drop(collector);
    restore(dir.path(), &whole);
    let collector = Collector::open(dir.path(), &meta()).unwrap();
    collector.keep_samples(|_, _| Continue(())).unwrap();
    write_missing_blocks(&collector);
    collector.finish(|_, _| Continue(())).unwrap();
    assert_same(dir.path());
}
