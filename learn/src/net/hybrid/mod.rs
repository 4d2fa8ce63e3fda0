//! The Hybrid.

mod context;
mod context_shape;
mod context_stage;
mod shape;
mod velocity;

pub use context_shape::{ContextShape, MAX_VOXEL_NUMBERS, Stage, TimeGate};
pub use shape::HybridShape;
pub use velocity::{CloudTape, Hybrid};
