//! Networks: against the papers' equations, against PyTorch, and what holds for networks of any size.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod bf16;
#[path = "../fixture/mod.rs"]
mod fixture;
mod hybrid;
mod mlp;
mod pvcnn;
#[path = "../reference/mod.rs"]
mod reference;
mod torch;
#[path = "../toy/mod.rs"]
mod toy;
