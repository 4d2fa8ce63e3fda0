//! The normalisation and its two files.

use std::fs;

use std::path::Path;
use tdcr_learn::data::{DataError, DataSet, Normalisation};
use tempfile::tempdir;

use crate::common::{CHUNKED, chunked};

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

#[test]
fn values_outside_the_range_are_named_and_rounding_is_not() {
    let normalisation = Normalisation {
        motor_min: vec![0.0, 0.01, 0.02],
        motor_max: vec![0.04, 0.03, 0.02],
        scale: 1.0,
    };
    let indices = |command: [f64; 3]| -> Vec<usize> {
        let outside = normalisation.out_of_range(&command).unwrap();
        outside.iter().map(|outside| outside.index).collect()
    };
    let single = |x: f64| f64::from(x as f32);
    assert!(indices([single(0.04), single(0.01), single(0.02)]).is_empty());
    assert_eq!(indices([0.0401, 0.0099, 0.0201]), [0, 1, 2]);
    assert_eq!(indices([-1e-4, f64::NAN, 0.02]), [0, 1]);
    assert!(normalisation.out_of_range(&[0.0]).is_err());
}
