//! Commands that a tendon-driven robot survives, and paths between them.
//!
//! The tendons of a module pull against each other: commands drawn uniformly from their box leave some of them slack and
//! overload others. So commands are made of [`Shape`]s: for each module a bend in some direction and a tension that all its
//! tendons share (co-contraction). The command of a tendon is its length in that shape, less what the tension stretches it by.
//! [`Draws`] draws such commands, and a [`Planner`] leads from one to the next; both ask the simulator for the tensions,
//! and keep discs clear of the obstacles of a scene where there is one.

mod clear;
mod draw;
mod error;
mod path;
mod shape;

pub use draw::{CommandSettings, Drawn, Draws};
pub use error::PlanError;
pub use path::Planner;
pub use shape::{Bend, Place, Shape, ShapeError, Shaper};
