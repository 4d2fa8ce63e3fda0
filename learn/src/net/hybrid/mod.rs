//! The Hybrid: an MLP whose points have a context, features of the cloud about them.
//!
//! Symbols as in the page of [`net`](crate::net): the context `C_pv` `(N, F)` of `N` points comes from three stages of
//! point-voxel blocks (Liu et al., NeurIPS 2019) on ever coarser grids, and is blended with the embedding's by a gate of flow
//! time.
//!
//! | file | holds |
//! |---|---|
//! | `context_shape` | sizes of the context network, the time gate |
//! | `context_stage` | blocks of one resolution |
//! | `context_kind` | what the Hybrid asks of its context network |
//! | `context` | the context network: stages, maximum over points, joining layer |
//! | `pvcnn_context` | the authors' context network; no backward pass |
//! | `shape` | sizes of the whole network, and its layers |
//! | `velocity` | the network, with either context |
//! | `training` | its loss and gradient, with the first |
//!
//! Points and voxels of one cloud run in parallel, clouds one after another: one cloud's features are kept, one gradient is
//! summed, and a single prediction uses all cores. Blocks of rows are fixed, and so are the sums over them.

mod context;
mod context_kind;
mod context_shape;
mod context_stage;
mod pvcnn_context;
mod shape;
mod training;
mod velocity;

pub use context::ContextNet;
pub use context_shape::{ContextLayers, ContextShape, Stage, TimeGate};
pub use pvcnn_context::PvcnnContext;
pub use shape::HybridShape;
pub use training::HybridWorkspace;
pub use velocity::Hybrid;
