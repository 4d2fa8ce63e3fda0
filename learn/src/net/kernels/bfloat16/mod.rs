//! Products of bfloat16 matrices, summed in 32-bit floats.
//!
//! A bfloat16 number is the upper half of a float's bits: its exponent and 8 bits of mantissa. A product `C = A B` of a *left*
//! matrix `A` `(M, K)` and a *right* matrix `B` `(K, N)` runs over the inner dimension `K`, tile by tile.
//!
//! | file | holds |
//! |---|---|
//! | `tile` | tiles of 16 x 32 numbers, and matrices of them |
//! | `pack`, `shuffle` | floats into tiles, tiles from one layout into another |
//! | `rows`, `panel` | matrices whose rows are operands as they lie in memory; strides of an operand |
//! | `unit` | what a product of tiles is given, and the trait of what runs it |
//! | `amx`, `avx512`, `floats` | Intel's matrix unit, AVX-512 BF16, vectors of floats: the first two hold `unsafe` code |
//! | `product` | the loop over tiles on the fastest unit there is |
//! | `operands` | products over the rows of large matrices, in parallel |
//! | `lanes`, `kernel` | element-wise loops on 32 numbers at a time, for the layers between the products |
//!
//! Operands alone are bfloat16: sums, norms, the residual stream, weights and gradients stay floats. What a block keeps for its
//! backward pass is rounded too, which halves the memory traffic. Weights are packed into tiles once a step; activations are
//! written as tiles by the loop that computes them. With AMX the products then take half of a step, so the remaining time
//! decides the speed: LayerNorm's sums in one pass, SiLU by the processor's estimate of a reciprocal, gradients rounded and
//! summed in the pass that makes them.

#[cfg(target_arch = "x86_64")]
mod amx;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod floats;
mod kernel;
mod lanes;
mod operands;
mod pack;
mod panel;
mod product;
mod rows;
mod shuffle;
mod tile;
mod unit;

pub use kernel::{Kernel, parts, parts_mut};
pub use lanes::{Lanes, Part};
pub use operands::{Operands, Taps};
pub use pack::Floats;
pub use product::{Output, has_matrix_unit, is_faster, multiply};
pub use rows::padded;
pub use tile::{DEPTH, Tiles};
