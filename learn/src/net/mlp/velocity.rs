//! The MLP: its parameters, velocities, loss and gradient.

use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::batch::Batch;
use super::conditioner::{Conditioner, ConditionerTape};
use super::point_features::point_inputs;
use super::shape::MlpShape;
use super::shares::{PointPass, Share, add_gradients, divide};
use super::trunk::Trunk;
use super::trunk_bf16::PackedTrunk;
use super::trunk_tiles::TrunkTapes;
use crate::channels::Channels;
use crate::flow::VelocityField;
use crate::net::kernels::Precision;
use crate::net::kernels::float32::{add, reset};
use crate::net::layers::{Passes, Weights};
use crate::net::parameters::{InitialWeights, NetworkShapeError, Table, require_precision};
use crate::pool::Pool;

/// Tiles per share, the unit of parallel work. Fixed, so that sums are grouped alike for any number of threads.
const SHARE: usize = 8;

/// The paper's MLP velocity network (Sec. Method, Eq. mlp_velocity): every point alone, weights shared.
#[derive(Clone, Debug)]
pub struct Mlp {
    shape: MlpShape,
    precision: Precision,
    params: Vec<f32>,
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
    /// A network with fresh parameters drawn from `rng`.
    ///
    /// # Errors
    /// [`NetworkShapeError::Size`] where `shape` is out of bounds.
    pub fn new(
        shape: MlpShape,
        initial: InitialWeights,
        rng: &mut ChaCha8Rng,
    ) -> Result<Self, NetworkShapeError> {
        shape.check()?;
        let mut table = Table::starting(initial);
        shape.declare(&mut table);
        let params = table.initial_params(rng);
        Self::from_params(shape, params)
    }

    /// A network with given parameters, in the order of [`MlpShape::tensors`].
    ///
    /// # Errors
    /// [`NetworkShapeError`] where `shape` is out of bounds or `params` has another length than it needs.
    pub fn from_params(shape: MlpShape, params: Vec<f32>) -> Result<Self, NetworkShapeError> {
        shape.check()?;
        let mut table = Table::default();
        let (conditioner, trunk) = shape.declare(&mut table);
        let expected = table.len();
        if params.len() != expected {
            return Err(NetworkShapeError::ParameterCount {
                found: params.len(),
                expected,
            });
        }
        Ok(Self {
            conditioner,
            trunk,
            shape,
            precision: Precision::default(),
            params,
            tapes: TrunkTapes::default(),
            scratch: Pool::default(),
        })
    }

    /// The network's shape.
    pub fn shape(&self) -> MlpShape {
        self.shape
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
        require_precision(precision, self.shape.width)?;
        Ok(Self { precision, ..self })
    }

    /// The trunk's weights, packed for `passes` where the operand type is bfloat16.
    fn trunk_weights<'a>(
        &'a self,
        packed: &'a mut PackedTrunk,
        passes: Passes,
    ) -> Weights<'a, PackedTrunk> {
        let params = &self.params[self.trunk.range.clone()];
        let packed = match self.precision {
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

    /// The flat parameter vector, in the order of [`MlpShape::tensors`].
    pub fn params(&self) -> &[f32] {
        &self.params
    }

    /// The flat parameter vector, to be changed in place.
    pub fn params_mut(&mut self) -> &mut [f32] {
        &mut self.params
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
        batch: &Batch,
        workspace: &mut MlpWorkspace,
        gradient: &mut [f32],
    ) -> f64 {
        let (shape, params) = (self.shape(), self.params());
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
            weights: self.trunk_weights(packed, Passes::Training),
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
}

impl VelocityField for Mlp {
    fn channels(&self) -> Channels {
        self.shape.channels
    }

    /// Tiles of points run in parallel; the result does not depend on the number of threads.
    ///
    /// # Panics
    /// Where a slice's length does not fit the others or the network.
    fn velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]) {
        assert_eq!(
            condition.len(),
            self.shape.condition_dim,
            "condition dimension"
        );
        assert_eq!(points.len(), velocities.len(), "one velocity per point");
        self.scratch.with(Default::default, |scratch| {
            let tape = &mut scratch.conditioner;
            self.conditioner
                .forward(&self.params, &[t], condition, tape);
            let weights = self.trunk_weights(&mut scratch.packed, Passes::Forward);
            let inputs = point_inputs(&self.shape, points, &mut scratch.inputs);
            self.trunk
                .velocities(weights, &tape.modulation, inputs, &self.tapes, velocities);
        });
    }
}
