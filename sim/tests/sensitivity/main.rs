//! Derivatives of equilibria against differences of settled poses.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod case;
mod parameters;
mod random;
#[path = "../common/random_robot.rs"]
mod random_robot;
mod special;
