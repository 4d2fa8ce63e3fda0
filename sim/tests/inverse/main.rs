//! What a robot is calibrated from, and commands for the shapes asked for.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod calibration;
mod calibration_sets;
mod shape_control;
mod shape_in_scenes;
mod shape_path;
mod shape_touching;
