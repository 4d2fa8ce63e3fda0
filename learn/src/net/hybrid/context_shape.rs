//! Shape of the context network.

use serde::{Deserialize, Serialize};

use crate::net::mlp::Part;
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

/// Shape of the context network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContextShape {
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

impl Default for ContextShape {
    /// The authors'; they do not say the number of joined features.
    fn default() -> Self {
        let stage = |channels, resolution| Stage {
            channels,
            resolution,
        };
        Self {
            stages: [stage(80, 24), stage(112, 16), stage(112, 8)],
            blocks: 2,
            joined: 128,
            features: 64,
            gate: TimeGate {
                centre: 0.97,
                steepness: 12.0,
            },
        }
    }
}

impl ContextShape {
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

    /// The blocks that FiLM modulates, with their features.
    pub(in crate::net) fn films(&self) -> impl Iterator<Item = (String, usize)> {
        let stages = self.stages.into_iter().enumerate();
        stages.flat_map(move |(s, stage)| {
            (0..self.blocks).map(move |b| (block_name(s, b), stage.channels))
        })
    }
}

/// What a block's tensor names start with.
pub fn block_name(stage: usize, block: usize) -> String {
    format!("context.stages.{stage}.blocks.{block}")
}
