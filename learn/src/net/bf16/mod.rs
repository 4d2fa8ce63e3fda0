//! Products of bfloat16 numbers, summed as floats: on a matrix unit where the processor has one.

#[cfg(target_arch = "x86_64")]
mod amx;
mod dense;
mod ends;
mod kernels;
mod lanes;
mod pack;
mod panel;
mod product;
mod room;
mod rows;
mod shuffle;
mod tile;

pub use dense::{PackedWeight, Passes};
pub use ends::{Enter, EnterBackward, Leave, LeaveBackward};
pub use kernels::{BlockTape, Kernel, Modulate, ModulateBackward};
pub use pack::Floats;
pub use product::{Output, has_matrix_unit, multiply};
pub use room::{Room, Weights};
pub use rows::padded;
pub use tile::{DEPTH, Tiles};
