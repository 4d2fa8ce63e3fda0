//! Point-voxel convolution and the residual block about it.

use faer::Accum;
use rayon::prelude::*;

use super::bf16::{Operands, PackedWeight, Passes};
use super::conv3d::Conv3d;
use super::conv3d_bf16::PackedConv;
use super::dense::Dense;
use super::grid::Grid;
use super::group_norm::{AffineNorm, GroupNorm, Normed};
use super::kernels::{add, vectorised};
use super::rows::{Rows, Sums};
use super::shape::{Table, fan_in};
use super::squeeze::{Squeeze, SqueezeTape};
use super::voxels::Voxels;
use super::weights::Weights;

/// A convolution with its norm.
#[derive(Clone, Debug)]
struct VoxelLayer {
    conv: Conv3d,
    norm: AffineNorm,
}

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
pub(super) struct PvBlock {
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
pub(super) struct PackedPvBlock {
    convs: [PackedConv; 2],
    point: PackedWeight,
    mix: PackedWeight,
}

/// Features of one cloud that the backward pass needs. Grids have margins.
#[derive(Debug, Default)]
pub(super) struct PvTape {
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

/// Memory that blocks of one shape share: grids with margins, and points.
#[derive(Debug, Default)]
pub(super) struct PvScratch {
    voxels: [Vec<f32>; 2],
    points: [Vec<f32>; 2],
    sums: Sums,
    /// For products of voxels and of points.
    rooms: [Operands; 2],
}

/// What a block acts on.
#[derive(Clone, Copy)]
pub(super) struct PvInput<'a> {
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
        let layers = [0, 1].map(|k| VoxelLayer {
            conv: Conv3d::declare(
                table,
                &format!("{name}.convs.{k}"),
                grid,
                channels,
                channels,
            ),
            norm: AffineNorm::declare(table, &format!("{name}.conv_norms.{k}"), channels),
        });
        let initial = fan_in(channels);
        Self {
            grid,
            channels,
            layers,
            squeeze: Squeeze::declare(table, &format!("{name}.squeeze"), channels),
            point: table.dense(&format!("{name}.point"), channels, channels, initial),
            point_norm: AffineNorm::declare(table, &format!("{name}.point_norm"), channels),
            mix: table.dense(&format!("{name}.linear"), channels, channels, initial),
            film: GroupNorm { channels },
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
            voxels: [entered, left],
            sums,
            rooms: [operands, point_operands],
            ..
        } = scratch;
        self.prepare(h.len(), tape, [entered, left], output);

        voxels.average(h, c, entered);
        let [first, second] = &mut tape.convolved;
        let [layer1, layer2] = &self.layers;
        let convs = [0, 1].map(|k| weights.of(|packed| &packed.convs[k]));
        layer1.forward(convs[0], operands, entered, first, &mut tape.activated);
        layer2.forward(convs[1], operands, &tape.activated, second, left);

        let means = sums.columns(grid.body(left, c), grid.rows(), c);
        tape.squeeze.means.clear();
        let mean = means.iter().map(|sum| (sum / grid.voxels() as f64) as f32);
        tape.squeeze.means.extend(mean);
        self.squeeze.forward(params, &mut tape.squeeze);
        voxels.interpolate(left, c, &mut tape.interpolated);

        let rows = Rows::points(h.len() / c);
        let point = weights.of(|packed| &packed.point);
        self.point
            .par_forward(point, point_operands, h, &mut tape.point.features);
        let Normed {
            features,
            tape: norm,
        } = &mut tape.point;
        self.point_norm
            .forward(params, rows, features, norm, &mut tape.joined);
        add_gained(&tape.interpolated, &tape.squeeze.gains, &mut tape.joined);

        let mix = weights.of(|packed| &packed.mix);
        self.mix
            .par_forward(mix, point_operands, &tape.joined, &mut tape.mixed.features);
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
            voxels: [entered, d_voxels],
            points: [d_mixed, d_joined],
            sums,
            rooms: [operands, point_operands],
        } = scratch;
        copy(d, d_mixed);
        let Normed {
            features,
            tape: norm,
        } = &mut tape.mixed;
        self.film
            .backward(rows, film, features, norm, d_mixed, d_film);
        let mix = weights.of(|packed| &packed.mix);
        self.mix
            .par_backward(mix, point_operands, gradient, [&tape.joined, d_mixed], sums);
        d_joined.resize(d.len(), 0.0);
        self.mix
            .par_input_gradient(mix, point_operands, Accum::Replace, d_mixed, d_joined);

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
            .par_backward(point, point_operands, gradient, [h, d_point], sums);
        self.point
            .par_input_gradient(point, point_operands, Accum::Add, d_point, d);

        let d_gains = sum_products(d_joined, &tape.interpolated, c, sums);
        tape.squeeze.d.clear();
        tape.squeeze.d.extend(d_gains.iter().map(|d| *d as f32));
        self.squeeze.backward(params, &mut tape.squeeze, gradient);
        let d_means = &mut tape.squeeze.d;
        d_means.iter_mut().for_each(|d| *d /= grid.voxels() as f32);
        gain(&tape.squeeze.gains, d_joined);
        voxels.interpolate_backward(d_joined, d_means, d_voxels);

        let [first, second] = &mut tape.convolved;
        let [layer1, layer2] = &self.layers;
        let convs = [0, 1].map(|k| weights.of(|packed| &packed.convs[k]));
        layer2.backward(
            convs[1],
            operands,
            (&tape.activated, d_voxels),
            second,
            gradient,
            sums,
        );
        let d_activated = entered;
        layer2.backward_input(convs[1], operands, d_voxels, d_activated);
        // What entered the first convolution is made again, where its output was.
        let entered = &mut tape.activated;
        voxels.average(h, c, entered);
        layer1.backward(
            convs[0],
            operands,
            (entered, d_activated),
            first,
            gradient,
            sums,
        );
        layer1.backward_input(convs[0], operands, d_activated, d_voxels);
        voxels.average_backward(d_voxels, c, d);
    }

    /// Room for features of `len` numbers.
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

impl VoxelLayer {
    /// Grid `y` from grid `x`.
    fn forward(
        &self,
        weights: Weights<PackedConv>,
        operands: &mut Operands,
        x: &[f32],
        normed: &mut Normed,
        y: &mut [f32],
    ) {
        let (grid, channels) = (self.conv.grid, self.norm.norm.channels);
        let Normed { features, tape } = normed;
        let params = weights.params;
        match weights.packed {
            None => self.conv.forward(params, x, features),
            Some(packed) => self
                .conv
                .forward_bf16(params, packed, operands, x, features),
        }
        let (features, y) = (
            grid.body_mut(features, channels),
            grid.body_mut(y, channels),
        );
        self.norm.forward(params, grid.rows(), features, tape, y);
    }

    /// Turns `d`, the gradient by `y`, into the gradient behind the convolution of `x`; adds to `gradient`.
    fn backward(
        &self,
        weights: Weights<PackedConv>,
        operands: &mut Operands,
        (x, d): (&[f32], &mut [f32]),
        normed: &mut Normed,
        gradient: &mut [f32],
        sums: &mut Sums,
    ) {
        let (grid, channels) = (self.conv.grid, self.norm.norm.channels);
        let Normed { features, tape } = normed;
        let (features, rows) = (grid.body(features, channels), grid.rows());
        let body = grid.body_mut(d, channels);
        self.norm
            .backward(weights.params, rows, features, tape, body, gradient);
        match weights.packed {
            None => self.conv.backward(gradient, x, d, sums),
            Some(_) => self.conv.backward_bf16(operands, gradient, x, d, sums),
        }
    }

    /// The gradient `dx` from the gradient `d` behind the convolution.
    fn backward_input(
        &self,
        weights: Weights<PackedConv>,
        operands: &mut Operands,
        d: &[f32],
        dx: &mut [f32],
    ) {
        match weights.packed {
            None => self.conv.backward_input(weights.params, d, dx),
            Some(packed) => self.conv.backward_input_bf16(packed, operands, d, dx),
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
fn add_gained(x: &[f32], gains: &[f32], y: &mut [f32]) {
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
