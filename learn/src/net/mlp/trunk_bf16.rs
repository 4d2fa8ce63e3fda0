//! The trunk with bfloat16 products.
//!
//! Operands of the hidden layers' products are rounded to bfloat16, and so is what the backward pass needs of a block. The
//! residual stream, all sums, norms and gradients are floats, as are input and output layer where points have few numbers.

use faer::Accum;
use rayon::prelude::*;

use super::trunk::{TilePass, Trunk, TrunkGradient};
use crate::net::kernels::bfloat16::{Floats, Kernel, Output, Tiles, multiply};
use crate::net::kernels::float32::sum_rows;
use crate::net::layers::film_bf16::{BlockTape, Modulate, ModulateBackward};
use crate::net::layers::{
    Dense, InputBackward, InputLayer, Keep, OutputBackward, OutputLayer, PackedWeight, Passes,
};

/// Most points per tile: the gradient by a weight is read and written once a tile.
pub const TILE: usize = 512;

/// Smallest input width for which the input layer runs in bfloat16: above that of a point with Fourier features, whose
/// coordinates have to be told more finely apart than by bfloat16's 8 bits, and below that of one with a context.
const MANY: usize = 64;

/// Padding between the rows of matrices that products update in place: rows at a power of two of bytes would share a few
/// lines of a cache.
const PAD: usize = 16;

/// The trunk's weights in tiles.
#[derive(Clone, Debug, Default)]
pub struct PackedTrunk {
    input: PackedInput,
    blocks: Vec<PackedWeight>,
}

/// The input layer's weight.
#[derive(Clone, Debug)]
enum PackedInput {
    /// With few inputs: its transpose, `(I, H)`, in floats.
    Few(Vec<f32>),
    Many(PackedWeight),
}

impl Default for PackedInput {
    fn default() -> Self {
        Self::Few(Vec::new())
    }
}

impl PackedInput {
    fn set(&mut self, layer: &Dense, params: &[f32], passes: Passes) {
        match self {
            Self::Many(packed) => packed.set(layer, params, passes),
            Self::Few(_) if layer.inputs >= MANY => {
                *self = Self::Many(PackedWeight::default());
                self.set(layer, params, passes);
            }
            Self::Few(transposed) => {
                transposed.clear();
                let weight = &params[layer.weight.clone()];
                let columns = (0..layer.inputs).map(|k| weight[k..].iter().step_by(layer.inputs));
                transposed.extend(columns.flatten());
            }
        }
    }
}

impl PackedTrunk {
    /// Points per tile; fewer where they have a context, whose tiles take memory too.
    pub fn tile(&self) -> usize {
        match self.input {
            PackedInput::Few(_) => TILE,
            PackedInput::Many(_) => TILE / 2,
        }
    }

    /// Packs the weights of `trunk`, of which `params` are the parameters.
    pub fn set(&mut self, trunk: &Trunk, params: &[f32], passes: Passes) {
        self.input.set(&trunk.input, params, passes);
        self.blocks
            .resize_with(trunk.blocks.len(), PackedWeight::default);
        let layers = self.blocks.par_iter_mut().zip(&trunk.blocks);
        layers.for_each(|(packed, layer)| packed.set(layer, params, passes));
    }
}

/// Features of one tile, kept for the backward pass, and their gradients.
#[derive(Debug, Default)]
pub struct TrunkTape {
    /// Features or the gradient by them, `(T, H)` with stride `H + PAD`.
    features: Vec<f32>,
    blocks: Vec<BlockTape>,
    /// SiLU of the last features and its slope, `(T, H)`.
    last: [Vec<u16>; 2],
    /// The gradient by a layer's input, with stride `H + PAD`.
    d_activated: Vec<f32>,
    points: Tiles,
    /// The gradient by a layer's output, a left matrix, and its transpose, another.
    d: Tiles,
    d_transposed: Tiles,
    /// A layer's input, a right matrix.
    inputs: Tiles,
    /// The gradient by the input layer's weight, transposed.
    d_input: Vec<f32>,
}

impl TrunkTape {
    /// Resizes the buffers for `rows` points of `width` features and `blocks` blocks.
    fn resize(&mut self, rows: usize, width: usize, blocks: usize) {
        for buffer in [&mut self.features, &mut self.d_activated] {
            buffer.resize(rows * (width + PAD), 0.0);
        }
        for buffer in &mut self.last {
            buffer.resize(rows * width, 0);
        }
        self.d.resize(rows, width);
        self.blocks
            .resize_with(blocks.max(self.blocks.len()), BlockTape::default);
        let blocks = &mut self.blocks[..blocks];
        blocks
            .iter_mut()
            .for_each(|block| block.resize(rows, width));
    }
}

/// The trunk on a tile of points.
pub struct Bf16Pass<'a> {
    pub trunk: &'a Trunk,
    pub params: &'a [f32],
    pub packed: &'a PackedTrunk,
    pub tape: &'a mut TrunkTape,
}

impl Bf16Pass<'_> {
    /// Forward pass of the input layer: `h = W_x x + shift`.
    fn input_forward(&mut self, shift: &[f32], points: &[f32]) {
        let features = &mut self.tape.features[..];
        match &self.packed.input {
            PackedInput::Few(weight) => InputLayer {
                points,
                weight,
                shift,
                features,
            }
            .run(),
            PackedInput::Many(packed) => {
                let (inputs, width) = (self.trunk.input.inputs, shift.len());
                for row in features.chunks_exact_mut(width + PAD) {
                    row[..width].copy_from_slice(shift);
                }
                self.tape.points.set_left(Floats::dense(points, inputs));
                let output = padded(features, width);
                multiply(output, Accum::Add, &self.tape.points, &packed.forward);
            }
        }
    }

    /// Backward pass of the input layer, from the gradient by its output in the tape.
    fn input_backward(
        &mut self,
        points: &[f32],
        gradient: &mut [f32],
        d_points: Option<&mut Vec<f32>>,
    ) {
        let (layer, width, tape) = (&self.trunk.input, self.trunk.width, &mut *self.tape);
        let rows = points.len() / layer.inputs;
        match &self.packed.input {
            PackedInput::Few(_) => {
                tape.d_input.clear();
                tape.d_input.resize(layer.inputs * width, 0.0);
                InputBackward {
                    points,
                    d: &tape.features,
                    d_weight: &mut tape.d_input,
                    width,
                }
                .run();
                let d_weight = gradient[layer.weight.clone()].chunks_exact_mut(layer.inputs);
                for (feature, d_weight) in d_weight.enumerate() {
                    let column = tape.d_input[feature..].iter().step_by(width);
                    d_weight.iter_mut().zip(column).for_each(|(d, c)| *d += c);
                }
                if let Some(d_points) = d_points {
                    let start = d_points.len();
                    d_points.resize(start + points.len(), 0.0);
                    let rows = tape.features.chunks_exact(width + PAD);
                    for (d, d_point) in rows.zip(d_points[start..].chunks_exact_mut(layer.inputs)) {
                        layer.backward_input(self.params, &d[..width], d_point);
                    }
                }
            }
            PackedInput::Many(packed) => {
                tape.d_transposed
                    .set_left_transposed_from(&tape.d, [rows, width]);
                tape.inputs.set_right(Floats::dense(points, layer.inputs));
                add_weight_gradient(layer, gradient, &tape.d_transposed, &tape.inputs);
                if let Some(d_points) = d_points {
                    let start = d_points.len();
                    d_points.resize(start + points.len(), 0.0);
                    let output = Output::dense(&mut d_points[start..], layer.inputs);
                    multiply(output, Accum::Replace, &tape.d, &packed.backward);
                }
            }
        }
    }
}

impl TilePass for Bf16Pass<'_> {
    fn forward(&mut self, modulation: &[f32], points: &[f32], keep: Keep, velocities: &mut [f32]) {
        let (trunk, params) = (self.trunk, self.params);
        let (width, rows) = (trunk.width, points.len() / trunk.input.inputs);
        let blocks = match keep {
            Keep::EveryBlock => trunk.blocks.len(),
            Keep::Nothing => trunk.blocks.len().min(1),
        };
        self.tape.resize(rows, width, blocks);
        let (shift, modulations) = modulation.split_at(width);
        self.input_forward(shift, points);

        // Residual blocks: m = FiLM(LN(h)) and h' = m + b, then h' += W SiLU(m).
        let tape = &mut *self.tape;
        let features = &mut tape.features[..];
        let layers = trunk.blocks.iter().zip(&self.packed.blocks);
        let modulations = modulations.chunks_exact(2 * width);
        for (l, ((layer, packed), modulation)) in layers.zip(modulations).enumerate() {
            let block = &mut tape.blocks[l.min(blocks - 1)];
            let (scale, offset) = modulation.split_at(width);
            Modulate {
                features,
                scale,
                offset,
                bias: &params[layer.bias.clone()],
                keep,
                tape: block,
            }
            .run();
            let output = padded(features, width);
            multiply(output, Accum::Add, &block.activated, &packed.forward);
        }
        // Output layer: u = W_o SiLU(h) + b_o.
        OutputLayer {
            features,
            weight: &params[trunk.output.weight.clone()],
            bias: &params[trunk.output.bias.clone()],
            keep,
            kept: tape.last.each_mut().map(|kept| &mut kept[..]),
            outputs: velocities,
        }
        .run();
    }

    fn backward(
        &mut self,
        modulation: &[f32],
        points: &[f32],
        d_velocities: &[f32],
        gradient: &mut TrunkGradient,
    ) {
        let (trunk, tape) = (self.trunk, &mut *self.tape);
        let (width, rows) = (trunk.width, points.len() / trunk.input.inputs);
        let TrunkGradient {
            params: gradient,
            modulation: d_modulation,
            points: d_points,
        } = gradient;
        let (d_shift, d_blocks) = d_modulation.split_at_mut(width);

        // Output layer. The sum over the rows of a gradient is the gradient by the bias before it: the last block's, or the shift's.
        let weight = trunk.output.weight.clone();
        sum_rows(d_velocities, &mut gradient[trunk.output.bias.clone()]);
        let (d_weight, sum) = match trunk.blocks.last() {
            None => (&mut gradient[weight.clone()], &mut *d_shift),
            Some(layer) => {
                let parts = gradient.get_disjoint_mut([weight.clone(), layer.bias.clone()]);
                parts.expect("tensors of their own").into()
            }
        };
        OutputBackward {
            d_outputs: d_velocities,
            weight: &self.params[weight],
            kept: tape.last.each_ref().map(|kept| &kept[..]),
            d_weight,
            d_features: &mut tape.features,
            rounded: &mut tape.d,
            sum,
            channels: trunk.output.outputs,
        }
        .run();
        // Blocks, the last first: gradients by SiLU(m) and by W from the gradient d by the block's output; then through SiLU,
        // FiLM and LN to that by its input, which replaces d.
        let modulations = modulation[width..].chunks_exact(2 * width);
        let modulations = modulations.zip(d_blocks.chunks_exact_mut(2 * width));
        let layers = trunk.blocks.iter().zip(&self.packed.blocks);
        let layers = layers.zip(&tape.blocks).zip(modulations);
        for (l, (((layer, packed), block), (modulation, d_modulation))) in layers.enumerate().rev()
        {
            let output = padded(&mut tape.d_activated, width);
            multiply(output, Accum::Replace, &tape.d, &packed.backward);
            tape.d_transposed
                .set_left_transposed_from(&tape.d, [rows, width]);
            tape.inputs.set_right_from(&block.activated, [rows, width]);
            add_weight_gradient(layer, gradient, &tape.d_transposed, &tape.inputs);
            let (d_scale, d_offset) = d_modulation.split_at_mut(width);
            ModulateBackward {
                features: &mut tape.features,
                activated: &tape.d_activated,
                scale: &modulation[..width],
                tape: block,
                d_scale,
                d_offset,
                rounded: &mut tape.d,
                sum: match l.checked_sub(1) {
                    None => &mut *d_shift,
                    Some(before) => &mut gradient[trunk.blocks[before].bias.clone()],
                },
            }
            .run();
        }
        self.input_backward(points, gradient, d_points.as_mut());
    }
}

/// A matrix with padded rows as the output of a product.
fn padded(numbers: &mut [f32], columns: usize) -> Output<'_> {
    let stride = columns + PAD;
    Output {
        rows: numbers.len() / stride,
        numbers,
        stride,
        columns,
    }
}

/// `dW += dY^T X`, from `dY^T` and `X`.
fn add_weight_gradient(layer: &Dense, gradient: &mut [f32], dy_transposed: &Tiles, x: &Tiles) {
    let output = Output::dense(&mut gradient[layer.weight.clone()], layer.inputs);
    multiply(output, Accum::Add, dy_transposed, x);
}
