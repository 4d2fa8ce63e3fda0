//! The Hybrid.

mod context;
mod context_shape;
mod context_stage;
mod shape;
mod velocity;

pub use context_shape::{ContextShape, Stage, TimeGate};
pub use shape::HybridShape;
pub use velocity::{Hybrid, HybridWorkspace};
