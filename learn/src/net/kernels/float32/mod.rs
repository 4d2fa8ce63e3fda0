//! Loops over rows of floats.

mod loops;
mod rows;

pub(in crate::net) use loops::vectorised;
pub use loops::{activate, add, dot, fill_rows, multiply, silu, sum, sum_rows};
pub use rows::{Rows, Sums};
