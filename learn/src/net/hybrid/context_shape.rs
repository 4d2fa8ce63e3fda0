//! Shape of the context network.

use serde::{Deserialize, Serialize};

use crate::net::mlp::{Film, Part};
use crate::net::parameters::{
    Initial, MAX_VOXEL_NUMBERS, NetworkShapeError, fan_in, require_finite, require_size,
};

/// Stages of the context network.
pub const STAGES: usize = 3;

/// A stage of the context network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stage {
    /// Features per point and voxel.
    pub channels: usize,
    /// Voxels per edge of its grid.
    pub resolution: usize,
}

/// When the context comes from the cloud: the weight `sigmoid(steepness (t - centre))` at flow time `t` (paper, Eq.
/// time_gate).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeGate {
    /// Flow time `tau` at which cloud and embedding weigh alike.
    pub centre: f32,
    /// Rate `k` of the change.
    pub steepness: f32,
}

impl TimeGate {
    /// Weight of the cloud's context.
    pub(in crate::net) fn weight(self, t: f32) -> f32 {
        1.0 / (1.0 + (-self.steepness * (t - self.centre)).exp())
    }
}

/// Which layers a context network is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ContextLayers {
    /// Residual blocks with GroupNorm and SiLU, the embedding of the head, plain projections: this project's, which learns from
    /// clouds one after another.
    #[default]
    Residual,
    /// The authors': the layers of PVCNN (Liu et al., NeurIPS 2019) with BatchNorm and ReLU, an embedding of its own, norms in the
    /// projections, layers on the maximum over the points. It gives velocities here, and is trained in PyTorch.
    Pvcnn,
}

impl ContextLayers {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Residual, Self::Pvcnn];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Residual => "residual",
            Self::Pvcnn => "pvcnn",
        }
    }

    /// Whether they are [`ContextLayers::Residual`], which files do not say.
    fn are_residual(&self) -> bool {
        *self == Self::Residual
    }
}

/// Shape of the context network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContextShape {
    /// Which layers it is made of; residual ones in files that do not say.
    #[serde(default, skip_serializing_if = "ContextLayers::are_residual")]
    pub layers: ContextLayers,
    /// The stages, each of which takes the features of the one before.
    pub stages: [Stage; STAGES],
    /// Point-voxel blocks per stage.
    pub blocks: usize,
    /// Features in which the stages are joined.
    pub joined: usize,
    /// Features of a point's context.
    pub features: usize,
    /// Blend between the cloud's context and the embedding's.
    pub gate: TimeGate,
}

/// Of residual layers.
impl Default for ContextShape {
    fn default() -> Self {
        Self::of(ContextLayers::default())
    }
}

impl ContextShape {
    /// The authors' sizes with these layers; in residual ones, 128 joined features.
    pub fn of(layers: ContextLayers) -> Self {
        let stage = |channels, resolution| Stage {
            channels,
            resolution,
        };
        Self {
            layers,
            stages: [stage(80, 24), stage(112, 16), stage(112, 8)],
            blocks: 2,
            joined: match layers {
                ContextLayers::Residual => 128,
                ContextLayers::Pvcnn => 112,
            },
            features: 64,
            gate: TimeGate {
                centre: 0.97,
                steepness: 12.0,
            },
        }
    }

    /// Returns an error if the sizes do not describe a network.
    pub(in crate::net) fn check(&self) -> Result<(), NetworkShapeError> {
        let size = |field, found, most, expected| {
            require_size(field, found, (1..=most).contains(&found), expected)
        };
        for stage in self.stages {
            size("stage's channels", stage.channels, 4096, "1 to 4096")?;
            size("stage's resolution", stage.resolution, 128, "1 to 128")?;
            let Stage {
                channels,
                resolution,
            } = stage;
            let found = channels * resolution.pow(3);
            if found > MAX_VOXEL_NUMBERS {
                return Err(NetworkShapeError::Grid {
                    resolution,
                    channels,
                    found,
                });
            }
        }
        size("blocks per stage", self.blocks, 16, "1 to 16")?;
        size("joined features", self.joined, 4096, "1 to 4096")?;
        size("context features", self.features, 4096, "1 to 4096")?;
        require_finite("time gate's centre", self.gate.centre)?;
        require_finite("time gate's steepness", self.gate.steepness)
    }

    /// The parts of the modulation vector that the context adds: the embedding's context, and its share of the first
    /// projection, of points of `inputs` numbers.
    pub(in crate::net) fn parts(&self, embedding: usize, inputs: usize) -> [Part<'static>; 2] {
        let shift = fan_in(embedding + inputs);
        [
            Part::new(
                "context.from_embedding",
                self.features,
                Initial::Constant(0.0),
            ),
            Part::new("context.shift", self.stages[0].channels, shift),
        ]
    }

    /// The blocks that FiLM modulates, from gamma = beta = 0 on.
    pub(in crate::net) fn films(&self) -> impl Iterator<Item = Film> {
        let stages = self.stages.into_iter().enumerate();
        stages.flat_map(move |(s, stage)| {
            (0..self.blocks).map(move |b| Film {
                name: block_name(s, b),
                width: stage.channels,
                initial: Initial::Constant(0.0),
            })
        })
    }
}

/// What a block's tensor names start with.
pub fn block_name(stage: usize, block: usize) -> String {
    format!("context.stages.{stage}.blocks.{block}")
}
