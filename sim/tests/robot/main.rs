//! Robots as they are described: in specifications, in files of ours and of other tools; and their symmetries.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod files;
mod formats;
mod scenes;
mod specification;
mod symmetry;
