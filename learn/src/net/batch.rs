//! Loss and gradient of a batch of clouds.

use std::ops::Range;

use rayon::prelude::*;

use super::conditioner::ConditionerTape;
use super::kernels::add;
use super::mlp::Mlp;
use super::shape::DIM;
use super::trunk::{Keep, TILE, TrunkGradient, TrunkTape};

/// Points per share: the unit of parallel work. Fixed, so that sums are grouped alike for any number of threads.
const SHARE: usize = 8 * TILE;

/// Parameters that one task sums over the shares.
const STRIPE: usize = 4096;

/// Clouds with flow times, in normalised units, and the velocities that the network should have there.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// Flow time of every cloud, `(B)`.
    pub times: &'a [f32],
    /// Conditions, row-major `(B, D)`.
    pub conditions: &'a [f32],
    /// Points on the path `X_t`, row-major `(B, N, 3)`.
    pub points: &'a [f32],
    /// Target velocities, row-major `(B, N, 3)`.
    pub targets: &'a [f32],
}

/// Memory of [`Mlp::loss_and_gradient`], kept from step to step.
#[derive(Debug, Default)]
pub struct Workspace {
    conditioner: ConditionerTape,
    shares: Vec<Share>,
    d_modulation: Vec<f32>,
}

/// Some points of one cloud, and their part of the loss and of the gradient.
#[derive(Debug, Default)]
struct Share {
    cloud: usize,
    points: Range<usize>,
    squared_error: f64,
    gradient: TrunkGradient,
}

impl Mlp {
    /// Mean squared velocity error over all `B N 3` components (paper, Eq. fm_loss_tdcr, divided by their number), and
    /// its gradient by the parameters, written over `gradient`.
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
        let clouds = batch.times.len();
        assert_eq!(
            batch.conditions.len(),
            clouds * self.shape().condition_dim,
            "condition dimension"
        );
        assert_eq!(
            batch.points.len(),
            batch.targets.len(),
            "one target per point"
        );
        assert_eq!(
            gradient.len(),
            self.params().len(),
            "one derivative per parameter"
        );
        assert!(
            !batch.points.is_empty() && batch.points.len().is_multiple_of(clouds * DIM),
            "points (B, N, 3)"
        );

        let Workspace {
            conditioner,
            shares,
            d_modulation,
        } = workspace;
        self.conditioner
            .forward(self.params(), batch.times, batch.conditions, conditioner);
        divide(clouds, batch.points.len() / clouds / DIM, shares);
        shares.par_iter_mut().for_each(|share| {
            self.tapes.with(
                || self.trunk.tape(),
                |tape| self.evaluate(batch, &conditioner.modulation, share, tape),
            );
        });

        let (per_cloud, per_point) = gradient.split_at_mut(self.trunk.start);
        sum_trunk_gradients(shares, per_point);
        sum_modulation_gradients(shares, clouds, d_modulation);
        per_cloud.fill(0.0);
        self.conditioner.backward(
            self.params(),
            batch.conditions,
            conditioner,
            d_modulation,
            per_cloud,
        );
        let squared_error: f64 = shares.iter().map(|share| share.squared_error).sum();
        squared_error / batch.points.len() as f64
    }

    /// Forward and backward pass of one share, tile by tile.
    fn evaluate(
        &self,
        batch: &Batch,
        modulations: &[f32],
        share: &mut Share,
        tape: &mut TrunkTape,
    ) {
        let params = &self.params()[self.trunk.start..];
        let modulation_len = self.shape().modulation_len();
        let modulation = &modulations[share.cloud * modulation_len..][..modulation_len];
        share.squared_error = 0.0;
        reset(&mut share.gradient.params, params.len());
        reset(&mut share.gradient.modulation, modulation_len);
        let components = share.points.start * DIM..share.points.end * DIM;
        let points = batch.points[components.clone()].chunks(TILE * DIM);
        let mut velocities = [0.0; TILE * DIM];
        for (points, targets) in points.zip(batch.targets[components].chunks(TILE * DIM)) {
            let velocities = &mut velocities[..points.len()];
            self.trunk.forward(
                params,
                modulation,
                points,
                Keep::EveryBlock,
                tape,
                velocities,
            );
            share.squared_error += to_loss_gradient(velocities, targets, batch.points.len());
            self.trunk.backward(
                params,
                modulation,
                points,
                velocities,
                tape,
                &mut share.gradient,
            );
        }
    }
}

/// Replaces velocities by the gradient of the mean squared error by them; returns the sum of squared errors.
fn to_loss_gradient(velocities: &mut [f32], targets: &[f32], components: usize) -> f64 {
    let factor = 2.0 / components as f32;
    let mut squared_error = 0.0;
    for (velocity, target) in velocities.iter_mut().zip(targets) {
        let error = *velocity - target;
        squared_error += f64::from(error) * f64::from(error);
        *velocity = factor * error;
    }
    squared_error
}

/// Divides `clouds` clouds of `points` points into shares, cloud by cloud. Keeps the buffers of `shares`.
fn divide(clouds: usize, points: usize, shares: &mut Vec<Share>) {
    let per_cloud = points.div_ceil(SHARE);
    shares.resize_with(clouds * per_cloud, Share::default);
    for (index, share) in shares.iter_mut().enumerate() {
        share.cloud = index / per_cloud;
        let start = index % per_cloud * SHARE;
        let first = share.cloud * points;
        share.points = first + start..first + points.min(start + SHARE);
    }
}

/// `total` = sum of the shares' trunk gradients, in order.
fn sum_trunk_gradients(shares: &[Share], total: &mut [f32]) {
    total
        .par_chunks_mut(STRIPE)
        .enumerate()
        .for_each(|(index, stripe)| {
            stripe.fill(0.0);
            for share in shares {
                add(
                    &share.gradient.params[index * STRIPE..][..stripe.len()],
                    stripe,
                );
            }
        });
}

/// `total` `(B, M)` = sum of each cloud's shares' modulation gradients, in order.
fn sum_modulation_gradients(shares: &[Share], clouds: usize, total: &mut Vec<f32>) {
    let len = shares[0].gradient.modulation.len();
    reset(total, clouds * len);
    for share in shares {
        add(
            &share.gradient.modulation,
            &mut total[share.cloud * len..][..len],
        );
    }
}

/// `len` zeros.
fn reset(buffer: &mut Vec<f32>, len: usize) {
    buffer.clear();
    buffer.resize(len, 0.0);
}
