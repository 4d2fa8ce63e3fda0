//! Training: runs, what they start from, and what they leave; models as files, flows from a prior, streams and symmetries.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod colors;
mod distill;
mod hybrid;
mod model;
mod prior;
#[path = "../reference/mod.rs"]
mod reference;
mod refine;
mod runs;
mod start;
mod stream;
mod symmetry;
#[path = "../toy/mod.rs"]
mod toy;
