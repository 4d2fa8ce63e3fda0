//! Layers: forward and backward passes.

mod dense;
mod dense_bf16;
mod dense_parallel;
mod film_bf16;
mod group_norm;
mod outer_bf16;
mod squeeze;
mod weights;

pub use dense::Dense;
pub use dense_bf16::{PackedWeight, Passes};
pub use film_bf16::{BlockTape, Kernel, Modulate, ModulateBackward};
pub use group_norm::{AffineNorm, GroupNorm, GroupNormTape, Normed};
pub use outer_bf16::{InputBackward, InputLayer, OutputBackward, OutputLayer};
pub use squeeze::{Squeeze, SqueezeTape};
pub use weights::Weights;
