//! Shape of the hybrid network.

use serde::{Deserialize, Serialize};

use super::context::ContextNet;
use super::context_shape::ContextShape;
use crate::net::mlp::{Conditioner, MlpShape, Part, Trunk};
use crate::net::parameters::{NetworkShapeError, Table, TensorSpec, fan_in, require_parameters};

/// Shape of a hybrid velocity network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HybridShape {
    /// The head, an MLP that acts on every point and its context; embedding, condition and channels are the whole
    /// network's.
    pub head: MlpShape,
    /// The network that gives a point its context.
    pub context: ContextShape,
}

impl HybridShape {
    /// Returns an error if the sizes do not describe a network.
    pub fn check(&self) -> Result<(), NetworkShapeError> {
        self.head.check()?;
        self.context.check()?;
        require_parameters(self.parameter_count())
    }

    /// Length of the flat parameter vector.
    pub fn parameter_count(&self) -> usize {
        self.tensors().last().map_or(0, |tensor| tensor.range.end)
    }

    /// The tensors in the order in which the flat parameter vector holds them.
    ///
    /// Layers of concatenated features are stored as their shares, as [`MlpShape::tensors`] has it: of `[x | e]` the first
    /// stage's projection and `context.shift`, of `[x | context | e]` the head's input and `head.shift`. A convolution's
    /// weight is `(3, 3, 3, outputs, inputs)`.
    pub fn tensors(&self) -> Vec<TensorSpec> {
        let mut table = Table::default();
        self.declare(&mut table);
        table.tensors
    }

    /// Adds the network's tensors to `table`; returns its layers.
    pub(in crate::net) fn declare(&self, table: &mut Table) -> Layers {
        let Self { head, context } = self;
        let (embedding, channels) = (head.embedding, head.channels.count());
        let inputs = head.point_inputs() + context.features;
        let [global, shift] = context.parts(embedding, channels);
        let head_shift = Part::new("head.shift", head.width, fan_in(inputs + embedding));
        let films: Vec<_> = head
            .films("head.")
            .into_iter()
            .chain(context.films())
            .collect();
        Layers {
            conditioner: Conditioner::declare(
                table,
                [embedding, head.condition_dim],
                &[global, shift, head_shift],
                &films,
            ),
            trunk: head.declare_trunk(table, "head.", inputs),
            context: ContextNet::declare(table, context, embedding, channels),
        }
    }
}

/// The network's layers, which know where their parameters lie.
#[derive(Clone, Debug)]
pub struct Layers {
    pub conditioner: Conditioner,
    pub trunk: Trunk,
    pub context: ContextNet,
}
