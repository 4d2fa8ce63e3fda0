//! Loss and gradient of a batch of clouds.

use std::ops::Range;

use rayon::prelude::*;

use super::conditioner::ConditionerTape;
use super::trunk::{Keep, TilePass, Trunk, TrunkGradient, TrunkTapes};
use super::trunk_bf16::{self, PackedTrunk};
use super::velocity::Mlp;
use crate::channels::{Channels, DIM};
use crate::net::hybrid::CloudTape;
use crate::net::kernels::float32::add;
use crate::net::layers::{Passes, Weights};

/// Tiles per share, the unit of parallel work. Fixed, so that sums are grouped alike for any number of threads.
const SHARE: usize = 8;

/// Most points of a tile, whatever its numbers.
const LARGEST_TILE: usize = trunk_bf16::TILE;

/// Parameters that one task clears, or sums over the shares.
pub const STRIPE: usize = 4096;

/// The paper's weight of the colours' error (Eq. rgb_loss_tdcr): `lambda_rgb`.
pub const COLOR_WEIGHT: f32 = 0.05;

/// Clouds with flow times, in normalised units, and the velocities that the network should have there.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// Flow time of every cloud, `(B)`.
    pub times: &'a [f32],
    /// Conditions, row-major `(B, D)`.
    pub conditions: &'a [f32],
    /// Points on the path `X_t`, row-major `(B, N, C)`.
    pub points: &'a [f32],
    /// Target velocities, row-major `(B, N, C)`.
    pub targets: &'a [f32],
    /// Weight of the colours' error beside the positions'; without effect on clouds without colours.
    pub color_weight: f32,
}

impl Batch<'_> {
    /// Number of clouds `B`.
    pub fn clouds(&self) -> usize {
        self.times.len()
    }

    /// Refuses slices that do not fit each other or a network of `condition_dim`, `channels` and `parameters`.
    pub fn check(
        &self,
        condition_dim: usize,
        channels: Channels,
        [parameters, derivatives]: [usize; 2],
    ) {
        let clouds = self.clouds();
        let conditions = clouds * condition_dim;
        assert_eq!(self.conditions.len(), conditions, "condition dimension");
        assert_eq!(
            self.points.len(),
            self.targets.len(),
            "one target per point"
        );
        assert_eq!(derivatives, parameters, "one derivative per parameter");
        let whole = self.points.len().is_multiple_of(clouds * channels.count());
        assert!(!self.points.is_empty() && whole, "points (B, N, C)");
    }

    /// Loss that belongs to this batch.
    pub fn loss(&self, channels: Channels) -> Loss {
        let points = self.points.len() / channels.count();
        Loss {
            channels: channels.count(),
            components: points * DIM,
            color_weight: self.color_weight,
        }
    }
}

/// Memory of a network's `loss_and_gradient`, kept from step to step.
#[derive(Debug, Default)]
pub struct Workspace {
    pub conditioner: ConditionerTape,
    pub shares: Vec<Share>,
    pub d_modulation: Vec<f32>,
    pub cloud: Option<CloudTape>,
    pub packed: PackedTrunk,
}

/// Some points of one cloud, and their part of the loss and of the gradient.
#[derive(Debug, Default)]
pub struct Share {
    pub cloud: usize,
    pub points: Range<usize>,
    pub squared_error: f64,
    pub gradient: TrunkGradient,
}

impl Mlp {
    /// Mean squared velocity error over all `B N 3` components of the positions (paper, Eq. fm_loss_tdcr, divided by
    /// their number), plus [`Batch::color_weight`] times that of the colours (Eq. rgb_loss_tdcr); and its gradient by the
    /// parameters, written over `gradient`.
    ///
    /// Points run in parallel; the result does not depend on the number of threads.
    ///
    /// # Panics
    /// Where the batch holds no point or a slice's length does not fit the others or the network.
    pub fn loss_and_gradient(
        &self,
        batch: &Batch,
        workspace: &mut Workspace,
        gradient: &mut [f32],
    ) -> f64 {
        let (shape, params) = (self.shape(), self.params());
        let sizes = [params.len(), gradient.len()];
        batch.check(shape.condition_dim, shape.channels, sizes);
        let Workspace {
            conditioner,
            shares,
            d_modulation,
            cloud: _,
            packed,
        } = workspace;
        self.conditioner
            .forward(params, batch.times, batch.conditions, conditioner);
        let (clouds, channels) = (batch.clouds(), shape.channels.count());
        let pass = PointPass {
            trunk: &self.trunk,
            weights: self.trunk_weights(packed, Passes::Training),
            tapes: &self.tapes,
            loss: batch.loss(shape.channels),
        };
        let points = batch.points.len() / clouds / channels;
        divide(clouds, points, SHARE * pass.weights.tile(), shares);
        let modulation_len = self.conditioner.outputs();
        shares.par_iter_mut().for_each(|share| {
            let modulation = &conditioner.modulation[share.cloud * modulation_len..];
            pass.run(
                &modulation[..modulation_len],
                batch.points,
                batch.targets,
                share,
            );
        });

        gradient.fill(0.0);
        add_trunk_gradients(shares, &mut gradient[self.trunk.range.clone()]);
        reset(d_modulation, clouds * modulation_len);
        for share in &*shares {
            let d_modulation = &mut d_modulation[share.cloud * modulation_len..];
            add(
                &share.gradient.modulation,
                &mut d_modulation[..modulation_len],
            );
        }
        self.conditioner.backward(
            params,
            batch.conditions,
            conditioner,
            d_modulation,
            gradient,
        );
        shares.iter().map(|share| share.squared_error).sum::<f64>() / pass.loss.components as f64
    }
}

/// Forward and backward pass of the layers that act on points.
pub struct PointPass<'a> {
    pub trunk: &'a Trunk,
    pub weights: Weights<'a, PackedTrunk>,
    pub tapes: &'a TrunkTapes,
    pub loss: Loss,
}

impl PointPass<'_> {
    /// One share, tile by tile: `points` `(.., inputs)` and `targets` `(.., C)` are of all shares.
    pub fn run(&self, modulation: &[f32], points: &[f32], targets: &[f32], share: &mut Share) {
        self.trunk.with_pass(self.weights, self.tapes, |pass| {
            self.evaluate(modulation, points, targets, share, pass);
        });
    }

    fn evaluate(
        &self,
        modulation: &[f32],
        points: &[f32],
        targets: &[f32],
        share: &mut Share,
        pass: &mut dyn TilePass,
    ) {
        let (inputs, channels) = (self.trunk.input.inputs, self.loss.channels);
        let Range { start, end } = share.points;
        share.squared_error = 0.0;
        reset(&mut share.gradient.params, self.weights.params.len());
        reset(&mut share.gradient.modulation, modulation.len());
        if let Some(d_points) = &mut share.gradient.points {
            d_points.clear();
        }
        let tile = self.weights.tile();
        let points = points[start * inputs..end * inputs].chunks(tile * inputs);
        let targets = targets[start * channels..end * channels].chunks(tile * channels);
        let mut velocities = [0.0; LARGEST_TILE * Channels::XyzRgb.count()];
        for (points, targets) in points.zip(targets) {
            let velocities = &mut velocities[..targets.len()];
            pass.forward(modulation, points, Keep::EveryBlock, velocities);
            share.squared_error += self.loss.differentiate(velocities, targets);
            pass.backward(modulation, points, velocities, &mut share.gradient);
        }
    }
}

/// Mean squared velocity error, colours weighted.
#[derive(Clone, Copy, Debug)]
pub struct Loss {
    channels: usize,
    /// Number of the positions' components, by which the squared error is divided.
    pub components: usize,
    color_weight: f32,
}

impl Loss {
    /// Replaces velocities by the loss's gradient by them; returns the sum of weighted squared errors.
    fn differentiate(&self, velocities: &mut [f32], targets: &[f32]) -> f64 {
        let factor = 2.0 / self.components as f32;
        let mut squared_error = 0.0;
        let rows = velocities.chunks_exact_mut(self.channels);
        for (velocities, targets) in rows.zip(targets.chunks_exact(self.channels)) {
            for (k, (velocity, target)) in velocities.iter_mut().zip(targets).enumerate() {
                let weight = if k < DIM { 1.0 } else { self.color_weight };
                let error = *velocity - target;
                squared_error += f64::from(weight) * f64::from(error) * f64::from(error);
                *velocity = weight * factor * error;
            }
        }
        squared_error
    }
}

/// Divides `clouds` clouds of `points` points into shares of `len` points, cloud by cloud. Keeps the buffers of `shares`.
pub fn divide(clouds: usize, points: usize, len: usize, shares: &mut Vec<Share>) {
    let per_cloud = points.div_ceil(len);
    shares.resize_with(clouds * per_cloud, Share::default);
    for (index, share) in shares.iter_mut().enumerate() {
        share.cloud = index / per_cloud;
        let start = index % per_cloud * len;
        let first = share.cloud * points;
        share.points = first + start..first + points.min(start + len);
    }
}

/// Adds the shares' trunk gradients to `total`, in order.
pub fn add_trunk_gradients(shares: &[Share], total: &mut [f32]) {
    total
        .par_chunks_mut(STRIPE)
        .enumerate()
        .for_each(|(index, stripe)| {
            for share in shares {
                add(
                    &share.gradient.params[index * STRIPE..][..stripe.len()],
                    stripe,
                );
            }
        });
}

/// `len` zeros.
pub fn reset(buffer: &mut Vec<f32>, len: usize) {
    buffer.clear();
    buffer.resize(len, 0.0);
}
