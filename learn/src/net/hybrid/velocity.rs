//! The Hybrid: its parameters, velocities, loss and gradient.

use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::context::{ContextInput, ContextTape, PackedContext};
use super::context_shape::ContextShape;
use super::shape::{HybridShape, Layers};
use crate::channels::Channels;
use crate::flow::VelocityField;
use crate::net::kernels::Precision;
use crate::net::kernels::float32::{add, reset};
use crate::net::layers::{Passes, Weights};
use crate::net::mlp::{
    Batch, ConditionerTape, Loss, PackedTrunk, PointPass, STRIPE, Share, TrunkTapes,
    add_trunk_gradients, divide, point_inputs,
};
use crate::net::parameters::{InitialWeights, NetworkShapeError, Table, require_precision};
use crate::pool::Pool;

/// The paper's Hybrid velocity network (Sec. Method, Eqs. contextnet and time_gate): a cloud's points are seen together.
#[derive(Clone, Debug)]
pub struct Hybrid {
    shape: HybridShape,
    precision: Precision,
    params: Vec<f32>,
    layers: Layers,
    tapes: TrunkTapes,
    clouds: Pool<(ConditionerTape, CloudTape)>,
}

/// The weights in tiles.
#[derive(Debug, Default)]
struct Packed {
    trunk: PackedTrunk,
    context: PackedContext,
}

/// Points per share of a cloud: fewer than of the MLP's batches of many clouds.
const SHARE: usize = 1024;

/// Buffers of [`Hybrid::loss_and_gradient`], kept from step to step.
#[derive(Debug, Default)]
pub struct HybridWorkspace {
    conditioner: ConditionerTape,
    shares: Vec<Share>,
    d_modulation: Vec<f32>,
    cloud: Option<CloudTape>,
}

/// Buffers of one cloud's passes.
#[derive(Debug)]
struct CloudTape {
    packed: Packed,
    context: ContextTape,
    /// What the head takes of the points themselves, where that is more than their numbers.
    point_inputs: Vec<f32>,
    /// `[x | Fourier features | context]`, `(N, C + 6 K + F)`.
    inputs: Vec<f32>,
    /// Gradient by the points' context, `(N, F)`.
    d_context: Vec<f32>,
}

/// A cloud's modulation vector, or the gradient by it, in parts.
struct Split<T> {
    global: T,
    shift: T,
    head: T,
    films: T,
}

impl Hybrid {
    /// A network with fresh parameters drawn from `rng`.
    ///
    /// # Errors
    /// [`NetworkShapeError`] where `shape` is out of bounds.
    pub fn new(
        shape: HybridShape,
        initial: InitialWeights,
        rng: &mut ChaCha8Rng,
    ) -> Result<Self, NetworkShapeError> {
        shape.check()?;
        let mut table = Table::starting(initial);
        shape.declare(&mut table);
        let params = table.initial_params(rng);
        Self::from_params(shape, params)
    }

    /// A network with given parameters, in the order of [`HybridShape::tensors`].
    ///
    /// # Errors
    /// [`NetworkShapeError`] where `shape` is out of bounds or `params` has another length than it needs.
    pub fn from_params(shape: HybridShape, params: Vec<f32>) -> Result<Self, NetworkShapeError> {
        shape.check()?;
        let mut table = Table::default();
        let layers = shape.declare(&mut table);
        let (found, expected) = (params.len(), table.len());
        if found != expected {
            return Err(NetworkShapeError::ParameterCount { found, expected });
        }
        Ok(Self {
            shape,
            precision: Precision::default(),
            params,
            layers,
            tapes: TrunkTapes::default(),
            clouds: Pool::default(),
        })
    }

    /// The network's shape.
    pub fn shape(&self) -> HybridShape {
        self.shape
    }

    /// The flat parameter vector, in the order of [`HybridShape::tensors`].
    pub fn params(&self) -> &[f32] {
        &self.params
    }

    /// The flat parameter vector, to be changed in place.
    pub fn params_mut(&mut self) -> &mut [f32] {
        &mut self.params
    }

    /// Operand type of its products.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// The same network with another operand type.
    ///
    /// # Errors
    /// [`NetworkShapeError::Precision`] where its width does not suit it.
    pub fn with_precision(self, precision: Precision) -> Result<Self, NetworkShapeError> {
        require_precision(precision, self.shape.head.width)?;
        Ok(Self { precision, ..self })
    }

    /// Floating-point operations of the velocities of a cloud of `points` points, products alone.
    pub fn flops(&self, points: usize) -> u64 {
        let Layers {
            conditioner,
            trunk,
            context,
        } = &self.layers;
        conditioner.flops() + trunk.flops(points) + context.flops(points)
    }

    /// Loss and gradient as [`Mlp::loss_and_gradient`](crate::net::mlp::Mlp::loss_and_gradient) has them.
    ///
    /// Clouds run one after the other, the points and voxels of each in parallel; the result does not depend on the
    /// number of threads.
    ///
    /// # Panics
    /// Where the batch holds no point or a slice's length does not fit the others or the network.
    pub fn loss_and_gradient(
        &self,
        batch: &Batch,
        workspace: &mut HybridWorkspace,
        gradient: &mut [f32],
    ) -> f64 {
        let (head, params) = (self.shape.head, &self.params[..]);
        batch.check(
            head.condition_dim,
            head.channels,
            [params.len(), gradient.len()],
        );
        let HybridWorkspace {
            conditioner: tape,
            shares,
            d_modulation,
            cloud,
        } = workspace;
        let cloud = cloud.get_or_insert_with(|| self.cloud_tape());
        let conditioner = &self.layers.conditioner;
        conditioner.forward(params, batch.times, batch.conditions, tape);
        reset(d_modulation, tape.modulation.len());
        gradient
            .par_chunks_mut(STRIPE)
            .for_each(|stripe| stripe.fill(0.0));

        let stride = batch.points.len() / batch.clouds();
        let loss = batch.loss(head.channels);
        let mut squared_error = 0.0;
        self.pack(Passes::Training, &mut cloud.packed);
        divide(1, stride / head.channels.count(), SHARE, shares);
        for (k, &time) in batch.times.iter().enumerate() {
            let modulations = k * conditioner.outputs()..(k + 1) * conditioner.outputs();
            let sample = CloudBatch {
                time,
                modulation: self.split(&tape.modulation[modulations.clone()]),
                points: &batch.points[k * stride..(k + 1) * stride],
                targets: &batch.targets[k * stride..(k + 1) * stride],
                loss,
            };
            let d_modulation = self.split_mut(&mut d_modulation[modulations]);
            squared_error += self.evaluate(&sample, shares, cloud, gradient, d_modulation);
        }
        conditioner.backward(params, batch.conditions, tape, d_modulation, gradient);
        squared_error / loss.components as f64
    }

    /// Forward and backward pass of one cloud; returns its squared error.
    fn evaluate(
        &self,
        sample: &CloudBatch,
        shares: &mut [Share],
        tape: &mut CloudTape,
        gradient: &mut [f32],
        d_modulation: Split<&mut [f32]>,
    ) -> f64 {
        let Layers { trunk, context, .. } = &self.layers;
        self.fill_inputs(sample.time, &sample.modulation, sample.points, tape);
        let pass = PointPass {
            trunk,
            weights: self.trunk_weights(&tape.packed),
            tapes: &self.tapes,
            loss: sample.loss,
        };
        shares.par_iter_mut().for_each(|share| {
            share.gradient.points.get_or_insert_default();
            pass.run(sample.modulation.head, &tape.inputs, sample.targets, share);
        });
        add_trunk_gradients(shares, &mut gradient[trunk.range.clone()]);
        for share in &*shares {
            add(&share.gradient.modulation, d_modulation.head);
        }
        self.blend_backward(sample.time, shares, tape, d_modulation.global);
        context.backward(
            self.context_input(&sample.modulation, sample.points, &tape.packed),
            &tape.d_context,
            &mut tape.context,
            gradient,
            [d_modulation.shift, d_modulation.films],
        );
        shares.iter().map(|share| share.squared_error).sum()
    }

    fn cloud_tape(&self) -> CloudTape {
        CloudTape {
            packed: Packed::default(),
            context: self.layers.context.tape(),
            point_inputs: Vec::new(),
            inputs: Vec::new(),
            d_context: Vec::new(),
        }
    }

    /// Packs the weights, where the operand type is bfloat16.
    fn pack(&self, passes: Passes, packed: &mut Packed) {
        if self.precision == Precision::Bfloat16 {
            let Layers { trunk, context, .. } = &self.layers;
            packed
                .trunk
                .set(trunk, &self.params[trunk.range.clone()], passes);
            context.pack(&self.params, passes, &mut packed.context);
        }
    }

    fn if_packed<'a, P>(&self, packed: &'a P) -> Option<&'a P> {
        (self.precision == Precision::Bfloat16).then_some(packed)
    }

    fn trunk_weights<'a>(&'a self, packed: &'a Packed) -> Weights<'a, PackedTrunk> {
        Weights {
            params: &self.params[self.layers.trunk.range.clone()],
            packed: self.if_packed(&packed.trunk),
        }
    }

    fn context_input<'a>(
        &'a self,
        modulation: &Split<&'a [f32]>,
        points: &'a [f32],
        packed: &'a Packed,
    ) -> ContextInput<'a> {
        ContextInput {
            weights: Weights {
                params: &self.params,
                packed: self.if_packed(&packed.context),
            },
            points,
            shift: modulation.shift,
            films: modulation.films,
        }
    }

    /// Fills `tape.inputs` with `[x | Fourier features | C]`, `C = a(t) C_pv + (1 - a(t)) (W_g e + b_g)`: the cloud's context, blended with the
    /// embedding's by the time gate.
    fn fill_inputs(
        &self,
        time: f32,
        modulation: &Split<&[f32]>,
        points: &[f32],
        tape: &mut CloudTape,
    ) {
        let input = self.context_input(modulation, points, &tape.packed);
        self.layers.context.forward(input, &mut tape.context);
        let weight = self.shape.context.gate.weight(time);
        let contexts = (&tape.context.context[..], modulation.global);
        let points = point_inputs(&self.shape.head, points, &mut tape.point_inputs);
        blend(weight, points, contexts, &mut tape.inputs);
    }

    /// Splits the gradient by `C`, which the shares have, into those by the cloud's context and by the embedding's.
    fn blend_backward(
        &self,
        time: f32,
        shares: &[Share],
        tape: &mut CloudTape,
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

    /// Ends of the modulation vector's parts: global context, context's shift, head.
    fn ends(&self) -> [usize; 3] {
        let ContextShape {
            features, stages, ..
        } = self.shape.context;
        let shift = features + stages[0].channels;
        [features, shift, shift + self.layers.trunk.modulation_len()]
    }

    fn split<'a>(&self, modulation: &'a [f32]) -> Split<&'a [f32]> {
        let [global, shift, head] = self.ends();
        Split {
            global: &modulation[..global],
            shift: &modulation[global..shift],
            head: &modulation[shift..head],
            films: &modulation[head..],
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

/// Fills `inputs` with `[x | C]`, `x` what the head takes of a point itself, `C = weight C_pv + (1 - weight) C_e`, from the points' contexts `(N, F)` and the embedding's
/// `(F)`.
pub fn blend(
    weight: f32,
    points: &[f32],
    (contexts, global): (&[f32], &[f32]),
    inputs: &mut Vec<f32>,
) {
    let count = contexts.len() / global.len();
    let points = points.chunks_exact(points.len() / count);
    inputs.clear();
    for (point, context) in points.zip(contexts.chunks_exact(global.len())) {
        inputs.extend_from_slice(point);
        let blended = context.iter().zip(global);
        inputs.extend(blended.map(|(c, g)| weight * c + (1.0 - weight) * g));
    }
}

/// One cloud of a batch.
struct CloudBatch<'a> {
    time: f32,
    modulation: Split<&'a [f32]>,
    points: &'a [f32],
    targets: &'a [f32],
    loss: Loss,
}

impl VelocityField for Hybrid {
    fn channels(&self) -> Channels {
        self.shape.head.channels
    }

    /// Points and voxels run in parallel; the result does not depend on the number of threads.
    ///
    /// # Panics
    /// Where a slice's length does not fit the others or the network.
    fn velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]) {
        let Layers {
            conditioner, trunk, ..
        } = &self.layers;
        let expected = self.shape.head.condition_dim;
        assert_eq!(condition.len(), expected, "condition dimension");
        assert_eq!(points.len(), velocities.len(), "one velocity per point");
        if points.is_empty() {
            return;
        }
        let create = || (ConditionerTape::default(), self.cloud_tape());
        self.clouds.with(create, |(tape, cloud)| {
            conditioner.forward(&self.params, &[t], condition, tape);
            let modulation = self.split(&tape.modulation);
            self.pack(Passes::Forward, &mut cloud.packed);
            self.fill_inputs(t, &modulation, points, cloud);
            trunk.velocities(
                self.trunk_weights(&cloud.packed),
                modulation.head,
                &cloud.inputs,
                &self.tapes,
                velocities,
            );
        });
    }
}
