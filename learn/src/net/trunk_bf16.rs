//! The trunk with bfloat16 products.
//!
//! Operands of the hidden layers' products are rounded, and so is what the backward pass needs of a block; the residual
//! stream, all sums, norms and gradients are floats. Input and output layer are floats too where points have few numbers.

use faer::Accum;
use pulp::Arch;
use rayon::prelude::*;

use super::bf16::{
    BlockTape, Floats, Modulate, ModulateBackward, Output, PackedWeight, Passes, Tiles, multiply,
};
use super::dense::Dense;
use super::kernels::{activate, fill_rows, multiply as multiply_by, sum_rows};
use super::trunk::{Keep, TilePass, Trunk, TrunkGradient};

/// Points per tile: the gradient by a weight is read and written once a tile.
pub(super) const TILE: usize = 256;

/// Inputs from which on a layer is worth packing.
const MANY: usize = 32;

/// Numbers between the rows of what products read and write again: rows at a power of two of bytes would share a few
/// lines of a cache.
const PAD: usize = 16;

/// The trunk's weights in tiles.
#[derive(Clone, Debug, Default)]
pub(super) struct PackedTrunk {
    /// The input layer's, where it has many inputs.
    input: Option<PackedWeight>,
    blocks: Vec<PackedWeight>,
}

impl PackedTrunk {
    /// Packs the weights of `trunk`, of which `params` are the parameters.
    pub fn set(&mut self, trunk: &Trunk, params: &[f32], passes: Passes) {
        if trunk.input.inputs >= MANY {
            let input = self.input.get_or_insert_default();
            input.set(&trunk.input, params, passes);
        }
        self.blocks.resize_with(trunk.blocks.len(), PackedWeight::default);
        let layers = self.blocks.par_iter_mut().zip(&trunk.blocks);
        layers.for_each(|(packed, layer)| packed.set(layer, params, passes));
    }
}

/// Features of one tile, kept for the backward pass, and room for their gradients.
#[derive(Debug, Default)]
pub(super) struct TrunkTape {
    /// Rows apart by [`PAD`].
    features: Vec<f32>,
    blocks: Vec<BlockTape>,
    /// Before the output layer, and features without padding.
    activated: Vec<f32>,
    slope: Vec<f32>,
    /// Rows apart by [`PAD`].
    d_activated: Vec<f32>,
    points: Tiles,
    /// The gradient by a layer's output, a left matrix, and its transpose, another.
    d: Tiles,
    d_transposed: Tiles,
    /// What entered a layer, a right matrix.
    entered: Tiles,
}

impl TrunkTape {
    /// Makes room for `rows` points of `width` features and `blocks` blocks.
    fn resize(&mut self, rows: usize, width: usize, blocks: usize) {
        for buffer in [&mut self.activated, &mut self.slope] {
            buffer.resize(rows * width, 0.0);
        }
        for buffer in [&mut self.features, &mut self.d_activated] {
            buffer.resize(rows * (width + PAD), 0.0);
        }
        self.blocks.resize_with(blocks.max(self.blocks.len()), BlockTape::default);
        self.blocks[..blocks].iter_mut().for_each(|block| block.resize(rows, width));
    }
}

/// The trunk on a tile of points.
pub(super) struct Bf16Pass<'a> {
    pub trunk: &'a Trunk,
    pub params: &'a [f32],
    pub packed: &'a PackedTrunk,
    pub tape: &'a mut TrunkTape,
}

impl TilePass for Bf16Pass<'_> {
    fn forward(&mut self, modulation: &[f32], points: &[f32], keep: Keep, velocities: &mut [f32]) {
        let Self {
            trunk,
            params,
            packed,
            tape,
        } = self;
        let (width, rows) = (trunk.width, points.len() / trunk.input.inputs);
        let blocks = match keep {
            Keep::EveryBlock => trunk.blocks.len(),
            Keep::Nothing => trunk.blocks.len().min(1),
        };
        tape.resize(rows, width, blocks);
        let (shift, modulations) = modulation.split_at(width);
        let entered = &mut tape.activated[..];
        fill_rows(entered, shift);
        if let Some(input) = &packed.input {
            tape.points.set_left(Floats::dense(points, trunk.input.inputs));
            let output = Output::dense(entered, width);
            multiply(output, Accum::Add, &tape.points, &input.forward);
        } else {
            trunk.input.add_product(params, points, entered);
        }
        let features = &mut tape.features[..];
        for (padded, row) in features.chunks_exact_mut(width + PAD).zip(entered.chunks_exact(width)) {
            padded[..width].copy_from_slice(row);
        }
        let modulations = modulations.chunks_exact(2 * width);
        let layers = trunk.blocks.iter().zip(&packed.blocks);
        for (l, ((layer, packed), modulation)) in layers.zip(modulations).enumerate() {
            let tape = &mut tape.blocks[l.min(blocks - 1)];
            let (scale, offset) = modulation.split_at(width);
            let bias = &params[layer.bias.clone()];
            Arch::new().dispatch(Modulate {
                features,
                scale,
                offset,
                bias,
                tape,
            });
            let output = padded(features, rows, width);
            multiply(output, Accum::Add, &tape.activated, &packed.forward);
        }
        let outputs = (tape.activated.chunks_exact_mut(width)).zip(tape.slope.chunks_exact_mut(width));
        for (padded, (activated, slope)) in features.chunks_exact(width + PAD).zip(outputs) {
            activate(&padded[..width], activated, slope);
        }
        trunk.output.forward(params, &tape.activated, velocities);
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
            packed,
            tape,
        } = self;
        let (width, rows) = (trunk.width, points.len() / trunk.input.inputs);
        let TrunkGradient {
            params: gradient,
            modulation: d_modulation,
            points: d_points,
        } = gradient;
        let (d_shift, d_blocks) = d_modulation.split_at_mut(width);
        let d = &mut tape.features[..];
        trunk.output.backward(gradient, &tape.activated, d_velocities);
        trunk.output.backward_input(params, d_velocities, &mut tape.activated);
        multiply_by(&tape.slope, &mut tape.activated);
        let rows_of_d = d.chunks_exact_mut(width + PAD);
        for (padded, row) in rows_of_d.zip(tape.activated.chunks_exact(width)) {
            padded[..width].copy_from_slice(row);
        }

        let modulations = modulation[width..].chunks_exact(2 * width);
        let modulations = modulations.zip(d_blocks.chunks_exact_mut(2 * width));
        let layers = trunk.blocks.iter().zip(&packed.blocks).zip(&tape.blocks);
        for (((layer, packed), block), (modulation, d_modulation)) in layers.zip(modulations).rev() {
            let floats = Floats {
                numbers: d,
                columns: width,
                stride: width + PAD,
            };
            add_rows(floats, &mut gradient[layer.bias.clone()]);
            tape.d.set_left(floats);
            let output = padded(&mut tape.d_activated, rows, width);
            multiply(output, Accum::Replace, &tape.d, &packed.backward);
            tape.d_transposed.set_right_from(&tape.d, [rows, width]);
            tape.d_transposed.transpose();
            tape.entered.set_right_from(&block.activated, [rows, width]);
            add_weight_gradient(layer, gradient, &tape.d_transposed, &tape.entered);
            let (d_scale, d_offset) = d_modulation.split_at_mut(width);
            Arch::new().dispatch(ModulateBackward {
                features: d,
                activated: &tape.d_activated,
                scale: &modulation[..width],
                tape: block,
                d_scale,
                d_offset,
            });
        }
        let d = &mut tape.activated[..];
        let rows_of_d = tape.features.chunks_exact(width + PAD);
        for (row, padded) in d.chunks_exact_mut(width).zip(rows_of_d) {
            row.copy_from_slice(&padded[..width]);
        }
        sum_rows(d, d_shift);
        let Some(input) = &packed.input else {
            trunk.input.backward_weight(gradient, points, d);
            if let Some(d_points) = d_points {
                let start = d_points.len();
                d_points.resize(start + points.len(), 0.0);
                trunk.input.backward_input(params, d, &mut d_points[start..]);
            }
            return;
        };
        tape.d_transposed.set_left_transposed(Floats::dense(d, width));
        tape.entered.set_right(Floats::dense(points, trunk.input.inputs));
        add_weight_gradient(&trunk.input, gradient, &tape.d_transposed, &tape.entered);
        if let Some(d_points) = d_points {
            let start = d_points.len();
            d_points.resize(start + points.len(), 0.0);
            tape.d.set_left(Floats::dense(d, width));
            let output = Output::dense(&mut d_points[start..], trunk.input.inputs);
            multiply(output, Accum::Replace, &tape.d, &input.backward);
        }
    }
}

/// A matrix whose rows are apart by [`PAD`], to be written by a product.
fn padded(numbers: &mut [f32], rows: usize, columns: usize) -> Output<'_> {
    Output {
        numbers,
        stride: columns + PAD,
        rows,
        columns,
    }
}

/// Adds every row to `total`.
fn add_rows(floats: Floats, total: &mut [f32]) {
    Arch::new().dispatch(|| {
        for row in floats.rows() {
            total.iter_mut().zip(row).for_each(|(t, r)| *t += r);
        }
    });
}

/// `dW += dY^T X`, from `dY^T` and `X`.
fn add_weight_gradient(layer: &Dense, gradient: &mut [f32], dy_transposed: &Tiles, x: &Tiles) {
    let output = Output::dense(&mut gradient[layer.weight.clone()], layer.inputs);
    multiply(output, Accum::Add, dy_transposed, x);
}
