//! The Hybrid with the authors' context network: its parameters and velocities.

use rand_chacha::ChaCha8Rng;

use super::pvcnn_context::{Cloud, PvcnnContext, PvcnnTape};
use super::shape::HybridShape;
use super::velocity::blend;
use crate::channels::Channels;
use crate::flow::VelocityField;
use crate::net::kernels::Precision;
use crate::net::layers::{Passes, VARIANCE, Weights};
use crate::net::mlp::{Conditioner, ConditionerTape, PackedTrunk, Trunk, TrunkTapes, point_inputs};
use crate::net::parameters::{InitialWeights, NetworkShapeError, Table, require_precision};
use crate::pool::Pool;

/// The paper's Hybrid as its authors published it. It gives velocities; it is trained in PyTorch, as BatchNorm's moments are over
/// all clouds of a batch, and here clouds run one after another.
#[derive(Clone, Debug)]
pub struct PvcnnHybrid {
    shape: HybridShape,
    precision: Precision,
    params: Vec<f32>,
    layers: PvcnnLayers,
    tapes: TrunkTapes,
    clouds: Pool<Tape>,
}

/// The network's layers, which know where their parameters lie.
#[derive(Clone, Debug)]
pub struct PvcnnLayers {
    pub conditioner: Conditioner,
    pub trunk: Trunk,
    pub context: PvcnnContext,
}

/// Buffers of one cloud's pass.
#[derive(Debug)]
struct Tape {
    conditioner: ConditionerTape,
    packed: PackedTrunk,
    context: PvcnnTape,
    /// What the head takes of the points themselves, where that is more than their numbers.
    point_inputs: Vec<f32>,
    /// `[x | Fourier features | context]`, `(N, C + 6 K + F)`.
    inputs: Vec<f32>,
}

impl PvcnnHybrid {
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
        shape.declare_pvcnn(&mut table);
        let params = table.initial_params(rng);
        Self::from_params(shape, params)
    }

    /// A network with given parameters, in the order of [`HybridShape::tensors`].
    ///
    /// # Errors
    /// [`NetworkShapeError`] where `shape` is out of bounds, `params` has another length than it needs, or a running variance
    /// is negative.
    pub fn from_params(shape: HybridShape, params: Vec<f32>) -> Result<Self, NetworkShapeError> {
        shape.check()?;
        let mut table = Table::default();
        let layers = shape.declare_pvcnn(&mut table);
        let (found, expected) = (params.len(), table.len());
        if found != expected {
            return Err(NetworkShapeError::ParameterCount { found, expected });
        }
        for tensor in table.tensors {
            let variances = &params[tensor.range.clone()];
            let negative = variances.iter().find(|variance| **variance < 0.0);
            if let (true, Some(&found)) = (tensor.name.ends_with(VARIANCE), negative) {
                let tensor = tensor.name;
                return Err(NetworkShapeError::Variance { tensor, found });
            }
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

    /// Operand type of the head's products; the context's are of floats, as the authors have it.
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
        let PvcnnLayers {
            conditioner,
            trunk,
            context,
        } = &self.layers;
        conditioner.flops() + trunk.flops(points) + context.flops(points)
    }
}

impl VelocityField for PvcnnHybrid {
    fn channels(&self) -> Channels {
        self.shape.head.channels
    }

    /// Points and voxels run in parallel; the result does not depend on the number of threads.
    ///
    /// # Panics
    /// Where a slice's length does not fit the others or the network.
    fn velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]) {
        let PvcnnLayers {
            conditioner,
            trunk,
            context,
        } = &self.layers;
        let head = self.shape.head;
        assert_eq!(condition.len(), head.condition_dim, "condition dimension");
        assert_eq!(points.len(), velocities.len(), "one velocity per point");
        if points.is_empty() {
            return;
        }
        let create = || Tape {
            conditioner: ConditionerTape::default(),
            packed: PackedTrunk::default(),
            context: context.tape(),
            point_inputs: Vec::new(),
            inputs: Vec::new(),
        };
        self.clouds.with(create, |tape| {
            let cloud = Cloud {
                time: t,
                condition,
                points,
            };
            let contexts = context.forward(&self.params, cloud, &mut tape.context);
            let weight = self.shape.context.gate.weight(t);
            let own = point_inputs(&head, points, &mut tape.point_inputs);
            blend(weight, own, contexts, &mut tape.inputs);

            conditioner.forward(&self.params, &[t], condition, &mut tape.conditioner);
            let params = &self.params[trunk.range.clone()];
            let packed = match self.precision {
                Precision::Float32 => None,
                Precision::Bfloat16 => {
                    tape.packed.set(trunk, params, Passes::Forward);
                    Some(&tape.packed)
                }
            };
            trunk.velocities(
                Weights { params, packed },
                &tape.conditioner.modulation,
                &tape.inputs,
                &self.tapes,
                velocities,
            );
        });
    }
}
