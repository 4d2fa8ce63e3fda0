//! The normalisation and its two files.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod common;

use std::fs;

use common::{CHUNKED, chunked};
use std::path::Path;
use tdcr_learn::data::{DataError, DataSet, Normalisation};
use tempfile::tempdir;

#[test]
fn a_normalisation_that_makes_no_sense_is_refused() {
    const MOTORS: &str = "global_motors_scope-all.json";
    const POINTS: &str = "global_norm_scope-all_anchor-origin.json";
    for (file, text) in [
        (
            MOTORS,
            r#"{"all": {"min": [0.0], "max": [1.0, 1.0], "scale": [1.0, 1.0]}}"#,
        ),
        (MOTORS, r#"{"all": {"min": [], "max": [], "scale": []}}"#),
        (
            MOTORS,
            r#"{"all": {"min": [2.0], "max": [1.0], "scale": [1.0]}}"#,
        ),
        (
            POINTS,
            r#"{"all": {"center": [0.0, 0.0, 0.1], "scale": 1.0}}"#,
        ),
        (
            POINTS,
            r#"{"all": {"center": [0.0, 0.0, 0.0], "scale": 0.0}}"#,
        ),
    ] {
        let dir = chunked();
        fs::write(dir.path().join(file), text).unwrap();
        let error = DataSet::open(dir.path()).unwrap_err();
        assert!(
            matches!(&error, DataError::InvalidJson { path, .. } if path.ends_with(file)),
            "{error}"
        );
    }
    for text in ["", "{", r#"{"all": {"center": [0.0, 0.0], "scale": 1.0}}"#] {
        let dir = chunked();
        fs::write(dir.path().join(POINTS), text).unwrap();
        assert!(matches!(
            DataSet::open(dir.path()),
            Err(DataError::Json { .. })
        ));
    }
}

#[test]
fn a_motor_that_never_moves_has_condition_zero() {
    let normalisation = Normalisation {
        motor_min: vec![0.02, 0.0],
        motor_max: vec![0.02, 0.04],
        scale: 0.5,
    };
    assert_eq!(normalisation.condition(&[0.02, 0.03]).unwrap(), [0.0, 0.75]);
    let dir = tempdir().unwrap();
    normalisation.save(dir.path()).unwrap();
    assert_eq!(Normalisation::load(dir.path()).unwrap(), normalisation);
}

#[test]
fn a_condition_of_another_length_is_refused() {
    let normalisation = Normalisation::load(Path::new(CHUNKED)).unwrap();
    let refused = normalisation.condition(&[0.0]);
    assert!(matches!(
        refused,
        Err(DataError::ConditionLength {
            expected: 2,
            found: 1
        })
    ));
}
