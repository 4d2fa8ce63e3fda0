//! Equilibria: what the statics promise, what is read off them, and what they must tend to.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod cases;
mod contact;
mod cosserat;
mod equilibria;
mod limits;
mod loads;
mod outputs;
#[path = "../common/random_robot.rs"]
mod random_robot;
mod sensitivity;
mod stability;
