//! Points of a batch in shares, the unit of parallel work, and their part of loss and gradient.

use std::ops::Range;

use rayon::prelude::*;

use super::batch::Loss;
use super::trunk::{TilePass, Trunk, TrunkGradient};
use super::trunk_bf16::PackedTrunk;
use super::trunk_tiles::{LARGEST_TILE, TrunkTapes};
use crate::channels::Channels;
use crate::net::kernels::float32::{add, reset};
use crate::net::layers::{Keep, Weights};

/// Parameters per task that clears a gradient or sums it over the shares.
pub const STRIPE: usize = 4096;

/// Some points of one cloud, and their part of the loss and of the gradient.
#[derive(Debug, Default)]
pub struct Share {
    pub cloud: usize,
    pub points: Range<usize>,
    pub squared_error: f64,
    pub gradient: TrunkGradient,
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

/// Adds gradients to `total`, in order.
pub fn add_gradients<'a>(
    gradients: impl Iterator<Item = &'a [f32]> + Clone + Sync,
    total: &mut [f32],
) {
    total
        .par_chunks_mut(STRIPE)
        .enumerate()
        .for_each(|(index, stripe)| {
            for gradient in gradients.clone() {
                add(&gradient[index * STRIPE..][..stripe.len()], stripe);
            }
        });
}
