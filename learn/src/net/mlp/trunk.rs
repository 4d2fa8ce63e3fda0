//! What the network computes at every point: input layer, residual blocks and output layer, a tile of points at a time.

use std::ops::Range;

use pulp::Arch;
use rayon::prelude::*;

use super::shape::{MlpShape, Table, fan_in};
use super::trunk_bf16::{self, Bf16Pass, PackedTrunk};
use crate::net::kernels::float32::{
    BlockTape, Modulate, ModulateBackward, activate, fill_rows, multiply, sum_rows,
};
use crate::net::layers::{Dense, Weights};
use crate::pool::Pool;

/// Points per tile: few enough that the features of all blocks stay in a core's cache, enough to feed the products.
pub const TILE: usize = 128;

/// The layers that act on points; their tensors' ranges count from the first of them (`Trunk::range`).
#[derive(Clone, Debug)]
pub struct Trunk {
    pub width: usize,
    /// The points' share of the input layer; its bias is part of the modulation's shift.
    pub input: Dense,
    pub blocks: Vec<Dense>,
    pub output: Dense,
    /// Where the trunk's tensors lie in the flat parameter vector.
    pub range: Range<usize>,
}

/// Features of one tile, kept for the backward pass, and room for their gradients.
#[derive(Debug)]
pub struct TrunkTape {
    features: Vec<f32>,
    blocks: Vec<BlockTape>,
    activated: Vec<f32>,
    slope: Vec<f32>,
    d_activated: Vec<f32>,
}

/// Tapes for either kind of numbers.
#[derive(Clone, Debug, Default)]
pub struct TrunkTapes {
    float32: Pool<TrunkTape>,
    bfloat16: Pool<trunk_bf16::TrunkTape>,
}

impl Weights<'_, PackedTrunk> {
    /// Points per tile.
    pub fn tile(self) -> usize {
        match self.packed {
            None => TILE,
            Some(packed) => packed.tile(),
        }
    }
}

/// The trunk's layers on one tile of points.
pub trait TilePass {
    /// Velocities `(T, C)` of at most [`Weights::tile`] points `(T, inputs)` under one cloud's modulation vector.
    fn forward(&mut self, modulation: &[f32], points: &[f32], keep: Keep, velocities: &mut [f32]);

    /// Backward pass of [`TilePass::forward`], from `d_velocities` `(T, C)`, the gradient by its velocities.
    ///
    /// Adds to `gradient`. Consumes the tape's features.
    fn backward(
        &mut self,
        modulation: &[f32],
        points: &[f32],
        d_velocities: &[f32],
        gradient: &mut TrunkGradient,
    );
}

/// What a forward pass keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// All that a backward pass needs.
    EveryBlock,
    /// Nothing beyond a block: the blocks share memory, which then stays in the cache (a tenth faster).
    Nothing,
}

/// Gradients of the loss that a trunk's backward pass adds to.
#[derive(Debug, Default)]
pub struct TrunkGradient {
    /// By the trunk's parameters.
    pub params: Vec<f32>,
    /// By one cloud's modulation vector.
    pub modulation: Vec<f32>,
    /// By the points, one tile's after the other's, where it is wanted.
    pub points: Option<Vec<f32>>,
}

impl Trunk {
    /// Adds the trunk's tensors for points of `inputs` numbers, their names after `prefix`.
    pub fn declare(
        table: &mut Table,
        prefix: &str,
        [inputs, outputs]: [usize; 2],
        shape: &MlpShape,
    ) -> Self {
        let start = table.len();
        // Ranges within the trunk.
        let local = |layer: Dense| Dense {
            weight: layer.weight.start - start..layer.weight.end - start,
            bias: layer.bias.start.saturating_sub(start)..layer.bias.end.saturating_sub(start),
            ..layer
        };
        let width = shape.width;
        let input = table.product(
            &format!("{prefix}input"),
            inputs,
            width,
            fan_in(inputs + shape.embedding),
        );
        let blocks = (0..shape.blocks()).map(|l| {
            let name = format!("{prefix}blocks.{l}.linear");
            local(table.dense(&name, width, width, fan_in(width)))
        });
        let blocks = blocks.collect();
        let output = table.dense(&format!("{prefix}output"), width, outputs, fan_in(width));
        Self {
            width,
            input: local(input),
            blocks,
            output: local(output),
            range: start..table.len(),
        }
    }

    /// Length of the modulation vector's part for the trunk: the input layer's shift, then scale and offset per block.
    pub fn modulation_len(&self) -> usize {
        self.width * (1 + 2 * self.blocks.len())
    }

    /// Floating-point operations of the forward pass over `points` points, products alone.
    pub fn flops(&self, points: usize) -> u64 {
        let layers = self.blocks.iter().chain([&self.input, &self.output]);
        layers.map(|layer| layer.flops(points)).sum()
    }

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
                || self.tape(),
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

    /// Room for one tile.
    fn tape(&self) -> TrunkTape {
        let matrix = || vec![0.0; TILE * self.width];
        TrunkTape {
            features: matrix(),
            blocks: self
                .blocks
                .iter()
                .map(|_| BlockTape::new(TILE, self.width))
                .collect(),
            activated: matrix(),
            slope: matrix(),
            d_activated: matrix(),
        }
    }
}

/// The trunk in floats.
struct Float32Pass<'a> {
    trunk: &'a Trunk,
    params: &'a [f32],
    tape: &'a mut TrunkTape,
}

impl TilePass for Float32Pass<'_> {
    fn forward(&mut self, modulation: &[f32], points: &[f32], keep: Keep, velocities: &mut [f32]) {
        let Self {
            trunk,
            params,
            tape,
        } = self;
        let len = points.len() / trunk.input.inputs * trunk.width;
        let (shift, blocks) = modulation.split_at(trunk.width);
        let features = &mut tape.features[..len];
        fill_rows(features, shift);
        trunk.input.add_product(params, points, features);
        let modulations = blocks.chunks_exact(2 * trunk.width);
        for (l, (layer, modulation)) in trunk.blocks.iter().zip(modulations).enumerate() {
            let tape = match keep {
                Keep::EveryBlock => &mut tape.blocks[l],
                Keep::Nothing => &mut tape.blocks[0],
            };
            let (scale, offset) = modulation.split_at(trunk.width);
            let bias = &params[layer.bias.clone()];
            Arch::new().dispatch(Modulate {
                features,
                scale,
                offset,
                bias,
                tape,
            });
            layer.add_product(params, &tape.activated[..len], features);
        }
        let (activated, slope) = (&mut tape.activated[..len], &mut tape.slope[..len]);
        activate(features, activated, slope);
        trunk.output.forward(params, activated, velocities);
    }

    fn backward(
        &mut self,
        modulation: &[f32],
        points: &[f32],
        d_velocities: &[f32],
        gradient: &mut TrunkGradient,
    ) {
        let Self {
            trunk,
            params,
            tape,
        } = self;
        let len = points.len() / trunk.input.inputs * trunk.width;
        let TrunkGradient {
            params: gradient,
            modulation: d_modulation,
            points: d_points,
        } = gradient;
        let (d_shift, d_blocks) = d_modulation.split_at_mut(trunk.width);
        let d = &mut tape.features[..len];
        let d_activated = &mut tape.d_activated[..len];
        trunk
            .output
            .backward(gradient, &tape.activated[..len], d_velocities);
        trunk.output.backward_input(params, d_velocities, d);
        multiply(&tape.slope[..len], d);

        let modulations = modulation[trunk.width..].chunks_exact(2 * trunk.width);
        let modulations = modulations.zip(d_blocks.chunks_exact_mut(2 * trunk.width));
        let blocks = trunk.blocks.iter().zip(&tape.blocks).zip(modulations);
        for ((layer, tape), (modulation, d_modulation)) in blocks.rev() {
            layer.backward(gradient, &tape.activated[..len], d);
            layer.backward_input(params, d, d_activated);
            let (d_scale, d_offset) = d_modulation.split_at_mut(trunk.width);
            Arch::new().dispatch(ModulateBackward {
                features: d,
                activated: d_activated,
                scale: &modulation[..trunk.width],
                tape,
                d_scale,
                d_offset,
            });
        }
        sum_rows(d, d_shift);
        trunk.input.backward_weight(gradient, points, d);
        if let Some(d_points) = d_points {
            let start = d_points.len();
            d_points.resize(start + points.len(), 0.0);
            trunk
                .input
                .backward_input(params, d, &mut d_points[start..]);
        }
    }
}
