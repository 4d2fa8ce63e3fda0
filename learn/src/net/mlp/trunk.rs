//! The layers that act on points: input layer, residual blocks and output layer.

use std::ops::Range;

use crate::net::layers::{Dense, Keep};
use crate::net::parameters::{Table, fan_in};

/// Sizes of a trunk.
#[derive(Clone, Copy, Debug)]
pub struct TrunkSizes {
    /// Numbers per point, which may have a context.
    pub inputs: usize,
    /// Numbers per velocity.
    pub outputs: usize,
    /// Features per point.
    pub width: usize,
    /// Residual blocks.
    pub blocks: usize,
    /// Features of the embedding, whose share of the input layer is the conditioner's.
    pub embedding: usize,
}

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

/// The trunk's layers on one tile of points.
pub trait TilePass {
    /// Velocities `(T, C)` of a tile of points `(T, inputs)` under one cloud's modulation vector.
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
    /// Adds the trunk's tensors, their names after `prefix`.
    pub fn declare(table: &mut Table, prefix: &str, sizes: TrunkSizes) -> Self {
        let TrunkSizes {
            inputs,
            outputs,
            width,
            blocks,
            embedding,
        } = sizes;
        let start = table.len();
        // Ranges within the trunk.
        let local = |layer: Dense| Dense {
            weight: layer.weight.start - start..layer.weight.end - start,
            bias: layer.bias.start.saturating_sub(start)..layer.bias.end.saturating_sub(start),
            ..layer
        };
        let name = format!("{prefix}input");
        let starts = table.initial;
        let initial = starts.hidden(inputs + embedding);
        let input = local(Dense::declare_unbiased(
            table, &name, inputs, width, initial,
        ));
        let blocks = (0..blocks).map(|l| {
            let name = format!("{prefix}blocks.{l}.linear");
            local(Dense::declare(
                table,
                &name,
                width,
                width,
                starts.hidden(width),
            ))
        });
        let blocks = blocks.collect();
        let name = format!("{prefix}output");
        let output = local(Dense::declare(table, &name, width, outputs, fan_in(width)));
        Self {
            width,
            input,
            blocks,
            output,
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
}
