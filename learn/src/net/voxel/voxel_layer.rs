//! A convolution of voxels with its norm and activation.

use super::conv3d::Conv3d;
use super::conv3d_bf16::PackedConv;
use super::conv3d_sparse::Buffers;
use super::grid::Grid;
use super::occupied::Sparse;
use crate::net::kernels::bfloat16::{Operands, has_matrix_unit};
use crate::net::kernels::float32::Sums;
use crate::net::layers::{AffineNorm, GroupNorm, Normed, Weights};
use crate::net::parameters::Table;

/// `y = SiLU(GN(conv(x)))`; grids have margins.
#[derive(Clone, Debug)]
pub struct VoxelLayer {
    pub conv: Conv3d,
    norm: AffineNorm,
}

/// Workspace of the products, kept from call to call.
#[derive(Debug, Default)]
pub struct VoxelWorkspace {
    float32: Buffers,
    bfloat16: Operands,
    pub sums: Sums,
}

impl VoxelLayer {
    /// Adds the layer's tensors, numbered `index` among those of `name`.
    pub fn declare(
        table: &mut Table,
        name: &str,
        index: usize,
        grid: Grid,
        channels: usize,
    ) -> Self {
        let conv = format!("{name}.convs.{index}");
        Self {
            conv: Conv3d::declare(table, &conv, grid, channels, channels),
            norm: AffineNorm::declare(
                table,
                &format!("{name}.conv_norms.{index}"),
                GroupNorm::new(channels),
            ),
        }
    }

    /// The convolution of grid `x`.
    pub fn convolve(
        &self,
        weights: Weights<PackedConv>,
        workspace: &mut VoxelWorkspace,
        x: &[f32],
        normed: &mut Normed,
    ) {
        let (params, y) = (weights.params, &mut normed.features);
        match weights.packed {
            None => self.conv.forward(params, x, y),
            Some(packed) => (self.conv).forward_bf16(params, packed, &mut workspace.bfloat16, x, y),
        }
    }

    /// The convolution of a grid with the features of a few voxels. `spare` is a grid to be used as workspace.
    pub fn convolve_sparse(
        &self,
        weights: Weights<PackedConv>,
        workspace: &mut VoxelWorkspace,
        x: Sparse,
        spare: &mut [f32],
        normed: &mut Normed,
    ) {
        if Self::all_are_faster(weights) {
            x.spread(self.conv.grid, spare);
            return self.convolve(weights, workspace, spare, normed);
        }
        (self.conv).forward_sparse(weights.params, x, &workspace.float32, &mut normed.features);
    }

    /// Whether products for all voxels, on a matrix unit, take less time than to gather and scatter those of the occupied
    /// ones, which are of floats in either precision.
    fn all_are_faster(weights: Weights<PackedConv>) -> bool {
        weights.packed.is_some() && has_matrix_unit()
    }

    /// Grid `y` from what the convolution left.
    pub fn activate(&self, params: &[f32], normed: &mut Normed, y: &mut [f32]) {
        let (grid, channels) = (self.conv.grid, self.norm.norm.channels);
        let Normed { features, tape } = normed;
        let features = grid.body_mut(features, channels);
        let y = grid.body_mut(y, channels);
        self.norm.forward(params, grid.rows(), features, tape, y);
    }

    /// Turns `d`, the gradient by `y`, into the gradient behind the convolution; adds to `gradient`.
    pub fn activate_backward(
        &self,
        params: &[f32],
        normed: &mut Normed,
        d: &mut [f32],
        gradient: &mut [f32],
    ) {
        let (grid, channels) = (self.conv.grid, self.norm.norm.channels);
        let Normed { features, tape } = normed;
        let features = grid.body(features, channels);
        let d = grid.body_mut(d, channels);
        self.norm
            .backward(params, grid.rows(), features, tape, d, gradient);
    }

    /// Gradient `dx` by `x` from `d`, the gradient behind the convolution of `x`; adds to `gradient`.
    pub fn convolve_backward(
        &self,
        weights: Weights<PackedConv>,
        workspace: &mut VoxelWorkspace,
        [x, d]: [&[f32]; 2],
        gradient: &mut [f32],
        dx: &mut [f32],
    ) {
        let VoxelWorkspace { bfloat16, sums, .. } = workspace;
        match weights.packed {
            None => {
                self.conv.backward(gradient, x, d, sums);
                self.conv.backward_input(weights.params, d, dx);
            }
            Some(packed) => {
                self.conv.backward_bf16(bfloat16, gradient, x, d, sums);
                self.conv.backward_input_bf16(packed, bfloat16, d, dx);
            }
        }
    }

    /// [`VoxelLayer::convolve_backward`] of [`VoxelLayer::convolve_sparse`], to the gradient `dx` `(M, C)` by the few voxels'
    /// features. `spare` are grids to be used as workspace.
    pub fn convolve_backward_sparse(
        &self,
        weights: Weights<PackedConv>,
        workspace: &mut VoxelWorkspace,
        (x, d): (Sparse, &[f32]),
        spare: [&mut [f32]; 2],
        gradient: &mut [f32],
        dx: &mut [f32],
    ) {
        if Self::all_are_faster(weights) {
            let [all, d_all] = spare;
            x.spread(self.conv.grid, all);
            self.convolve_backward(weights, workspace, [all, d], gradient, d_all);
            return (x.voxels).collect(self.conv.grid, d_all, x.channels, dx);
        }
        let VoxelWorkspace { float32, sums, .. } = workspace;
        self.conv.backward_sparse(gradient, x, d, float32, sums);
        (self.conv).backward_input_sparse(weights.params, x.voxels, d, float32, dx);
    }
}
