//! Products of bfloat16 numbers, summed as floats: on a matrix unit where the processor has one, on vectors elsewhere.

#[cfg(target_arch = "x86_64")]
mod amx;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod dense;
mod kernels;
mod lanes;
mod operands;
mod outer_layers;
mod pack;
mod panel;
mod product;
mod rows;
mod shuffle;
mod tile;

pub use dense::{PackedWeight, Passes};
pub use kernels::{BlockTape, Kernel, Modulate, ModulateBackward};
pub use operands::{Operands, Taps};
pub use outer_layers::{InputBackward, InputLayer, OutputBackward, OutputLayer};
pub use pack::Floats;
pub use product::{Output, has_matrix_unit, is_faster, multiply};
pub use rows::padded;
pub use tile::{DEPTH, Tiles};
