//! Velocity networks: the paper's MLP with FiLM modulation, forward and backward, on the CPU.
//!
//! With flow time `t`, condition `c` and a point `x`,
//!
//! ```text
//! e  = SiLU(W_t phi(t) + b_t) + SiLU(W_c c + b_c)        phi: cosines and sines of t
//! h  = W_x x + W_e e + b                                 input layer of [x | e]
//! m  = LN(h) (1 + gamma(e)) + beta(e)                    FiLM, gamma and beta affine in e
//! h' = m + W SiLU(m) + b                                 residual block, depth - 1 times
//! u  = W_o SiLU(h) + b_o
//! ```
//!
//! All that depends on `e` alone is computed once per cloud (the *conditioner*), the rest at every point, a tile of
//! points at a time (the *trunk*). Parameters are one flat vector; [`MlpShape::tensors`] names its parts.

mod batch;
mod conditioner;
mod dense;
mod kernels;
mod mlp;
mod pool;
mod shape;
mod trunk;

pub use batch::{Batch, Workspace};
pub use mlp::Mlp;
pub use shape::{DIM, MlpShape, ShapeError, TensorSpec};
