//! Point-voxel convolution and the residual block about it.

use faer::Accum;
use rayon::prelude::*;

use super::conv3d_bf16::PackedConv;
use super::grid::Grid;
use super::voxel_layer::{VoxelLayer, VoxelWorkspace};
use super::voxels::Voxels;
use crate::net::kernels::bfloat16::Operands;
use crate::net::kernels::float32::{Rows, Sums, add, vectorised};
use crate::net::layers::{
    AffineNorm, Dense, GroupNorm, Normed, PackedWeight, Passes, Squeeze, SqueezeTape, Weights,
};
use crate::net::parameters::{Table, fan_in};

/// Point-voxel convolution (Liu et al. 2019) with GroupNorm and SiLU, then a shared MLP that FiLM modulates; residual:
///
/// ```text
/// g  = SiLU(GN(conv(SiLU(GN(conv(average of h per voxel))))))
/// v  = a(mean g) * interpolate(g) + SiLU(GN(W_p h + b_p))       a: squeeze and excitation
/// h' = h + SiLU(FiLM(W_m v + b_m; e))                           FiLM with GroupNorm
/// ```
///
/// Interpolation is linear and a gain is of a channel, so the gain is put on the points instead of on the voxels.
#[derive(Clone, Debug)]
pub struct PvBlock {
    grid: Grid,
    channels: usize,
    layers: [VoxelLayer; 2],
    squeeze: Squeeze,
    point: Dense,
    point_norm: AffineNorm,
    mix: Dense,
    film: GroupNorm,
}

/// A block's weights in tiles.
#[derive(Debug, Default)]
pub struct PackedPvBlock {
    convs: [PackedConv; 2],
    point: PackedWeight,
    mix: PackedWeight,
}

/// Features of one cloud that the backward pass needs. Grids have margins.
#[derive(Debug, Default)]
pub struct PvTape {
    /// What enters the first convolution, of every voxel that holds points, `(M, C)`.
    averages: Vec<f32>,
    convolved: [Normed; 2],
    /// Between the convolutions.
    activated: Vec<f32>,
    squeeze: SqueezeTape,
    interpolated: Vec<f32>,
    point: Normed,
    /// Output of the point-voxel convolution, `(N, C)`.
    joined: Vec<f32>,
    mixed: Normed,
}

/// Workspace that blocks of one shape share: grids with margins, and points.
#[derive(Debug, Default)]
pub struct PvScratch {
    voxels: [Vec<f32>; 2],
    points: [Vec<f32>; 2],
    /// Gradient by the averages.
    d_averages: Vec<f32>,
    voxel_workspace: VoxelWorkspace,
    /// For products of points.
    operands: Operands,
}

/// What a block acts on.
#[derive(Clone, Copy)]
pub struct PvInput<'a> {
    pub weights: Weights<'a, PackedPvBlock>,
    /// FiLM's scale and offset.
    pub film: [&'a [f32]; 2],
    /// Where the cloud's points lie.
    pub voxels: &'a Voxels,
    /// Features `h`, `(N, C)`.
    pub features: &'a [f32],
}

impl PvBlock {
    /// Adds the block's tensors, but for FiLM's.
    pub fn declare(table: &mut Table, name: &str, channels: usize, grid: Grid) -> Self {
        let layers = [0, 1].map(|k| VoxelLayer::declare(table, name, k, grid, channels));
        let initial = fan_in(channels);
        Self {
            grid,
            channels,
            layers,
            squeeze: Squeeze::declare(table, &format!("{name}.squeeze"), channels),
            point: Dense::declare(table, &format!("{name}.point"), channels, channels, initial),
            point_norm: AffineNorm::declare(
                table,
                &format!("{name}.point_norm"),
                GroupNorm::new(channels),
            ),
            mix: Dense::declare(
                table,
                &format!("{name}.linear"),
                channels,
                channels,
                initial,
            ),
            film: GroupNorm::new(channels),
        }
    }

    /// Packs the block's weights.
    pub fn pack(&self, params: &[f32], passes: Passes, packed: &mut PackedPvBlock) {
        for (layer, packed) in self.layers.iter().zip(&mut packed.convs) {
            packed.set(&layer.conv, params, passes);
        }
        packed.point.set(&self.point, params, passes);
        packed.mix.set(&self.mix, params, passes);
    }

    /// Floating-point operations of the forward pass over `points` points, products alone.
    pub fn flops(&self, points: usize) -> u64 {
        let convs = self.layers.iter().map(|layer| layer.conv.flops());
        let shared = self.point.flops(points) + self.mix.flops(points);
        convs.sum::<u64>() + self.squeeze.flops() + shared
    }

    /// Features `h'`, `(N, C)`.
    pub fn forward(
        &self,
        input: PvInput,
        tape: &mut PvTape,
        scratch: &mut PvScratch,
        output: &mut Vec<f32>,
    ) {
        let PvInput {
            weights,
            film,
            voxels,
            features: h,
        } = input;
        let params = weights.params;
        let (grid, c) = (self.grid, self.channels);
        let PvScratch {
            voxels: [spare, left],
            voxel_workspace: workspace,
            operands,
            ..
        } = scratch;
        self.prepare(h.len(), tape, [spare, left], output);

        // Voxels: g = SiLU(GN(conv(SiLU(GN(conv(average of h per voxel)))))).
        voxels.average(h, c, &mut tape.averages);
        let [first, second] = &mut tape.convolved;
        let [layer1, layer2] = &self.layers;
        let convs = [0, 1].map(|k| weights.of(|packed| &packed.convs[k]));
        let sparse = voxels.sparse(&tape.averages, c);
        layer1.convolve_sparse(convs[0], workspace, sparse, spare, first);
        layer1.activate(params, first, &mut tape.activated);
        layer2.convolve(convs[1], workspace, &tape.activated, second);
        layer2.activate(params, second, left);

        // Gains a(mean g) and features of g at the points.
        let means = workspace.sums.columns(grid.body(left, c), grid.rows(), c);
        tape.squeeze.means.clear();
        let mean = means.iter().map(|sum| (sum / grid.voxels() as f64) as f32);
        tape.squeeze.means.extend(mean);
        self.squeeze.forward(params, &mut tape.squeeze);
        voxels.interpolate(left, c, &mut tape.interpolated);

        // Points: v = a(mean g) * interpolate(g) + SiLU(GN(W_p h + b_p)).
        let rows = Rows::points(h.len() / c);
        let point = weights.of(|packed| &packed.point);
        self.point
            .par_forward(point, operands, h, &mut tape.point.features);
        let Normed {
            features,
            tape: norm,
        } = &mut tape.point;
        self.point_norm
            .forward(params, rows, features, norm, &mut tape.joined);
        add_gained(&tape.interpolated, &tape.squeeze.gains, &mut tape.joined);

        // h' = h + SiLU(FiLM(W_m v + b_m; e)).
        let mix = weights.of(|packed| &packed.mix);
        self.mix
            .par_forward(mix, operands, &tape.joined, &mut tape.mixed.features);
        let Normed { features, tape } = &mut tape.mixed;
        self.film.forward(rows, film, features, tape, output);
        par_add(h, output);
    }

    /// Turns `d` `(N, C)`, the gradient by `h'`, into the gradient by `h`.
    ///
    /// Adds to `gradient` and to `d_film`, the gradients by FiLM's scale and offset.
    pub fn backward(
        &self,
        input: PvInput,
        tape: &mut PvTape,
        scratch: &mut PvScratch,
        d: &mut [f32],
        gradient: &mut [f32],
        d_film: [&mut [f32]; 2],
    ) {
        let PvInput {
            weights,
            film,
            voxels,
            features: h,
        } = input;
        let params = weights.params;
        let (grid, c) = (self.grid, self.channels);
        let rows = Rows::points(h.len() / c);
        let PvScratch {
            voxels: [d_activated, d_voxels],
            points: [d_mixed, d_joined],
            d_averages,
            voxel_workspace: workspace,
            operands,
        } = scratch;
        let sums = &mut workspace.sums;
        // Through FiLM and W_m to the gradient by v; d itself stays, as h' contains h.
        copy(d, d_mixed);
        let Normed {
            features,
            tape: norm,
        } = &mut tape.mixed;
        self.film
            .backward(rows, film, features, norm, d_mixed, d_film);
        let mix = weights.of(|packed| &packed.mix);
        self.mix
            .par_backward(mix, operands, gradient, [&tape.joined, d_mixed], sums);
        d_joined.resize(d.len(), 0.0);
        self.mix
            .par_input_gradient(mix, operands, Accum::Replace, d_mixed, d_joined);

        // Through GN and W_p: the points' share of the gradient by h.
        let d_point = d_mixed;
        copy(d_joined, d_point);
        let Normed {
            features,
            tape: norm,
        } = &mut tape.point;
        self.point_norm
            .backward(params, rows, features, norm, d_point, gradient);
        let point = weights.of(|packed| &packed.point);
        self.point
            .par_backward(point, operands, gradient, [h, d_point], sums);
        self.point
            .par_input_gradient(point, operands, Accum::Add, d_point, d);

        // By the gains, through squeeze and excitation to the means of g; then by g itself.
        let d_gains = sum_products(d_joined, &tape.interpolated, c, sums);
        tape.squeeze.d.clear();
        tape.squeeze.d.extend(d_gains.iter().map(|d| *d as f32));
        self.squeeze.backward(params, &mut tape.squeeze, gradient);
        let d_means = &mut tape.squeeze.d;
        d_means.iter_mut().for_each(|d| *d /= grid.voxels() as f32);
        gain(&tape.squeeze.gains, d_joined);
        voxels.interpolate_backward(d_joined, d_means, d_voxels);

        // Through both convolutions to the averages: the voxels' share of the gradient by h.
        let [first, second] = &mut tape.convolved;
        let [layer1, layer2] = &self.layers;
        let convs = [0, 1].map(|k| weights.of(|packed| &packed.convs[k]));
        layer2.activate_backward(params, second, d_voxels, gradient);
        let matrices: [&[f32]; 2] = [&tape.activated, d_voxels];
        layer2.convolve_backward(convs[1], workspace, matrices, gradient, d_activated);
        layer1.activate_backward(params, first, d_activated, gradient);
        d_averages.clear();
        d_averages.reserve(h.len());
        d_averages.resize(tape.averages.len(), 0.0);
        let sparse = (voxels.sparse(&tape.averages, c), &d_activated[..]);
        // The features between the layers are no longer needed: their buffers are free.
        let spare = [&mut tape.activated[..], d_voxels];
        layer1.convolve_backward_sparse(convs[0], workspace, sparse, spare, gradient, d_averages);
        voxels.average_backward(d_averages, c, d);
    }

    /// Resizes the buffers for features of `len` numbers.
    fn prepare(
        &self,
        len: usize,
        tape: &mut PvTape,
        scratch: [&mut Vec<f32>; 2],
        output: &mut Vec<f32>,
    ) {
        let [first, second] = &mut tape.convolved;
        let grids = [
            &mut first.features,
            &mut second.features,
            &mut tape.activated,
        ];
        grids
            .into_iter()
            .chain(scratch)
            .for_each(|grid| self.grid.prepare(grid, self.channels));
        let points = [&mut tape.point.features, &mut tape.mixed.features];
        for buffer in points
            .into_iter()
            .chain([&mut tape.interpolated, &mut tape.joined, output])
        {
            buffer.resize(len, 0.0);
        }
    }
}

/// Points that a task of the loops takes.
const POINTS: usize = 256;

fn copy(from: &[f32], to: &mut Vec<f32>) {
    to.clear();
    to.extend_from_slice(from);
}

/// `y += x`, in parallel.
fn par_add(x: &[f32], y: &mut [f32]) {
    const PART: usize = 1 << 14;
    y.par_chunks_mut(PART)
        .zip(x.par_chunks(PART))
        .for_each(|(y, x)| add(x, y));
}

/// `y += a * x`, `a` a gain per column.
pub fn add_gained(x: &[f32], gains: &[f32], y: &mut [f32]) {
    let len = POINTS * gains.len();
    y.par_chunks_mut(len)
        .zip(x.par_chunks(len))
        .for_each(|(y, x)| add_gained_rows(x, gains, y));
}

/// `y *= a`, `a` a gain per column.
fn gain(gains: &[f32], y: &mut [f32]) {
    y.par_chunks_mut(POINTS * gains.len())
        .for_each(|y| gain_rows(gains, y));
}

/// Sum over the rows of `x * y`, column by column.
fn sum_products<'a>(x: &[f32], y: &[f32], columns: usize, sums: &'a mut Sums) -> &'a [f64] {
    let len = POINTS * columns;
    sums.over_blocks(x.len().div_ceil(len), columns, |block, partial| {
        let part = block * len..x.len().min((block + 1) * len);
        add_products(&x[part.clone()], &y[part], partial);
    })
}

vectorised! {
    fn add_gained_rows(x: &'a [f32], gains: &'a [f32], y: &'a mut [f32]) {
        let rows = y.chunks_exact_mut(gains.len());
        for (y, x) in rows.zip(x.chunks_exact(gains.len())) {
            for ((y, x), a) in y.iter_mut().zip(x).zip(gains) {
                *y = a.mul_add(*x, *y);
            }
        }
    }
}

vectorised! {
    fn gain_rows(gains: &'a [f32], y: &'a mut [f32]) {
        for y in y.chunks_exact_mut(gains.len()) {
            y.iter_mut().zip(gains).for_each(|(y, a)| *y *= a);
        }
    }
}

vectorised! {
    fn add_products(x: &'a [f32], y: &'a [f32], sums: &'a mut [f32]) {
        let c = sums.len();
        for (x, y) in x.chunks_exact(c).zip(y.chunks_exact(c)) {
            for ((sum, x), y) in sums.iter_mut().zip(x).zip(y) {
                *sum = x.mul_add(*y, *sum);
            }
        }
    }
}
