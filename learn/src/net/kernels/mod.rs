//! Machinery: loops and products compiled for this processor, which know nothing of networks.

pub mod bfloat16;
#[cfg(test)]
pub mod check;
pub mod float32;
mod precision;
mod processor;

pub use precision::Precision;
pub use processor::Processor;
