//! What training and files of others may allocate: the counts are of the program's one allocator.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod files;
#[path = "../toy/mod.rs"]
mod toy;
mod training;
