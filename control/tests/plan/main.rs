//! Plans of motions, from outside: random queries, each plan gone over again in fine steps.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod check;
mod deployments;
mod queries;
mod random;
