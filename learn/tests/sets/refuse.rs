//! Making a data set: what is refused, and by which name.

use std::fs;
use std::ops::ControlFlow::Continue;

use tdcr_base::Part;
use tdcr_learn::data::{Collector, DataError, Meta, Origin, PayloadRange, Recipe, Sample};
use tdcr_sim::render::BaseVisibility;
use tempfile::tempdir;

use crate::common::{collect, files, meta, restore, sample};

#[test]
fn another_set_in_the_folder_is_refused_by_the_field_that_differs() {
    let dir = tempdir().unwrap();
    let _collector = Collector::open(dir.path(), &meta()).unwrap();
    let complete = tempdir().unwrap();
    collect(complete.path(), &meta());
    for (changed, field, values) in [
        (Meta { seed: 8, ..meta() }, "seed", ["8", "7"]),
        (
            with_recipe(|recipe| {
                recipe.subject.robot.modules[1].pitch = 0.017f64.next_up();
            }),
            "origin.simulated.recipe.subject.robot.modules[1].pitch",
            ["0.017000000000000005", "0.017"],
        ),
        (
            with_recipe(|recipe| recipe.subject.base = BaseVisibility::Shown),
            "origin.simulated.recipe.subject.base",
            ["\"shown\"", "\"hidden\""],
        ),
    ] {
        for dir in [&dir, &complete] {
            let error = Collector::open(dir.path(), &changed).unwrap_err();
            let DataError::OtherSet {
                field: named,
                expected: wanted,
                found,
                ..
            } = error
            else {
                panic!("{error}")
            };
            assert_eq!(
                (named.as_str(), [wanted.as_str(), found.as_str()]),
                (field, values)
            );
        }
    }
}

/// What was given up before it had a sample leaves nothing behind, and bars the way of nothing.
#[test]
fn a_set_without_a_sample_is_begun_anew_by_another() {
    let parent = tempdir().unwrap();
    let dir = parent.path().join("set");
    drop(Collector::open(&dir, &meta()).unwrap());
    let other = Meta { seed: 8, ..meta() };
    let collector = Collector::open(&dir, &other).unwrap();
    collector.abandon().unwrap();
    assert!(!dir.exists());
    let part = Part::new(1, 2).unwrap();
    let collector = Collector::open_part(&dir, &meta(), part).unwrap();
    collector.abandon().unwrap();
    assert!(!dir.exists());
    // Where there is a sample, all stays.
    let collector = Collector::open(&dir, &meta()).unwrap();
    let block = collector.missing_blocks().remove(0);
    let samples: Vec<Sample> = block.clone().map(sample).collect();
    collector.write_block(block.start, &samples).unwrap();
    let kept = files(&dir);
    collector.abandon().unwrap();
    assert_eq!(files(&dir), kept);
    let refused = Collector::open(&dir, &other);
    assert!(matches!(refused, Err(DataError::OtherSet { .. })));
    let left = Collector::open(&dir, &meta()).unwrap().missing_blocks();
    assert_eq!(left.first().unwrap().start, block.end);
}

#[test]
fn a_folder_that_is_no_data_set_is_refused_by_what_it_holds() {
    for foreign in [
        "thesis.tex",
        "train/shard-00000.h5",
        ".partial/block-00000000.h5",
    ] {
        let dir = tempdir().unwrap();
        restore(dir.path(), &[(foreign.to_owned(), vec![])].into());
        let error = Collector::open(dir.path(), &meta()).unwrap_err();
        let DataError::ForeignFolder { found, .. } = error else {
            panic!("{error}")
        };
        assert!(foreign.contains(&found));
        assert_eq!(files(dir.path()).len(), 1, "nothing was written");
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_refused_by_its_path() {
    let dir = tempdir().unwrap();
    fs::write(dir.path().join("file"), "").unwrap();
    let error = Collector::open(&dir.path().join("file/set"), &meta()).unwrap_err();
    assert!(matches!(error, DataError::Io { .. }));
    assert!(error.to_string().contains("file/set"), "{error}");
}

#[test]
fn two_collectors_of_one_folder_are_refused() {
    let dir = tempdir().unwrap();
    let _collector = Collector::open(dir.path(), &meta()).unwrap();
    assert!(matches!(
        Collector::open(dir.path(), &meta()),
        Err(DataError::InUse { .. })
    ));
}

/// [`meta`] with another recipe.
fn with_recipe(change: impl FnOnce(&mut Recipe)) -> Meta {
    let mut meta = meta();
    if let Origin::Simulated { recipe, .. } = &mut meta.origin {
        change(recipe);
    }
    meta
}

#[test]
fn settings_of_which_no_data_set_can_be_made_are_refused_by_name() {
    for (changed, field) in [
        (
            Meta {
                format: 1,
                ..meta()
            },
            "format",
        ),
        (
            Meta {
                motors: 0,
                ..meta()
            },
            "motors",
        ),
        (
            Meta {
                points_per_cloud: 0,
                ..meta()
            },
            "points_per_cloud",
        ),
        (
            Meta {
                samples_per_shard: 0,
                ..meta()
            },
            "samples_per_shard",
        ),
        (
            with_recipe(|recipe| recipe.voxel_size = f64::NAN),
            "voxel_size",
        ),
        (with_recipe(|recipe| recipe.voxel_size = 0.0), "voxel_size"),
        // A robot in so many cubes that their numbers overflow, and in one.
        (
            with_recipe(|recipe| recipe.voxel_size = 1e-12),
            "voxel_size",
        ),
        (with_recipe(|recipe| recipe.voxel_size = 1e9), "voxel_size"),
        (
            with_recipe(|recipe| {
                recipe.subject.payload = Some(PayloadRange { min: 0.2, max: 0.1 });
            }),
            "payload",
        ),
    ] {
        let error = Collector::open(tempdir().unwrap().path(), &changed).unwrap_err();
        assert!(
            matches!(error, DataError::InvalidMeta { field: named, .. } if named == field),
            "{error}"
        );
    }
    let few = Meta { count: 9, ..meta() };
    let error = Collector::open(tempdir().unwrap().path(), &few).unwrap_err();
    assert!(matches!(error, DataError::TooFewSamples { found: 9, .. }));
}

#[test]
fn samples_that_do_not_fit_are_refused_by_index() {
    let dir = tempdir().unwrap();
    let collector = Collector::open(dir.path(), &meta()).unwrap();
    type Spoil = fn(&mut Sample);
    let spoil: [(Spoil, &str); 6] = [
        (
            |sample| sample.condition.motors.truncate(1),
            "1 motors, expected 2",
        ),
        (
            |sample| sample.condition.payload = Some(0.01),
            "a payload, expected no payload",
        ),
        (
            |sample| sample.cloud.points.truncate(5),
            "5 points and 6 colours",
        ),
        (
            |sample| sample.cloud.colors.truncate(5),
            "6 points and 5 colours",
        ),
        (|sample| sample.condition.motors[1] = f32::NAN, "NaN"),
        (|sample| sample.cloud.points[5][2] = f32::INFINITY, "inf"),
    ];
    for (spoil, what) in spoil {
        let mut samples: Vec<Sample> = (8..16).map(sample).collect();
        spoil(&mut samples[3]);
        let error = collector.write_block(8, &samples).unwrap_err();
        assert!(matches!(error, DataError::InvalidSample { index: 11, .. }));
        assert!(error.to_string().contains(what), "{error}");
    }
    assert_eq!(collector.missing_blocks().len(), 6);
}

#[test]
fn samples_that_are_no_block_are_refused() {
    let dir = tempdir().unwrap();
    let collector = Collector::open(dir.path(), &meta()).unwrap();
    for (first, count) in [
        (0, 7),
        (1, 8),
        (8, 9),
        (40, 2),
        (48, 8),
        (0, 0),
        (usize::MAX, 8),
    ] {
        let samples = vec![sample(0); count];
        let refused = collector.write_block(first, &samples);
        assert!(
            matches!(refused, Err(DataError::NotABlock { .. })),
            "{first} {count}"
        );
    }
    assert!(matches!(
        collector.finish(|_, _| Continue(())),
        Err(DataError::Incomplete { .. })
    ));
}
