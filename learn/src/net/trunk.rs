//! What the network computes at every point: input layer, residual blocks and output layer, a tile of points at a time.

use pulp::Arch;

use super::dense::Dense;
use super::kernels::{
    BlockTape, Modulate, ModulateBackward, activate, fill_rows, multiply, sum_rows,
};
use super::shape::{DIM, MlpShape};

/// Points per tile: few enough that the features of all blocks stay in a core's cache, enough to feed the products.
pub(super) const TILE: usize = 128;

/// The layers that act on points; their tensors' ranges count from the first of them (`Trunk::start`).
#[derive(Clone, Debug)]
pub(super) struct Trunk {
    width: usize,
    /// The points' share of the input layer; its bias is part of the modulation's shift.
    input: Dense,
    blocks: Vec<Dense>,
    output: Dense,
    /// Where the trunk's tensors start in the flat parameter vector.
    pub start: usize,
}

/// Features of one tile, kept for the backward pass, and room for their gradients.
#[derive(Debug)]
pub(super) struct TrunkTape {
    features: Vec<f32>,
    blocks: Vec<BlockTape>,
    activated: Vec<f32>,
    slope: Vec<f32>,
    d_activated: Vec<f32>,
}

/// What a forward pass keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Keep {
    /// All that a backward pass needs.
    EveryBlock,
    /// Nothing beyond a block: the blocks share memory, which then stays in the cache (a tenth faster).
    Nothing,
}

/// Gradients of the loss that a trunk's backward pass adds to.
#[derive(Debug, Default)]
pub(super) struct TrunkGradient {
    /// By the trunk's parameters.
    pub params: Vec<f32>,
    /// By one cloud's modulation vector.
    pub modulation: Vec<f32>,
}

impl Trunk {
    pub fn new(shape: &MlpShape) -> Self {
        let start = shape.tensor_range("input.weight").start;
        let part = |name: &str| {
            let range = shape.tensor_range(name);
            range.start - start..range.end - start
        };
        let dense = |name: &str, inputs, outputs| Dense {
            inputs,
            outputs,
            weight: part(&format!("{name}.weight")),
            bias: part(&format!("{name}.bias")),
        };
        let width = shape.width;
        Self {
            width,
            input: Dense {
                inputs: DIM,
                outputs: width,
                weight: part("input.weight"),
                bias: 0..0,
            },
            blocks: (0..shape.blocks())
                .map(|l| dense(&format!("blocks.{l}.linear"), width, width))
                .collect(),
            output: dense("output", width, DIM),
            start,
        }
    }

    /// Room for one tile.
    pub fn tape(&self) -> TrunkTape {
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

    /// Velocities `(T, 3)` of at most [`TILE`] points `(T, 3)` under one cloud's modulation vector.
    pub fn forward(
        &self,
        params: &[f32],
        modulation: &[f32],
        points: &[f32],
        keep: Keep,
        tape: &mut TrunkTape,
        velocities: &mut [f32],
    ) {
        let len = points.len() / DIM * self.width;
        let (shift, blocks) = modulation.split_at(self.width);
        let features = &mut tape.features[..len];
        fill_rows(features, shift);
        self.input.add_product(params, points, features);
        let modulations = blocks.chunks_exact(2 * self.width);
        for (l, (layer, modulation)) in self.blocks.iter().zip(modulations).enumerate() {
            let tape = match keep {
                Keep::EveryBlock => &mut tape.blocks[l],
                Keep::Nothing => &mut tape.blocks[0],
            };
            let (scale, offset) = modulation.split_at(self.width);
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
        self.output.forward(params, activated, velocities);
    }

    /// Backward pass of [`Trunk::forward`], from `d_velocities` `(T, 3)`, the gradient by its velocities.
    ///
    /// Adds to `gradient`. Consumes the tape's features.
    pub fn backward(
        &self,
        params: &[f32],
        modulation: &[f32],
        points: &[f32],
        d_velocities: &[f32],
        tape: &mut TrunkTape,
        gradient: &mut TrunkGradient,
    ) {
        let len = points.len() / DIM * self.width;
        let (d_shift, d_blocks) = gradient.modulation.split_at_mut(self.width);
        let gradient = &mut gradient.params[..];
        let d = &mut tape.features[..len];
        let d_activated = &mut tape.d_activated[..len];
        self.output
            .backward(gradient, &tape.activated[..len], d_velocities);
        self.output.backward_input(params, d_velocities, d);
        multiply(&tape.slope[..len], d);

        let modulations = modulation[self.width..].chunks_exact(2 * self.width);
        let modulations = modulations.zip(d_blocks.chunks_exact_mut(2 * self.width));
        let blocks = self.blocks.iter().zip(&tape.blocks).zip(modulations);
        for ((layer, tape), (modulation, d_modulation)) in blocks.rev() {
            layer.backward(gradient, &tape.activated[..len], d);
            layer.backward_input(params, d, d_activated);
            let (d_scale, d_offset) = d_modulation.split_at_mut(self.width);
            Arch::new().dispatch(ModulateBackward {
                features: d,
                activated: d_activated,
                scale: &modulation[..self.width],
                tape,
                d_scale,
                d_offset,
            });
        }
        sum_rows(d, d_shift);
        self.input.backward_weight(gradient, points, d);
    }
}
