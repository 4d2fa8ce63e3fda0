//! The Hybrid: its layers and velocities.

use super::context_kind::{Context, Split};
use super::shape::{HybridShape, Layers};
use crate::net::kernels::Precision;
use crate::net::layers::{Passes, Weights};
use crate::net::mlp::{Cloud, ConditionerTape, PackedTrunk, TrunkTapes, point_inputs};
use crate::net::parameters::{Parameters, Table};
use crate::pool::Pool;

/// The paper's Hybrid velocity network (Sec. Method, Eqs. contextnet and time_gate): a cloud's points are seen together, by a context
/// network of the kind `C`.
#[derive(Clone, Debug)]
pub struct Hybrid<C: Context> {
    pub(super) shape: HybridShape,
    pub(super) layers: Layers<C>,
    pub(super) tapes: TrunkTapes,
    clouds: Pool<(ConditionerTape, Packed<C>, CloudTape<C>)>,
}

/// The weights in tiles.
#[derive(Debug)]
pub(super) struct Packed<C: Context> {
    trunk: PackedTrunk,
    context: C::Packed,
}

/// Buffers of one cloud's passes.
#[derive(Debug)]
pub(super) struct CloudTape<C: Context> {
    pub context: C::Tape,
    /// What the head takes of the points themselves, where that is more than their numbers.
    point_inputs: Vec<f32>,
    /// `[x | Fourier features | context]`, `(N, C + 6 K + F)`.
    pub inputs: Vec<f32>,
    /// Gradient by the points' context, `(N, F)`.
    pub d_context: Vec<f32>,
}

impl<C: Context> Default for Packed<C> {
    fn default() -> Self {
        Self {
            trunk: PackedTrunk::default(),
            context: C::Packed::default(),
        }
    }
}

impl<C: Context> Hybrid<C> {
    /// Adds the tensors of a network of `shape` to `table`; returns its layers.
    pub fn declare(shape: HybridShape, table: &mut Table) -> Self {
        Self {
            shape,
            layers: shape.declare(table),
            tapes: TrunkTapes::default(),
            clouds: Pool::default(),
        }
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

    /// Velocities of a cloud's points. Points and voxels run in parallel; the result does not depend on the number of threads.
    ///
    /// # Panics
    /// Where a slice's length does not fit the others or the network.
    pub fn velocity(&self, parameters: Parameters, cloud: Cloud, velocities: &mut [f32]) {
        let Layers {
            conditioner, trunk, ..
        } = &self.layers;
        let Cloud {
            time,
            condition,
            points,
        } = cloud;
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
        self.clouds.with(create, |(tape, packed, buffers)| {
            conditioner.forward(parameters.values, &[time], condition, tape);
            let modulation = self.split(&tape.modulation);
            self.pack(parameters, Passes::Forward, packed);
            self.fill_inputs(parameters, cloud, modulation, packed, buffers);
            trunk.velocities(
                self.trunk_weights(parameters, packed),
                modulation.head,
                &buffers.inputs,
                &self.tapes,
                velocities,
            );
        });
    }

    pub(super) fn cloud_tape(&self) -> CloudTape<C> {
        CloudTape {
            context: self.layers.context.tape(),
            point_inputs: Vec::new(),
            inputs: Vec::new(),
            d_context: Vec::new(),
        }
    }

    /// Packs the weights, where the operand type is bfloat16.
    pub(super) fn pack(&self, parameters: Parameters, passes: Passes, packed: &mut Packed<C>) {
        if parameters.precision == Precision::Bfloat16 {
            let Layers { trunk, context, .. } = &self.layers;
            let values = parameters.values;
            packed
                .trunk
                .set(trunk, &values[trunk.range.clone()], passes);
            context.pack(values, passes, &mut packed.context);
        }
    }

    pub(super) fn trunk_weights<'a>(
        &self,
        parameters: Parameters<'a>,
        packed: &'a Packed<C>,
    ) -> Weights<'a, PackedTrunk> {
        let range = self.layers.trunk.range.clone();
        Weights {
            params: &parameters.values[range],
            packed: if_packed(parameters.precision, &packed.trunk),
        }
    }

    pub(super) fn context_weights<'a>(
        &self,
        parameters: Parameters<'a>,
        packed: &'a Packed<C>,
    ) -> Weights<'a, C::Packed> {
        Weights {
            params: parameters.values,
            packed: if_packed(parameters.precision, &packed.context),
        }
    }

    /// Fills `tape.inputs` with `[x | Fourier features | C]`, `C = a(t) C_pv + (1 - a(t)) C_e`: the cloud's context, blended with
    /// the embedding's by the time gate.
    pub(super) fn fill_inputs(
        &self,
        parameters: Parameters,
        cloud: Cloud,
        modulation: Split<&[f32]>,
        packed: &Packed<C>,
        tape: &mut CloudTape<C>,
    ) {
        let weights = self.context_weights(parameters, packed);
        let context = &self.layers.context;
        let contexts = context.contexts(weights, cloud, modulation, &mut tape.context);
        let weight = self.shape.context.gate.weight(cloud.time);
        let points = point_inputs(&self.shape.head, cloud.points, &mut tape.point_inputs);
        blend(weight, points, contexts, &mut tape.inputs);
    }

    /// Ends of the modulation vector's parts: global context, context's shift, head.
    pub(super) fn ends(&self) -> [usize; 3] {
        let [global, shift] = C::modulation_lengths(&self.shape.context);
        let shift = global + shift;
        [global, shift, shift + self.layers.trunk.modulation_len()]
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

fn if_packed<P>(precision: Precision, packed: &P) -> Option<&P> {
    (precision == Precision::Bfloat16).then_some(packed)
}

/// Fills `inputs` with `[x | C]`, `x` what the head takes of a point itself, `C = weight C_pv + (1 - weight) C_e`, from the points' contexts `(N, F)` and the embedding's
/// `(F)`.
fn blend(weight: f32, points: &[f32], (contexts, global): (&[f32], &[f32]), inputs: &mut Vec<f32>) {
    let count = contexts.len() / global.len();
    let points = points.chunks_exact(points.len() / count);
    inputs.clear();
    for (point, context) in points.zip(contexts.chunks_exact(global.len())) {
        inputs.extend_from_slice(point);
        let blended = context.iter().zip(global);
        inputs.extend(blended.map(|(c, g)| weight * c + (1.0 - weight) * g));
    }
}
