//! What a robot is calibrated from, and commands for the shapes asked for.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod calibration;
mod calibration_priors;
mod calibration_sets;
mod shape_control;
mod shape_in_scenes;
mod shape_path;
mod shape_touching;

use tdcr_sim::inverse::calibration::{
    Calibration, CalibrationError, CalibrationSettings, Observation, Unknown, calibrate,
};
use tdcr_sim::robot::RobotSpec;

/// A calibration by observations alone.
fn fit(
    first: &RobotSpec,
    unknowns: &[Unknown],
    observations: &[Observation],
) -> Result<Calibration, CalibrationError> {
    calibrate(
        first,
        unknowns,
        observations,
        &CalibrationSettings::default(),
    )
}
