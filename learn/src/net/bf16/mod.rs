//! Products of bfloat16 numbers, summed as floats: on a matrix unit where the processor has one.

#[cfg(target_arch = "x86_64")]
mod amx;
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
pub use product::{Output, has_matrix_unit, multiply};
pub use rows::padded;
pub use tile::{DEPTH, Tiles};
