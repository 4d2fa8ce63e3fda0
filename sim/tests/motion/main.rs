//! Robots in motion: dynamics, friction of tendons along a path, and the interface that all simulations share.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod contact;
mod cosserat_motion;
mod dynamics;
mod flutter;
#[cfg(feature = "rapier")]
mod objects;
#[path = "../common/random_robot.rs"]
mod random_robot;
#[path = "../common/scenes.rs"]
mod scenes;
mod simulation;
mod tendon_friction;
