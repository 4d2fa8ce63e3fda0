//! Clouds in grids of voxels: the point-voxel convolution of PVCNN (Liu et al., NeurIPS 2019).
//!
//! A grid has `r^3` voxels with `C` features each; `M` of them hold points.
//!
//! | file | holds |
//! |---|---|
//! | `grid` | where voxels lie in memory, with the zero padding that convolutions read |
//! | `occupied` | the voxels that hold points |
//! | `voxels` | where a cloud's points lie in a grid: averages per voxel, trilinear interpolation |
//! | `conv3d` | 3 x 3 x 3 convolution as 27 products of shifted rows |
//! | `conv3d_bf16` | its bfloat16 twin |
//! | `conv3d_sparse` | the same of a grid in which few voxels hold points (Graham et al., CVPR 2018) |
//! | `voxel_layer` | convolution, GroupNorm and SiLU, by whichever convolution is faster |
//! | `pv_conv` | the block: voxels, points, squeeze and excitation, FiLM |
//! | `pvcnn_block` | the authors' block; no backward pass |

mod conv3d;
mod conv3d_bf16;
mod conv3d_sparse;
mod grid;
mod occupied;
mod pv_conv;
mod pvcnn_block;
mod voxel_layer;
mod voxels;

pub use grid::Grid;
pub use pv_conv::{PackedPvBlock, PvBlock, PvInput, PvScratch, PvTape};
pub use pvcnn_block::{EPSILON as PVCNN_EPSILON, PvcnnBlock, PvcnnInput, PvcnnScratch};
pub use voxels::Voxels;
