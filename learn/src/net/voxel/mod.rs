//! Clouds in grids of voxels.

mod conv3d;
mod conv3d_bf16;
mod conv3d_sparse;
mod grid;
mod occupied;
mod pv_conv;
mod voxel_layer;
mod voxels;

pub use grid::Grid;
pub use pv_conv::{PackedPvBlock, PvBlock, PvInput, PvScratch, PvTape};
pub use voxels::Voxels;
