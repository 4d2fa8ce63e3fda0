//! The trunk on any number of points, in either operand type.

use rayon::prelude::*;

use super::trunk::{TilePass, Trunk};
use super::trunk_bf16::{self, Bf16Pass, PackedTrunk};
use super::trunk_f32::{self, Float32Pass};
use crate::net::layers::{Keep, Weights};
use crate::pool::Pool;

/// Most points of a tile, whatever the operand type.
pub const LARGEST_TILE: usize = trunk_bf16::TILE;

/// Tapes for either operand type.
#[derive(Clone, Debug, Default)]
pub struct TrunkTapes {
    float32: Pool<trunk_f32::TrunkTape>,
    bfloat16: Pool<trunk_bf16::TrunkTape>,
}

impl Weights<'_, PackedTrunk> {
    /// Points per tile.
    pub fn tile(self) -> usize {
        match self.packed {
            None => trunk_f32::TILE,
            Some(packed) => packed.tile(),
        }
    }
}

impl Trunk {
    /// Velocities `(N, C)` of any number of points `(N, inputs)`, tile by tile in parallel.
    pub fn velocities(
        &self,
        weights: Weights<PackedTrunk>,
        modulation: &[f32],
        points: &[f32],
        tapes: &TrunkTapes,
        velocities: &mut [f32],
    ) {
        let tile = weights.tile();
        points
            .par_chunks(tile * self.input.inputs)
            .zip(velocities.par_chunks_mut(tile * self.output.outputs))
            .for_each(|(points, velocities)| {
                self.with_pass(weights, tapes, |pass| {
                    pass.forward(modulation, points, Keep::Nothing, velocities);
                });
            });
    }

    /// Runs `work` with the pass that suits the weights.
    pub fn with_pass<R>(
        &self,
        weights: Weights<PackedTrunk>,
        tapes: &TrunkTapes,
        work: impl FnOnce(&mut dyn TilePass) -> R,
    ) -> R {
        let Weights { params, packed } = weights;
        let trunk = self;
        match packed {
            None => tapes.float32.with(
                || trunk_f32::TrunkTape::new(self),
                |tape| {
                    work(&mut Float32Pass {
                        trunk,
                        params,
                        tape,
                    })
                },
            ),
            Some(packed) => tapes.bfloat16.with(trunk_bf16::TrunkTape::default, |tape| {
                work(&mut Bf16Pass {
                    trunk,
                    params,
                    packed,
                    tape,
                })
            }),
        }
    }
}
