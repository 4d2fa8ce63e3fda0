//! The mathematics of layers: each is a struct that knows where its parameters lie, with a forward and a backward pass.
//!
//! Matrices are row-major, one row of features per point, voxel or cloud. In what follows `x` is a layer's input, `y` its
//! output, `W` `(outputs, inputs)` its weight and `b` its bias; `dz` or `d` is the gradient of the loss by `z`. Shapes are in
//! `N` points, tiles of `T` points, `H` or `C` features.
//!
//! | file | layer |
//! |---|---|
//! | `dense` | `y = W x + b` |
//! | `dense_parallel` | the same on many rows, in parallel and in either operand type |
//! | `dense_bf16` | its weight, packed for bfloat16 products |
//! | `film` | LayerNorm (Ba, Kiros and Hinton 2016) under FiLM (Perez et al. 2018), and SiLU |
//! | `film_bf16` | its twin between bfloat16 products |
//! | `outer_bf16` | first and last layer of a network whose hidden products are in bfloat16 |
//! | `group_norm` | GroupNorm (Wu and He 2018) and SiLU |
//! | `batch_norm` | BatchNorm (Ioffe and Szegedy 2015) of a trained network, and ReLU or LeakyReLU; no backward pass |
//! | `squeeze` | squeeze and excitation (Hu et al. 2018) |
//! | `pass` | how passes take parameters, and what they keep |
//!
//! A *tape* holds what a forward pass leaves for the backward pass, and buffers that stay from call to call.

mod batch_norm;
mod dense;
mod dense_bf16;
mod dense_parallel;
pub mod film;
pub mod film_bf16;
mod group_norm;
mod outer_bf16;
mod pass;
mod squeeze;

pub use batch_norm::{BatchNorm, VARIANCE};
pub use dense::Dense;
pub use dense_bf16::PackedWeight;
pub use group_norm::{AffineNorm, GroupNorm, GroupNormTape, Normed};
pub use outer_bf16::{InputBackward, InputLayer, OutputBackward, OutputLayer};
pub use pass::{Keep, Passes, Weights};
pub use squeeze::{Squeeze, SqueezeTape};
