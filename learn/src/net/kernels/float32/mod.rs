//! Loops over row-major matrices of 32-bit floats, one row of features per point, voxel or cloud.
//!
//! `loops` has the element-wise functions, `rows` the division of a matrix into blocks that tasks take, and sums over them in
//! fixed order.

mod loops;
mod rows;

pub(in crate::net) use loops::vectorised;
pub use loops::{activate, add, dot, fill_rows, multiply, reset, silu, sum, sum_rows};
pub use rows::{Rows, Sums};
