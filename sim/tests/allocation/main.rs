//! What allocates nothing, and what solvers own of their robot: the counts are of the program's one allocator.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod inner_loops;
mod ownership;
