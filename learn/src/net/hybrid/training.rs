//! The Hybrid's loss and gradient.

use rayon::iter::once;
use rayon::prelude::*;

use super::context::{ContextInput, ContextNet};
use super::context_kind::Split;
use super::velocity::{CloudTape, Hybrid, Packed};
use crate::net::kernels::float32::{add, reset};
use crate::net::layers::Passes;
use crate::net::mlp::{
    Batch, Cloud, ConditionerTape, Loss, PointPass, STRIPE, Share, add_gradients, divide,
};
use crate::net::parameters::Parameters;

/// Points per share of a cloud: fewer than of the MLP's batches of many clouds.
const SHARE: usize = 1024;

/// Lanes that small clouds are divided among.
const LANES: usize = 8;

/// Floating-point operations of a forward pass from which on a cloud has all threads to itself.
///
/// A cloud's hundreds of parallel loops wake threads and wait for them, which takes a third of a small cloud's time. The memory
/// of a lane grows with the operations.
const LARGE_CLOUD: u64 = 1 << 30;

/// Buffers of [`Hybrid::loss_and_gradient`], kept from step to step.
#[derive(Debug, Default)]
pub struct HybridWorkspace {
    conditioner: ConditionerTape,
    packed: Packed<ContextNet>,
    d_modulation: Vec<f32>,
    lanes: Vec<Lane>,
    /// Gradients of the lanes but the first, whose gradient becomes the batch's.
    gradients: Vec<Vec<f32>>,
}

/// Clouds that run one after the other, beside those of other lanes: their buffers and sums.
#[derive(Debug)]
struct Lane {
    shares: Vec<Share>,
    tape: CloudTape<ContextNet>,
    squared_error: f64,
}

/// One cloud of a batch.
struct CloudBatch<'a> {
    cloud: Cloud<'a>,
    modulation: Split<&'a [f32]>,
    targets: &'a [f32],
    loss: Loss,
}

impl Hybrid<ContextNet> {
    /// Loss and gradient as [`Mlp::loss_and_gradient`](crate::net::mlp::Mlp::loss_and_gradient) has them.
    ///
    /// Small clouds run in parallel; large ones one after the other, the points and voxels of each in parallel. The result does
    /// not depend on the number of threads.
    ///
    /// # Panics
    /// Where the batch holds no point or a slice's length does not fit the others or the network.
    pub fn loss_and_gradient(
        &self,
        parameters: Parameters,
        batch: &Batch,
        workspace: &mut HybridWorkspace,
        gradient: &mut [f32],
    ) -> f64 {
        let (head, params) = (self.shape.head, parameters.values);
        batch.check(
            head.condition_dim,
            head.channels,
            [params.len(), gradient.len()],
        );
        let HybridWorkspace {
            conditioner: tape,
            packed,
            d_modulation,
            lanes,
            gradients,
        } = workspace;
        let conditioner = &self.layers.conditioner;
        conditioner.forward(params, batch.times, batch.conditions, tape);
        reset(d_modulation, tape.modulation.len());
        self.pack(parameters, Passes::Training, packed);

        let clouds = batch.clouds();
        let points = batch.points.len() / (clouds * head.channels.count());
        let per_lane = self.clouds_per_lane(clouds, points);
        let count = clouds.div_ceil(per_lane);
        lanes.resize_with(count, || Lane {
            shares: Vec::new(),
            tape: self.cloud_tape(),
            squared_error: 0.0,
        });
        gradients.resize_with(count - 1, Vec::new);
        let others = gradients.par_iter_mut().map(|gradient| {
            gradient.resize(params.len(), 0.0);
            &mut gradient[..]
        });
        let (outputs, dim) = (conditioner.outputs(), head.condition_dim);
        let loss = batch.loss(head.channels);
        lanes
            .par_iter_mut()
            .zip(once(&mut *gradient).chain(others))
            .zip(d_modulation.par_chunks_mut(per_lane * outputs))
            .enumerate()
            .for_each(|(index, ((lane, gradient), d_modulation))| {
                gradient
                    .par_chunks_mut(STRIPE)
                    .for_each(|stripe| stripe.fill(0.0));
                divide(1, points, SHARE, &mut lane.shares);
                lane.squared_error = 0.0;
                for (k, d_modulation) in d_modulation.chunks_exact_mut(outputs).enumerate() {
                    let k = index * per_lane + k;
                    let stride = points * head.channels.count();
                    let sample = CloudBatch {
                        cloud: Cloud {
                            time: batch.times[k],
                            condition: &batch.conditions[k * dim..(k + 1) * dim],
                            points: &batch.points[k * stride..(k + 1) * stride],
                        },
                        modulation: self.split(&tape.modulation[k * outputs..(k + 1) * outputs]),
                        targets: &batch.targets[k * stride..(k + 1) * stride],
                        loss,
                    };
                    self.evaluate(
                        parameters,
                        &sample,
                        packed,
                        lane,
                        gradient,
                        self.split_mut(d_modulation),
                    );
                }
            });
        add_gradients(gradients.iter().map(Vec::as_slice), gradient);
        conditioner.backward(params, batch.conditions, tape, d_modulation, gradient);
        lanes.iter().map(|lane| lane.squared_error).sum::<f64>() / loss.components as f64
    }

    /// Clouds of a lane: all of them where they are large. It does not depend on the number of threads, nor do the sums.
    fn clouds_per_lane(&self, clouds: usize, points: usize) -> usize {
        if self.flops(points) < LARGE_CLOUD {
            clouds.div_ceil(LANES)
        } else {
            clouds
        }
    }

    /// Forward and backward pass of one cloud, whose squared error is added to the lane's.
    fn evaluate(
        &self,
        parameters: Parameters,
        sample: &CloudBatch,
        packed: &Packed<ContextNet>,
        lane: &mut Lane,
        gradient: &mut [f32],
        d_modulation: Split<&mut [f32]>,
    ) {
        let Lane {
            shares,
            tape,
            squared_error,
        } = lane;
        let (trunk, context) = (&self.layers.trunk, &self.layers.context);
        let CloudBatch {
            cloud, modulation, ..
        } = *sample;
        self.fill_inputs(parameters, cloud, modulation, packed, tape);
        let pass = PointPass {
            trunk,
            weights: self.trunk_weights(parameters, packed),
            tapes: &self.tapes,
            loss: sample.loss,
        };
        shares.par_iter_mut().for_each(|share| {
            share.gradient.points.get_or_insert_default();
            pass.run(modulation.head, &tape.inputs, sample.targets, share);
        });
        let trunk_gradients = shares.iter().map(|share| &share.gradient.params[..]);
        add_gradients(trunk_gradients, &mut gradient[trunk.range.clone()]);
        for share in &*shares {
            add(&share.gradient.modulation, d_modulation.head);
            *squared_error += share.squared_error;
        }
        self.blend_backward(cloud.time, shares, tape, d_modulation.global);
        context.backward(
            ContextInput::new(self.context_weights(parameters, packed), cloud, modulation),
            &tape.d_context,
            &mut tape.context,
            gradient,
            [d_modulation.shift, d_modulation.films],
        );
    }

    /// Splits the gradient by `C`, which the shares have, into those by the cloud's context and by the embedding's.
    fn blend_backward(
        &self,
        time: f32,
        shares: &[Share],
        tape: &mut CloudTape<ContextNet>,
        d_global: &mut [f32],
    ) {
        let (own, features) = (self.shape.head.point_inputs(), d_global.len());
        let weight = self.shape.context.gate.weight(time);
        tape.d_context.clear();
        let d_points = shares.iter().flat_map(|share| &share.gradient.points);
        for d in d_points.flat_map(|d| d.chunks_exact(own + features)) {
            let d = &d[own..];
            tape.d_context.extend(d.iter().map(|d| weight * d));
            d_global
                .iter_mut()
                .zip(d)
                .for_each(|(total, d)| *total += (1.0 - weight) * d);
        }
    }

    fn split_mut<'a>(&self, modulation: &'a mut [f32]) -> Split<&'a mut [f32]> {
        let [global, shift, head] = self.ends();
        let (modulation, films) = modulation.split_at_mut(head);
        let (modulation, head) = modulation.split_at_mut(shift);
        let (global, shift) = modulation.split_at_mut(global);
        Split {
            global,
            shift,
            head,
            films,
        }
    }
}
