//! The Hybrid: its parameters and velocities.

use rand_chacha::ChaCha8Rng;

use super::context::{ContextInput, ContextTape, PackedContext};
use super::context_shape::ContextShape;
use super::shape::{HybridShape, Layers};
use crate::channels::Channels;
use crate::flow::VelocityField;
use crate::net::kernels::Precision;
use crate::net::layers::{Passes, Weights};
use crate::net::mlp::{ConditionerTape, PackedTrunk, TrunkTapes, point_inputs};
use crate::net::parameters::{InitialWeights, NetworkShapeError, Table, require_precision};
use crate::pool::Pool;

/// The paper's Hybrid velocity network (Sec. Method, Eqs. contextnet and time_gate): a cloud's points are seen together.
#[derive(Clone, Debug)]
pub struct Hybrid {
    pub(super) shape: HybridShape,
    precision: Precision,
    pub(super) params: Vec<f32>,
    pub(super) layers: Layers,
    pub(super) tapes: TrunkTapes,
    clouds: Pool<(ConditionerTape, Packed, CloudTape)>,
}

/// The weights in tiles.
#[derive(Debug, Default)]
pub(super) struct Packed {
    trunk: PackedTrunk,
    context: PackedContext,
}

/// Buffers of one cloud's passes.
#[derive(Debug)]
pub(super) struct CloudTape {
    pub context: ContextTape,
    /// What the head takes of the points themselves, where that is more than their numbers.
    point_inputs: Vec<f32>,
    /// `[x | Fourier features | context]`, `(N, C + 6 K + F)`.
    pub inputs: Vec<f32>,
    /// Gradient by the points' context, `(N, F)`.
    pub d_context: Vec<f32>,
}

/// A cloud's modulation vector, or the gradient by it, in parts.
pub(super) struct Split<T> {
    pub global: T,
    pub shift: T,
    pub head: T,
    pub films: T,
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

    pub(super) fn cloud_tape(&self) -> CloudTape {
        CloudTape {
            context: self.layers.context.tape(),
            point_inputs: Vec::new(),
            inputs: Vec::new(),
            d_context: Vec::new(),
        }
    }

    /// Packs the weights, where the operand type is bfloat16.
    pub(super) fn pack(&self, passes: Passes, packed: &mut Packed) {
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

    pub(super) fn trunk_weights<'a>(&'a self, packed: &'a Packed) -> Weights<'a, PackedTrunk> {
        Weights {
            params: &self.params[self.layers.trunk.range.clone()],
            packed: self.if_packed(&packed.trunk),
        }
    }

    pub(super) fn context_input<'a>(
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
    pub(super) fn fill_inputs(
        &self,
        time: f32,
        modulation: &Split<&[f32]>,
        points: &[f32],
        packed: &Packed,
        tape: &mut CloudTape,
    ) {
        let input = self.context_input(modulation, points, packed);
        self.layers.context.forward(input, &mut tape.context);
        let weight = self.shape.context.gate.weight(time);
        let contexts = (&tape.context.context[..], modulation.global);
        let points = point_inputs(&self.shape.head, points, &mut tape.point_inputs);
        blend(weight, points, contexts, &mut tape.inputs);
    }

    /// Ends of the modulation vector's parts: global context, context's shift, head.
    pub(super) fn ends(&self) -> [usize; 3] {
        let ContextShape {
            features, stages, ..
        } = self.shape.context;
        let shift = features + stages[0].channels;
        [features, shift, shift + self.layers.trunk.modulation_len()]
    }

    pub(super) fn split<'a>(&self, modulation: &'a [f32]) -> Split<&'a [f32]> {
        let [global, shift, head] = self.ends();
        Split {
            global: &modulation[..global],
            shift: &modulation[global..shift],
            head: &modulation[shift..head],
            films: &modulation[head..],
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
        let create = || {
            (
                ConditionerTape::default(),
                Packed::default(),
                self.cloud_tape(),
            )
        };
        self.clouds.with(create, |(tape, packed, cloud)| {
            conditioner.forward(&self.params, &[t], condition, tape);
            let modulation = self.split(&tape.modulation);
            self.pack(Passes::Forward, packed);
            self.fill_inputs(t, &modulation, points, packed, cloud);
            trunk.velocities(
                self.trunk_weights(packed),
                modulation.head,
                &cloud.inputs,
                &self.tapes,
                velocities,
            );
        });
    }
}
