//! Loops over rows of floats.

mod loops;
mod rows;

pub(in crate::net) use loops::vectorised;
pub use loops::{
    BlockTape, EPSILON, Modulate, ModulateBackward, activate, add, fill_rows, multiply, silu,
    sum_rows, vector_lanes,
};
pub use rows::{Rows, Sums};
