//! Parts of a data set: put together they are the set made at once, whatever interrupts them, and nothing else is.

use std::fs;
use std::ops::ControlFlow::{Break, Continue};
use std::path::{Path, PathBuf};

use tdcr_base::Part;
use tdcr_learn::data::{Collector, DataError, DataSet, Meta, Sample, check, merge};
use tempfile::tempdir;

use crate::common::{
    collect, files, loaded_meta, loaded_sample, meta, sample, write_missing_blocks,
};

fn part(text: &str) -> Part {
    text.parse().unwrap()
}

/// Makes up to `most` blocks of a part.
fn collect_blocks(dir: &Path, meta: &Meta, part: Part, most: usize) {
    let collector = Collector::open_part(dir, meta, part).unwrap();
    let make = if meta.has_payload() {
        loaded_sample
    } else {
        sample
    };
    for block in collector.missing_blocks().into_iter().take(most) {
        let samples: Vec<Sample> = block.clone().map(make).collect();
        collector.write_block(block.start, &samples).unwrap();
    }
    if collector.missing_blocks().is_empty() {
        collector.finish(|_, _| Continue(())).unwrap();
    }
}

/// Makes all parts of a data set below `dir`.
fn collect_parts(dir: &Path, meta: &Meta, of: usize) -> Vec<PathBuf> {
    let make = |number: usize| {
        let folder = dir.join(format!("part-{number}"));
        collect_blocks(&folder, meta, Part::new(number, of).unwrap(), usize::MAX);
        folder
    };
    (1..=of).map(make).collect()
}

fn merged(parts: &[PathBuf], out: &Path) -> Result<Meta, DataError> {
    merge(parts, out, |_, _| Continue(()))
}

fn refusal(parts: &[PathBuf], out: &Path) -> String {
    let text = merged(parts, out).unwrap_err().to_string();
    assert!(!out.exists(), "{text}");
    text
}

#[test]
fn any_number_of_parts_gives_the_files_of_one_run() {
    for (meta, loaded) in [(meta(), false), (loaded_meta(), true)] {
        let folder = tempdir().unwrap();
        let whole = folder.path().join("whole");
        if loaded {
            let parts = collect_parts(&folder.path().join("one"), &meta, 1);
            merged(&parts, &whole).unwrap();
            assert_eq!(check(&whole).unwrap(), []);
        } else {
            collect(&whole, &meta);
        }
        // 43 samples in 50 parts: some parts have none.
        for of in if loaded {
            &[1, 3][..]
        } else {
            &[1, 2, 3, 7, 50]
        } {
            let parts = folder.path().join(format!("of-{of}"));
            let mut parts = collect_parts(&parts, &meta, *of);
            let before: Vec<_> = parts.iter().map(|part| files(part)).collect();
            parts.reverse();
            let out = folder.path().join(format!("merged-{of}"));
            assert_eq!(merged(&parts, &out).unwrap(), meta);
            assert!(files(&out) == files(&whole), "{of} parts");
            parts.reverse();
            assert!(before == parts.iter().map(|part| files(part)).collect::<Vec<_>>());
            // Merged again, there is nothing to do.
            merge(&parts, &out, |_, _| panic!("a step")).unwrap();
        }
    }
}

#[test]
fn an_interrupted_part_and_an_interrupted_merge_change_no_byte() {
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    collect(&path("whole"), &meta());
    let expected = files(&path("whole"));
    let parts = collect_parts(folder.path(), &meta(), 3);
    for done in 0..2 {
        fs::remove_dir_all(&parts[1]).unwrap();
        collect_blocks(&parts[1], &meta(), part("2/3"), done);
        let said = refusal(&parts, &path("early"));
        let missing = 14 - 8 * done;
        let expected = format!("part 2 of 3 unfinished: {missing} of its 14 samples are missing");
        assert!(said.contains(&expected), "{said}");
        collect_blocks(&parts[1], &meta(), part("2/3"), usize::MAX);
    }
    for interrupted_at in 1..=12 {
        let out = path(&format!("out-{interrupted_at}"));
        let interrupted = merge(&parts, &out, |step, steps| {
            assert_eq!(steps, 12);
            match step == interrupted_at {
                true => Break(()),
                false => Continue(()),
            }
        });
        assert!(matches!(interrupted, Err(DataError::Interrupted)));
        assert!(matches!(
            DataSet::open(&out),
            Err(DataError::Incomplete { .. })
        ));
        merged(&parts, &out).unwrap();
        assert!(files(&out) == expected, "{interrupted_at}");
    }
    // A truncated file of samples is made again.
    let block = parts[0].join("blocks/block-00000008.h5");
    fs::write(&block, &fs::read(&block).unwrap()[..200]).unwrap();
    assert!(refusal(&parts, &path("early")).contains("part 1 of 3 unfinished: 6 of its 14"));
    collect_blocks(&parts[0], &meta(), part("1/3"), usize::MAX);
    merged(&parts, &path("repaired")).unwrap();
    assert!(files(&path("repaired")) == expected);
}

#[test]
fn a_merged_set_grows_and_a_smaller_set_becomes_the_merged_one() {
    let folder = tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    collect(&path("whole"), &meta());
    let small = Meta {
        count: 20,
        ..meta()
    };
    collect(&path("grown"), &small);
    let parts = collect_parts(folder.path(), &meta(), 2);
    merged(&parts, &path("grown")).unwrap();
    assert!(files(&path("grown")) == files(&path("whole")));
    let few = collect_parts(&path("few"), &small, 2);
    merged(&few, &path("more")).unwrap();
    let collector = Collector::open(&path("more"), &meta()).unwrap();
    collector.keep_samples(|_, _| Continue(())).unwrap();
    write_missing_blocks(&collector);
    collector.finish(|_, _| Continue(())).unwrap();
    assert!(files(&path("more")) == files(&path("whole")));
}

#[test]
fn folders_that_are_not_the_parts_of_one_set_are_refused_by_name() {
    let folder = tempdir().unwrap();
    let out = folder.path().join("out");
    let parts = collect_parts(folder.path(), &meta(), 3);
    let says = |parts: &[&PathBuf], expected: &str| {
        let parts: Vec<PathBuf> = parts.iter().map(|&part| part.clone()).collect();
        let said = refusal(&parts, &out);
        assert!(said.contains(expected), "{said}");
    };
    let [one, two, three] = [&parts[0], &parts[1], &parts[2]];
    says(&[], "there are no parts to merge");
    says(&[one, three], "1 of 3 parts is missing: 2; expected all 3");
    says(&[two], "2 of 3 parts are missing: 1, 3; expected all 3");
    says(&[one, two, three, two], "both hold part 2 of 3");
    let nowhere = folder.path().join("nowhere");
    says(&[one, &nowhere], "nowhere holds nothing");
    let whole = folder.path().join("whole");
    collect(&whole, &meta());
    says(
        &[one, &whole],
        "whole holds a whole data set, expected a part",
    );
    says(&[&folder.path().to_owned()], "holds no part of a data set");

    let other = |name: &str, change: &dyn Fn(&mut Meta), of: usize| {
        let mut meta = meta();
        change(&mut meta);
        collect_parts(&folder.path().join(name), &meta, of).remove(0)
    };
    let seeded = other("seeded", &|meta| meta.seed = 8, 3);
    says(&[one, &seeded], "its `seed` is 8, not 7");
    let older = other("older", &|meta| meta.tdcr_version = "0.0.9".into(), 3);
    says(
        &[one, &older],
        r#"its `tdcr_version` is "0.0.9", not "0.1.0""#,
    );
    let more = other("more", &|meta| meta.count = 44, 3);
    says(&[one, &more], "its `count` is 44, not 43");
    says(
        &[one, &other("of-2", &|_| {}, 2)],
        "its `parts` is 2, not 3",
    );
    let loaded = collect_parts(&folder.path().join("loaded"), &loaded_meta(), 3);
    says(
        &[one, &loaded[1]],
        "origin.simulated.recipe.subject.payload",
    );
}

#[test]
fn a_part_is_not_read_as_a_set_nor_overwritten_as_one() {
    let folder = tempdir().unwrap();
    let parts = collect_parts(folder.path(), &meta(), 2);
    let kept = files(&parts[0]);
    let says = |error: DataError, expected: &str| {
        let said = error.to_string();
        assert!(said.contains(expected), "{said}");
        assert!(files(&parts[0]) == kept);
    };
    let unmerged = "part-1 holds part 1 of 2 of a data set; merge all 2 first";
    says(DataSet::open(&parts[0]).unwrap_err(), unmerged);
    says(check(&parts[0]).unwrap_err(), unmerged);
    let opened = |meta: &Meta, part: Part| Collector::open_part(&parts[0], meta, part).unwrap_err();
    says(
        opened(&meta(), part("2/2")),
        "holds part 1 of 2 of a data set, expected part 2 of 2 of a data set; choose another folder",
    );
    let seeded = Meta { seed: 8, ..meta() };
    says(opened(&seeded, part("1/2")), "its `seed` is 7, not 8");
    for (count, reason) in [(50, "its parts cannot"), (40, "grow, not shrink")] {
        says(opened(&Meta { count, ..meta() }, part("1/2")), reason);
    }
    says(
        Collector::open(&parts[0], &meta()).unwrap_err(),
        "holds part 1 of 2 of a data set, expected a whole data set; choose another folder",
    );
    says(
        merged(&parts, &parts[0]).unwrap_err(),
        "expected a whole data set",
    );
    let beside = merged(&parts, folder.path()).unwrap_err();
    says(beside, "holds `part-1` and is no data set of ours");

    // Nor is a whole set, complete or not, a part's.
    for name in ["begun", "whole"] {
        let dir = folder.path().join(name);
        if name == "whole" {
            collect(&dir, &meta());
        } else {
            drop(Collector::open(&dir, &meta()).unwrap());
        }
        let error = Collector::open_part(&dir, &meta(), part("1/2")).unwrap_err();
        says(
            error,
            "holds a whole data set, expected part 1 of 2 of a data set",
        );
    }
    let held = Collector::open_part(&parts[0], &meta(), part("1/2")).unwrap();
    assert!(matches!(
        opened(&meta(), part("1/2")),
        DataError::InUse { .. }
    ));
    drop(held);
}

#[test]
fn a_damaged_file_of_a_part_is_named() {
    let folder = tempdir().unwrap();
    let parts = collect_parts(folder.path(), &meta(), 2);
    let file = parts[0].join("part.json");
    let text = fs::read_to_string(&file).unwrap();
    for (from, to, expected) in [
        ("\"part\": 1", "\"part\": 3", "`3/2` is no part"),
        ("\"count\": 43", "\"count\": 3", "3 samples cannot be split"),
        (
            "\"format\": 2",
            "\"format\": 9",
            "the data set is of format 9",
        ),
        ("\"of\"", "\"off\"", "unknown field `off`"),
        ("{", "", "line 2"),
    ] {
        fs::write(&file, text.replacen(from, to, 1)).unwrap();
        for error in [
            merged(&parts, &folder.path().join("out")).unwrap_err(),
            DataSet::open(&parts[0]).unwrap_err(),
            Collector::open_part(&parts[0], &meta(), part("1/2")).unwrap_err(),
        ] {
            let said = error.to_string();
            assert!(
                said.contains("part.json") && said.contains(expected),
                "{said}"
            );
        }
    }
    fs::write(&file, &text).unwrap();
    let block = parts[0].join("blocks/block-00000000.h5");
    let mut bytes = fs::read(&block).unwrap();
    // A coordinate that is not finite, where the first sample's first point is.
    let nan = f32::NAN.to_le_bytes();
    let origin: Vec<u8> = [0.0, -0.0, 0.125_f32]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let place = bytes
        .windows(12)
        .position(|window| *window == origin[..])
        .unwrap();
    bytes[place..place + 4].copy_from_slice(&nan);
    fs::write(&block, bytes).unwrap();
    let said = merged(&parts, &folder.path().join("out"))
        .unwrap_err()
        .to_string();
    assert!(
        said.contains("block-00000000.h5") && said.contains("sample 0 holds NaN"),
        "{said}"
    );
    // Removed, it is made again.
    fs::remove_file(&block).unwrap();
    collect_blocks(&parts[0], &meta(), part("1/2"), usize::MAX);
    merged(&parts, &folder.path().join("out")).unwrap();
}
