//! The MLP: its layers, velocities, loss and gradient.

use rayon::prelude::*;

use super::batch::{Batch, Cloud};
use super::conditioner::{Conditioner, ConditionerTape};
use super::point_features::point_inputs;
use super::shape::MlpShape;
use super::shares::{PointPass, Share, add_gradients, divide};
use super::trunk::Trunk;
use super::trunk_bf16::PackedTrunk;
use super::trunk_tiles::TrunkTapes;
use crate::net::kernels::Precision;
use crate::net::kernels::float32::{add, reset};
use crate::net::layers::{Passes, Weights};
use crate::net::parameters::{Parameters, Table};
use crate::pool::Pool;

/// Tiles per share, the unit of parallel work. Fixed, so that sums are grouped alike for any number of threads.
const SHARE: usize = 8;

/// The paper's MLP velocity network (Sec. Method, Eq. mlp_velocity): every point alone, weights shared.
#[derive(Clone, Debug)]
pub struct Mlp {
    shape: MlpShape,
    conditioner: Conditioner,
    trunk: Trunk,
    tapes: TrunkTapes,
    scratch: Pool<Scratch>,
}

/// Buffers of a cloud's velocities.
#[derive(Debug, Default)]
struct Scratch {
    conditioner: ConditionerTape,
    packed: PackedTrunk,
    /// Inputs of the points, where they have Fourier features.
    inputs: Vec<f32>,
}

/// Buffers of [`Mlp::loss_and_gradient`], kept from step to step.
#[derive(Debug, Default)]
pub struct MlpWorkspace {
    conditioner: ConditionerTape,
    shares: Vec<Share>,
    d_modulation: Vec<f32>,
    packed: PackedTrunk,
    inputs: Vec<f32>,
}

impl Mlp {
    /// Adds the tensors of a network of `shape` to `table`; returns its layers.
    pub fn declare(shape: MlpShape, table: &mut Table) -> Self {
        let (conditioner, trunk) = shape.declare(table);
        Self {
            shape,
            conditioner,
            trunk,
            tapes: TrunkTapes::default(),
            scratch: Pool::default(),
        }
    }

    /// The trunk's weights, packed for `passes` where the operand type is bfloat16.
    fn trunk_weights<'a>(
        &self,
        parameters: Parameters<'a>,
        packed: &'a mut PackedTrunk,
        passes: Passes,
    ) -> Weights<'a, PackedTrunk> {
        let params = &parameters.values[self.trunk.range.clone()];
        let packed = match parameters.precision {
            Precision::Float32 => None,
            Precision::Bfloat16 => {
                packed.set(&self.trunk, params, passes);
                Some(&*packed)
            }
        };
        Weights { params, packed }
    }

    /// Floating-point operations of the velocities of a cloud of `points` points, products alone.
    pub fn flops(&self, points: usize) -> u64 {
        self.conditioner.flops() + self.trunk.flops(points)
    }

    /// Loss of `batch`, and its gradient by the parameters, written over `gradient`: the mean squared velocity error of all
    /// positions' components, plus the weighted one of the colours' ([`Loss`](super::batch::Loss)).
    ///
    /// Points run in parallel; the result does not depend on the number of threads.
    ///
    /// # Panics
    /// Where the batch holds no point or a slice's length does not fit the others or the network.
    pub fn loss_and_gradient(
        &self,
        parameters: Parameters,
        batch: &Batch,
        workspace: &mut MlpWorkspace,
        gradient: &mut [f32],
    ) -> f64 {
        let (shape, params) = (self.shape, parameters.values);
        let sizes = [params.len(), gradient.len()];
        batch.check(shape.condition_dim, shape.channels, sizes);
        let MlpWorkspace {
            conditioner,
            shares,
            d_modulation,
            packed,
            inputs,
        } = workspace;
        let inputs = point_inputs(&shape, batch.points, inputs);
        self.conditioner
            .forward(params, batch.times, batch.conditions, conditioner);
        let (clouds, channels) = (batch.clouds(), shape.channels.count());
        let pass = PointPass {
            trunk: &self.trunk,
            weights: self.trunk_weights(parameters, packed, Passes::Training),
            tapes: &self.tapes,
            loss: batch.loss(shape.channels),
        };
        let points = batch.points.len() / clouds / channels;
        divide(clouds, points, SHARE * pass.weights.tile(), shares);
        let modulation_len = self.conditioner.outputs();
        shares.par_iter_mut().for_each(|share| {
            let modulation = &conditioner.modulation[share.cloud * modulation_len..];
            pass.run(&modulation[..modulation_len], inputs, batch.targets, share);
        });

        // Gradients of the shares, summed in order: by the trunk's parameters, and by each cloud's modulation.
        gradient.fill(0.0);
        let trunk_gradients = shares.iter().map(|share| &share.gradient.params[..]);
        add_gradients(trunk_gradients, &mut gradient[self.trunk.range.clone()]);
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

    /// Velocities of points. Tiles of them run in parallel; the result does not depend on the number of threads.
    ///
    /// # Panics
    /// Where a slice's length does not fit the others or the network.
    pub fn velocity(&self, parameters: Parameters, cloud: Cloud, velocities: &mut [f32]) {
        let Cloud {
            time,
            condition,
            points,
        } = cloud;
        let expected = self.shape.condition_dim;
        assert_eq!(condition.len(), expected, "condition dimension");
        assert_eq!(points.len(), velocities.len(), "one velocity per point");
        self.scratch.with(Default::default, |scratch| {
            let tape = &mut scratch.conditioner;
            self.conditioner
                .forward(parameters.values, &[time], condition, tape);
            let packed = &mut scratch.packed;
            let weights = self.trunk_weights(parameters, packed, Passes::Forward);
            let inputs = point_inputs(&self.shape, points, &mut scratch.inputs);
            self.trunk
                .velocities(weights, &tape.modulation, inputs, &self.tapes, velocities);
        });
    }
}
