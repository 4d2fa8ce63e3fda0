//! The block of the authors' context network, of a trained network: it has no backward pass.

use super::conv3d::Conv3d;
use super::conv3d_sparse::Buffers;
use super::grid::Grid;
use super::pv_conv::add_gained;
use super::voxels::Voxels;
use crate::net::kernels::bfloat16::Operands;
use crate::net::kernels::float32::{Rows, Sums};
use crate::net::layers::{
    BatchNorm, Dense, GroupNorm, GroupNormTape, Squeeze, SqueezeTape, Weights,
};
use crate::net::parameters::{Table, fan_in};

/// Epsilon of PVCNN's norms of voxels; that of all others is PyTorch's default.
const VOXEL_EPSILON: f64 = 1e-4;
/// See [`VOXEL_EPSILON`].
pub const EPSILON: f64 = 1e-5;

/// Slope of PVCNN's LeakyReLU below zero.
const LEAK: f32 = 0.1;

/// Point-voxel convolution of PVCNN (Liu et al. 2019), then a shared MLP, and its GroupNorm under FiLM added to it:
///
/// ```text
/// g  = L(BN(conv(L(BN(conv(average of h per voxel))))))         L(x) = max(x, 0.1 x)
/// v  = a(mean g) * interpolate(g) + ReLU(BN(W_p h + b_p))       a: squeeze and excitation
/// p  = ReLU(BN(W_m v + b_m))
/// h' = p + FiLM(p; e)                                           FiLM with GroupNorm
/// ```
///
/// Gains are put on the points, as in [`PvBlock`](super::PvBlock).
#[derive(Clone, Debug)]
pub struct PvcnnBlock {
    grid: Grid,
    channels: usize,
    convs: [Conv3d; 2],
    conv_norms: [BatchNorm; 2],
    squeeze: Squeeze,
    point: Dense,
    point_norm: BatchNorm,
    mix: Dense,
    mix_norm: BatchNorm,
    film: GroupNorm,
}

/// Workspace of a pass. Grids have margins.
#[derive(Debug, Default)]
pub struct PvcnnScratch {
    averages: Vec<f32>,
    voxels: [Vec<f32>; 2],
    squeeze: SqueezeTape,
    interpolated: Vec<f32>,
    joined: Vec<f32>,
    mixed: Vec<f32>,
    norm: GroupNormTape,
    sums: Sums,
    buffers: Buffers,
    operands: Operands,
}

/// What a block acts on.
#[derive(Clone, Copy)]
pub struct PvcnnInput<'a> {
    pub params: &'a [f32],
    /// FiLM's scale and offset.
    pub film: [&'a [f32]; 2],
    /// Where the cloud's points lie.
    pub voxels: &'a Voxels,
    /// Features `h`, `(N, C)`.
    pub features: &'a [f32],
}

impl PvcnnBlock {
    /// Adds the block's tensors, but for FiLM's.
    pub fn declare(table: &mut Table, name: &str, channels: usize, grid: Grid) -> Self {
        let initial = fan_in(channels);
        let [first, second] = [0, 1].map(|k| {
            let conv = format!("{name}.convs.{k}");
            let norm = format!("{name}.conv_norms.{k}");
            (
                Conv3d::declare(table, &conv, grid, channels, channels),
                BatchNorm::declare(table, &norm, channels, VOXEL_EPSILON, LEAK),
            )
        });
        let squeeze = Squeeze::declare(table, &format!("{name}.squeeze"), channels);
        let mut shared = |layer: &str| {
            let norm = format!("{name}.{layer}_norm");
            let layer = format!("{name}.{layer}");
            (
                Dense::declare(table, &layer, channels, channels, initial),
                BatchNorm::declare(table, &norm, channels, EPSILON, 0.0),
            )
        };
        let ((point, point_norm), (mix, mix_norm)) = (shared("point"), shared("linear"));
        Self {
            grid,
            channels,
            convs: [first.0, second.0],
            conv_norms: [first.1, second.1],
            squeeze,
            point,
            point_norm,
            mix,
            mix_norm,
            film: GroupNorm::authors(channels),
        }
    }

    /// Floating-point operations of the pass over `points` points, products alone.
    pub fn flops(&self, points: usize) -> u64 {
        let convs = self.convs.iter().map(Conv3d::flops);
        let shared = self.point.flops(points) + self.mix.flops(points);
        convs.sum::<u64>() + self.squeeze.flops() + shared
    }

    /// Features `h'`, `(N, C)`.
    pub fn forward(&self, input: PvcnnInput, scratch: &mut PvcnnScratch, output: &mut Vec<f32>) {
        let PvcnnInput {
            params,
            film,
            voxels,
            features: h,
        } = input;
        let (grid, c) = (self.grid, self.channels);
        let PvcnnScratch {
            averages,
            voxels: [first, second],
            squeeze,
            interpolated,
            joined,
            mixed,
            norm,
            sums,
            buffers,
            operands,
        } = scratch;
        for grid in [&mut *first, second] {
            self.grid.prepare(grid, c);
        }
        for points in [&mut *interpolated, joined, mixed, output] {
            points.resize(h.len(), 0.0);
        }

        // Voxels: g = L(BN(conv(L(BN(conv(average of h per voxel)))))).
        voxels.average(h, c, averages);
        let [conv1, conv2] = &self.convs;
        let [norm1, norm2] = &self.conv_norms;
        conv1.forward_sparse(params, voxels.sparse(averages, c), buffers, first);
        norm1.forward(params, grid.rows(), grid.body_mut(first, c));
        conv2.forward(params, first, second);
        norm2.forward(params, grid.rows(), grid.body_mut(second, c));

        // Gains a(mean g) and features of g at the points.
        let means = sums.columns(grid.body(second, c), grid.rows(), c);
        squeeze.means.clear();
        let mean = means.iter().map(|sum| (sum / grid.voxels() as f64) as f32);
        squeeze.means.extend(mean);
        self.squeeze.forward(params, squeeze);
        voxels.interpolate(second, c, interpolated);

        // Points: v = a(mean g) * interpolate(g) + ReLU(BN(W_p h + b_p)).
        let rows = Rows::points(h.len() / c);
        let weights = Weights {
            params,
            packed: None,
        };
        self.point.par_forward(weights, operands, h, joined);
        self.point_norm.forward(params, rows, joined);
        add_gained(interpolated, &squeeze.gains, joined);

        // p = ReLU(BN(W_m v + b_m)), h' = p + FiLM(p; e).
        self.mix.par_forward(weights, operands, joined, mixed);
        self.mix_norm.forward(params, rows, mixed);
        self.film.residual(rows, film, mixed, norm, output);
    }
}
