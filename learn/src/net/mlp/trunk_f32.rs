//! The trunk with products of floats.

use pulp::Arch;

use super::trunk::{TilePass, Trunk, TrunkGradient};
use crate::net::kernels::float32::{activate, fill_rows, multiply, sum_rows};
use crate::net::layers::Keep;
use crate::net::layers::film::{BlockTape, Modulate, ModulateBackward};

/// Points per tile: few enough that the features of all blocks stay in a core's cache, enough to feed the products.
pub const TILE: usize = 128;

/// Features of one tile, kept for the backward pass, and their gradients.
#[derive(Debug)]
pub struct TrunkTape {
    features: Vec<f32>,
    blocks: Vec<BlockTape>,
    activated: Vec<f32>,
    slope: Vec<f32>,
    d_activated: Vec<f32>,
}

impl TrunkTape {
    /// Buffers for one tile.
    pub fn new(trunk: &Trunk) -> Self {
        let matrix = || vec![0.0; TILE * trunk.width];
        Self {
            features: matrix(),
            blocks: trunk
                .blocks
                .iter()
                .map(|_| BlockTape::new(TILE, trunk.width))
                .collect(),
            activated: matrix(),
            slope: matrix(),
            d_activated: matrix(),
        }
    }
}

/// The trunk in floats.
pub struct Float32Pass<'a> {
    pub trunk: &'a Trunk,
    pub params: &'a [f32],
    pub tape: &'a mut TrunkTape,
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
        // Input layer: h = W_x x + shift.
        let features = &mut tape.features[..len];
        fill_rows(features, shift);
        trunk.input.add_product(params, points, features);
        // Residual blocks: m = FiLM(LN(h)) and h' = m + b, then h' += W SiLU(m).
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
        // Output layer: u = W_o SiLU(h) + b_o.
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
        // Output layer, to the gradient d by the last block's output.
        let d = &mut tape.features[..len];
        let d_activated = &mut tape.d_activated[..len];
        trunk
            .output
            .backward(gradient, &tape.activated[..len], d_velocities);
        trunk.output.backward_input(params, d_velocities, d);
        multiply(&tape.slope[..len], d);

        // Blocks, the last first: gradients by W and SiLU(m), then through SiLU, FiLM and LN to d, that by the block's input.
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
        // Input layer.
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
