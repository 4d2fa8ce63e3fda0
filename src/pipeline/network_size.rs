//! How large a network is.

use tdcr_learn::net::{Channels, ContextShape, HybridShape, MlpShape, NetworkShape, TimeFeatures};

use super::preset::Preset;

/// Size of a network, but for what the data set says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NetworkSize {
    /// Features per layer.
    pub width: usize,
    /// Layers: the input layer and `depth - 1` residual blocks.
    pub depth: usize,
    /// Features of the embedding of time and condition.
    pub embedding: usize,
    /// Residual blocks of the condition.
    pub condition_blocks: usize,
    /// Octaves of the positions' Fourier features.
    pub octaves: usize,
    /// What it sees of the flow time.
    pub time_features: TimeFeatures,
    /// The context network of a hybrid; none makes an MLP.
    pub context: Option<ContextShape>,
    /// What points consist of.
    pub channels: Channels,
}

/// An MLP of positions, of the default preset's size.
impl Default for NetworkSize {
    fn default() -> Self {
        Preset::default().size
    }
}

impl NetworkSize {
    /// The shape for conditions of dimension `condition_dim`.
    pub(super) fn shape(&self, condition_dim: usize) -> NetworkShape {
        let head = MlpShape {
            width: self.width,
            depth: self.depth,
            embedding: self.embedding,
            condition_dim,
            condition_blocks: self.condition_blocks,
            octaves: self.octaves,
            time_features: self.time_features,
            channels: self.channels,
        };
        match self.context {
            None => head.into(),
            Some(context) => HybridShape { head, context }.into(),
        }
    }
}
