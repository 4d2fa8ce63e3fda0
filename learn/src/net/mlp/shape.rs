//! Shape of the MLP: its sizes, its bounds, its tensors.

use serde::{Deserialize, Serialize};

use super::conditioner::{Conditioner, EmbeddingShape, Film, Part};
use super::time_features::TimeFeatures;
use super::trunk::{Trunk, TrunkSizes};
use crate::channels::{Channels, DIM};
use crate::net::parameters::{
    InitialWeights, NetworkShapeError, Table, TensorSpec, require_parameters, require_size,
};

/// Shape of an MLP velocity network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MlpShape {
    /// Hidden features per point `H`.
    pub width: usize,
    /// Layers as the paper counts them: the input layer and `depth - 1` residual blocks.
    pub depth: usize,
    /// Features of the time and condition embedding `E`; even, half cosines and half sines.
    pub embedding: usize,
    /// Condition dimension `D`.
    pub condition_dim: usize,
    /// Residual blocks that the condition passes through on its way to the embedding, once per cloud. 0 in the paper's network
    /// and in files that do not say.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub condition_blocks: usize,
    /// Octaves `K` of the positions' Fourier features, which the input layer takes beside the point:
    /// `sin(2^k pi x)` and `cos(2^k pi x)`, `k = 0, ..., K - 1`, for each coordinate `x` in normalised units (Tancik et al., NeurIPS
    /// 2020). They tell places a few millimetres apart, which a layer of the coordinates alone hardly does. 0 in the paper's
    /// network and in files that do not say.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub octaves: usize,
    /// What it sees of the flow time; [`TimeFeatures::Plain`] in the paper's network and in files that do not say.
    #[serde(default, skip_serializing_if = "TimeFeatures::is_plain")]
    pub time_features: TimeFeatures,
    /// What points consist of; positions alone in files that do not say.
    #[serde(default)]
    pub channels: Channels,
}

/// A network of positions that a CPU trains in minutes, of no conditions: their dimension is the data's.
impl Default for MlpShape {
    fn default() -> Self {
        Self {
            width: 96,
            depth: 6,
            embedding: 128,
            condition_dim: 0,
            condition_blocks: 0,
            octaves: 6,
            time_features: TimeFeatures::Late,
            channels: Channels::Xyz,
        }
    }
}

/// Whether a number is left out of files.
fn is_zero(number: &usize) -> bool {
    *number == 0
}

impl MlpShape {
    /// Number of residual blocks `L`.
    pub fn blocks(&self) -> usize {
        self.depth - 1
    }

    /// Returns an error if the sizes do not describe a network.
    ///
    /// The upper bounds are far above any useful network; they keep a damaged file from asking for the machine's memory.
    pub fn check(&self) -> Result<(), NetworkShapeError> {
        let Self {
            width,
            depth,
            embedding,
            condition_dim,
            condition_blocks,
            octaves,
            time_features: _,
            channels: _,
        } = *self;
        require_size("width", width, (1..=8192).contains(&width), "1 to 8192")?;
        require_size("depth", depth, (1..=64).contains(&depth), "1 to 64")?;
        let even = embedding.is_multiple_of(2) && (2..=8192).contains(&embedding);
        require_size("embedding", embedding, even, "an even number, 2 to 8192")?;
        require_size(
            "condition_dim",
            condition_dim,
            (1..=4096).contains(&condition_dim),
            "1 to 4096",
        )?;
        let blocks = (0..=64).contains(&condition_blocks);
        require_size("condition_blocks", condition_blocks, blocks, "0 to 64")?;
        // Above, the highest frequency is beyond what a float resolves.
        require_size("octaves", octaves, octaves <= 12, "0 to 12")?;
        require_parameters(self.parameter_count())
    }

    /// Numbers of a point that the input layer takes: its channels, and its Fourier features.
    pub(in crate::net) fn point_inputs(&self) -> usize {
        self.channels.count() + 2 * DIM * self.octaves
    }

    /// Length of the flat parameter vector.
    pub fn parameter_count(&self) -> usize {
        self.tensors().last().map_or(0, |tensor| tensor.range.end)
    }

    /// The tensors in the order in which the flat parameter vector holds them.
    ///
    /// The input layer of `[x | e]` is stored as its two shares, `input.weight` `(H, C + 6 K)` of the point and `shift.weight`
    /// `(H, E)` of the embedding, which also has the bias; `film` yields gamma (rows `0..H`) and beta (rows `H..2H`).
    /// What is evaluated once per cloud comes first, what is evaluated at every point last.
    pub fn tensors(&self) -> Vec<TensorSpec> {
        let mut table = Table::default();
        self.declare(&mut table);
        table.tensors
    }

    /// Adds the network's tensors to `table`; returns its layers.
    pub(in crate::net) fn declare(&self, table: &mut Table) -> (Conditioner, Trunk) {
        let (embedding, inputs) = (self.embedding, self.point_inputs());
        let initial = table.initial;
        let shift = Part::new("shift", self.width, initial.hidden(inputs + embedding));
        let conditioner = Conditioner::declare(
            table,
            "",
            self.embedding_shape(),
            &[shift],
            &self.films("", initial),
        );
        (conditioner, self.declare_trunk(table, "", inputs))
    }

    /// The network's part that makes the embedding.
    pub(in crate::net) fn embedding_shape(&self) -> EmbeddingShape {
        EmbeddingShape {
            embedding: self.embedding,
            condition_dim: self.condition_dim,
            condition_blocks: self.condition_blocks,
            time_features: self.time_features,
        }
    }

    /// The blocks that FiLM modulates, their names after `prefix`.
    pub(in crate::net) fn films(&self, prefix: &str, initial: InitialWeights) -> Vec<Film> {
        let film = |l: usize| Film {
            name: format!("{prefix}blocks.{l}"),
            width: self.width,
            initial: initial.film(self.embedding),
        };
        (0..self.blocks()).map(film).collect()
    }

    /// Adds what acts on points of `inputs` numbers, the tensors' names after `prefix`.
    pub(in crate::net) fn declare_trunk(
        &self,
        table: &mut Table,
        prefix: &str,
        inputs: usize,
    ) -> Trunk {
        let sizes = TrunkSizes {
            inputs,
            outputs: self.channels.count(),
            width: self.width,
            blocks: self.blocks(),
            embedding: self.embedding,
        };
        Trunk::declare(table, prefix, sizes)
    }
}
