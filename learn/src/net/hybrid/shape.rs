//! Shape of the hybrid network.

use serde::{Deserialize, Serialize};

use super::context::ContextNet;
use super::context_kind::Context;
use super::context_shape::{ContextLayers, ContextShape};
use super::pvcnn_context::PvcnnContext;
use crate::net::mlp::{Conditioner, MlpShape, Part, Trunk};
use crate::net::parameters::{
    NetworkShapeError, Table, TensorSpec, require_parameters, require_size,
};

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
        let blocks = self.head.condition_blocks;
        let accepted = blocks == 0 || self.context.layers == ContextLayers::Residual;
        require_size("condition_blocks", blocks, accepted, "0 with pvcnn layers")?;
        require_parameters(self.parameter_count())
    }

    /// Length of the flat parameter vector, in which running statistics count too.
    pub fn parameter_count(&self) -> usize {
        self.table().len()
    }

    /// The tensors in the order in which the flat parameter vector holds them.
    ///
    /// Layers of concatenated features are stored as their shares, as [`MlpShape::tensors`] has it: of `[x | e]` the first
    /// stage's projection and `context.shift`, of `[x | context | e]` the head's input and `head.shift`. A convolution's
    /// weight is `(3, 3, 3, outputs, inputs)`. A BatchNorm's running mean and variance follow its weight and bias.
    pub fn tensors(&self) -> Vec<TensorSpec> {
        self.table().tensors
    }

    /// The network's tensors.
    pub(in crate::net) fn table(&self) -> Table {
        let mut table = Table::default();
        match self.context.layers {
            ContextLayers::Residual => drop(self.declare::<ContextNet>(&mut table)),
            ContextLayers::Pvcnn => drop(self.declare::<PvcnnContext>(&mut table)),
        }
        table
    }

    /// Adds the tensors of a network with this kind of context to `table`; returns its layers.
    pub(in crate::net) fn declare<C: Context>(&self, table: &mut Table) -> Layers<C> {
        let Self { head, context } = self;
        let (embedding, channels) = (head.embedding, head.channels.count());
        let inputs = head.point_inputs() + context.features;
        let initial = table.initial;
        let (mut parts, context_films) = C::modulation(context, embedding, channels);
        let shift = initial.hidden(inputs + embedding);
        parts.push(Part::new("head.shift", head.width, shift));
        let mut films = head.films("head.", initial);
        films.extend(context_films);
        let sizes = head.embedding_shape();
        Layers {
            conditioner: Conditioner::declare(table, "", sizes, &parts, &films),
            trunk: head.declare_trunk(table, "head.", inputs),
            context: C::declare(table, context, sizes, channels),
        }
    }
}

/// The network's layers, which know where their parameters lie.
#[derive(Clone, Debug)]
pub struct Layers<C> {
    pub conditioner: Conditioner,
    pub trunk: Trunk,
    pub context: C,
}
