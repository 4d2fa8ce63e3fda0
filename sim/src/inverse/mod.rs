//! Inverse problems, solved with the derivatives of equilibria.
//!
//! - [`shape`]: which command brings discs to targets.
//! - [`calibration`]: which stiffnesses, densities and dimensions explain measured positions.
//! - [`recording`]: the same from what a robot did in the order of time, its servos and markers among the unknowns.
//!
//! What a number of a robot is called, its unit and the values that it can have are rows of tables: of
//! [`ParameterKind`](crate::robot::ParameterKind)s, and of the unknowns of a recording, each of which has a prior. Users state
//! [`Priors`] and bounds by the names of unknowns.
//!
//! All are nonlinear least squares within bounds, by Levenberg's and Marquardt's method. As in
//! [`statics`](crate::statics) and [`sensitivity`](crate::sensitivity), tendons run through their holes without
//! friction, but in a recording that is replayed with it.

pub mod calibration;
mod coordinate;
mod least_squares;
mod priors;
pub mod recording;
pub mod shape;
mod sought;
mod student;

pub use priors::{Prior, PriorError, Priors};
