//! From a cloud's condition to its summand of the embedding.

use std::ops::Range;

use pulp::Arch;

use crate::net::kernels::float32::{activate, multiply};
use crate::net::layers::Dense;
use crate::net::layers::film::{BlockTape, Modulate, ModulateBackward};
use crate::net::parameters::{Initial, Table};

/// `SiLU(h)`, where `h` is a dense layer of the condition and passes through residual blocks like the trunk's without FiLM:
/// `m = LN(h)`, `h = m + W SiLU(m) + b`. Without blocks the paper's branch.
///
/// A command determines where the discs are through a product of as many rotations. One layer cannot express that and
/// leaves it to the layers that act on points; here it costs one row per cloud.
#[derive(Clone, Debug)]
pub struct Condition {
    input: Dense,
    blocks: Vec<Block>,
}

/// A residual block: where the norm's weight and bias lie, one behind the other, and its layer.
#[derive(Clone, Debug)]
struct Block {
    norm: Range<usize>,
    linear: Dense,
}

/// Intermediate results for `B` clouds, and their gradients.
#[derive(Debug, Default)]
pub struct ConditionTape {
    features: Vec<f32>,
    blocks: Vec<BlockTape>,
    /// The summand of the embedding, `(B, E)`.
    pub activated: Vec<f32>,
    slope: Vec<f32>,
    d: Vec<f32>,
    d_activated: Vec<f32>,
}

impl Condition {
    /// Adds the tensors of a branch from a condition of `inputs` numbers to `embedding` ones, with `blocks` blocks, named after
    /// `prefix`; the first layer starts as `initial`. Norms start as the identity.
    pub fn declare(
        table: &mut Table,
        prefix: &str,
        [inputs, embedding, blocks]: [usize; 3],
        initial: Initial,
    ) -> Self {
        let name = format!("{prefix}condition");
        let input = Dense::declare(table, &name, inputs, embedding, initial);
        let hidden = table.initial.hidden(embedding);
        let block = |l: usize| {
            let name = format!("{prefix}condition_blocks.{l}");
            let one = Initial::Constant(1.0);
            let weight = table.push(format!("{name}.norm.weight"), &[embedding], one);
            let zero = Initial::Constant(0.0);
            let bias = table.push(format!("{name}.norm.bias"), &[embedding], zero);
            let name = format!("{name}.linear");
            Block {
                norm: weight.start..bias.end,
                linear: Dense::declare(table, &name, embedding, embedding, hidden),
            }
        };
        let blocks = (0..blocks).map(block).collect();
        Self { input, blocks }
    }

    /// Floating-point operations of the forward pass, products alone, per cloud.
    pub fn flops(&self) -> u64 {
        let blocks = self.blocks.iter().map(|block| block.linear.flops(1));
        self.input.flops(1) + blocks.sum::<u64>()
    }

    /// Fills `tape.activated` for conditions `(B, D)`.
    pub fn forward(&self, params: &[f32], conditions: &[f32], tape: &mut ConditionTape) {
        let width = self.input.outputs;
        let rows = conditions.len() / self.input.inputs;
        let len = rows * width;
        for buffer in [&mut tape.features, &mut tape.activated, &mut tape.slope] {
            buffer.resize(len, 0.0);
        }
        let fits = |block: &BlockTape| {
            block.inverse_deviation.len() >= rows && block.activated.len() >= len
        };
        // A workspace may come from another network.
        if tape.blocks.len() != self.blocks.len() || !tape.blocks.iter().all(fits) {
            let blocks = self.blocks.iter();
            tape.blocks = blocks.map(|_| BlockTape::new(rows, width)).collect();
        }
        let features = &mut tape.features[..];
        self.input.forward(params, conditions, features);
        for (block, tape) in self.blocks.iter().zip(&mut tape.blocks) {
            let (scale, offset) = params[block.norm.clone()].split_at(width);
            Arch::new().dispatch(Modulate {
                features,
                scale,
                offset,
                bias: &params[block.linear.bias.clone()],
                tape,
            });
            let activated = &tape.activated[..len];
            block.linear.add_product(params, activated, features);
        }
        activate(features, &mut tape.activated, &mut tape.slope);
    }

    /// Backward pass of [`Condition::forward`], from `d_embedding`, the gradient by the embedding `(B, E)`. Adds to `gradient`.
    pub fn backward(
        &self,
        params: &[f32],
        conditions: &[f32],
        tape: &mut ConditionTape,
        d_embedding: &[f32],
        gradient: &mut [f32],
    ) {
        let width = self.input.outputs;
        let ConditionTape { d, d_activated, .. } = tape;
        d.clear();
        d.extend_from_slice(d_embedding);
        multiply(&tape.slope, d);
        d_activated.resize(d.len(), 0.0);
        for (block, tape) in self.blocks.iter().zip(&tape.blocks).rev() {
            let activated = &tape.activated[..d.len()];
            block.linear.backward(gradient, activated, d);
            block.linear.backward_input(params, d, d_activated);
            let d_norm = &mut gradient[block.norm.clone()];
            let (d_scale, d_offset) = d_norm.split_at_mut(width);
            Arch::new().dispatch(ModulateBackward {
                features: d,
                activated: d_activated,
                scale: &params[block.norm.clone()][..width],
                tape,
                d_scale,
                d_offset,
            });
        }
        self.input.backward(gradient, conditions, d);
    }
}
