//! The machinery: loops and products for the units that this processor has. Nothing here knows a network.
//!
//! - `float32`: element-wise loops and sums over rows of 32-bit floats, compiled for each vector unit and chosen at run time.
//!   Products of floats are faer's, called where a layer needs them.
//! - `bfloat16`: products of matrices whose operands are rounded to bfloat16 and whose sums are floats: on a matrix unit
//!   (AMX), on AVX-512 BF16 or on vectors of floats.
//! - [`Precision`]: which of the two the networks' products take. [`Processor`]: what was found on this machine.

pub mod bfloat16;
#[cfg(test)]
pub mod check;
pub mod float32;
mod precision;
mod processor;

pub use precision::Precision;
pub use processor::Processor;
