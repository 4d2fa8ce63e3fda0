//! Data sets: made, grown, put together, read, brought in from and out to other programs, and refused.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod collect;
#[path = "../common/mod.rs"]
mod common;
mod exchange;
mod grow;
mod merge;
mod normalisation;
mod read;
mod refuse;
