//! Inverse problems, solved with the derivatives of equilibria.
//!
//! - [`shape`]: which command brings discs to targets.
//! - [`calibration`]: which stiffnesses, densities and dimensions explain measured positions.
//! - [`recording`]: the same from what a robot did in the order of time, its servos and markers among the unknowns.
//!
//! All are nonlinear least squares within bounds, by Levenberg's and Marquardt's method. As in
//! [`statics`](crate::statics) and [`sensitivity`](crate::sensitivity), tendons run through their holes without
//! friction, but in a recording that is replayed with it.

pub mod calibration;
mod least_squares;
pub mod recording;
pub mod shape;
mod student;
