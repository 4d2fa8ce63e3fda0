//! Layers: forward and backward passes.

mod dense;
mod dense_bf16;
mod dense_parallel;
pub mod film;
pub mod film_bf16;
mod group_norm;
mod outer_bf16;
mod pass;
mod squeeze;

pub use dense::Dense;
pub use dense_bf16::PackedWeight;
pub use group_norm::{AffineNorm, GroupNorm, Normed};
pub use outer_bf16::{InputBackward, InputLayer, OutputBackward, OutputLayer};
pub use pass::{Keep, Passes, Weights};
pub use squeeze::{Squeeze, SqueezeTape};
