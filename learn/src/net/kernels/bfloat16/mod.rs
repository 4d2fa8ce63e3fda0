//! Products of bfloat16 numbers, summed as floats: on a matrix unit where the processor has one, on vectors elsewhere.

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
