//! LayerNorm under FiLM, and SiLU, between bfloat16 products: what the backward pass needs is kept in bfloat16.
//!
//! Rows of floats may have a stride above their width; all have a whole number of [`Part`]s.

use pulp::Simd;

use super::film::EPSILON;
use super::pass::Keep;
use crate::net::kernels::bfloat16::{Kernel, Lanes, Part, Tiles, parts, parts_mut};

/// What a block's backward pass needs of its forward pass, one row per point of a tile of points.
#[derive(Debug, Default)]
pub struct BlockTape {
    /// LayerNorm's output before any affine map, `(T, H)`.
    pub normalised: Vec<u16>,
    /// Reciprocal standard deviation of every row, `(T)`.
    pub inverse_deviation: Vec<f32>,
    /// SiLU of the modulated features, a left matrix `(T, H)`.
    pub activated: Tiles,
    /// SiLU's derivative there, `(T, H)`.
    pub slope: Vec<u16>,
}

impl BlockTape {
    /// Resizes the buffers for `rows` points of `width` features.
    pub fn resize(&mut self, rows: usize, width: usize) {
        self.normalised.resize(rows * width, 0);
        self.inverse_deviation.resize(rows, 0.0);
        self.activated.resize(rows, width);
        self.slope.resize(rows * width, 0);
    }
}

/// [`Modulate`](super::film::Modulate).
pub struct Modulate<'a> {
    pub features: &'a mut [f32],
    pub scale: &'a [f32],
    pub offset: &'a [f32],
    pub bias: &'a [f32],
    pub keep: Keep,
    pub tape: &'a mut BlockTape,
}

impl Kernel for Modulate<'_> {
    #[inline(always)]
    fn run_with<S: Simd>(self, simd: S, lanes: impl Lanes) {
        let tape = self.tape;
        let (width, rows) = (self.scale.len(), tape.inverse_deviation.len());
        let stride = self.features.len() / rows;
        for row in 0..rows {
            let features = &mut self.features[row * stride..][..width];
            let [sum, squares] = moments(simd, features);
            let mean = sum / width as f32;
            let variance = mean.mul_add(-mean, squares / width as f32).max(0.0);
            let inverse_deviation = 1.0 / (variance + EPSILON).sqrt();
            tape.inverse_deviation[row] = inverse_deviation;
            let affine = [inverse_deviation, -mean * inverse_deviation];
            let features = parts_mut(features);
            let activated = tape.activated.row_mut(row);
            let kept = row * width..(row + 1) * width;
            let maps = [self.scale, self.offset, self.bias];
            match self.keep {
                Keep::EveryBlock => {
                    let kept = [&mut tape.normalised[kept.clone()], &mut tape.slope[kept]];
                    modulate_and_keep(lanes, affine, maps, features, kept, activated);
                }
                Keep::Nothing => modulate(lanes, affine, maps, features, activated),
            }
        }
    }
}

/// A row's features `h` become `m + bias` with `m = scale x + offset` and `x = affine[0] h + affine[1]`; returns `x` and
/// `m`.
#[inline(always)]
fn modulate_part<L: Lanes>(
    lanes: L,
    [factor, shift]: [L::Vector; 2],
    [scale, offset, bias]: [&Part<f32>; 3],
    features: &mut Part<f32>,
) -> [L::Vector; 2] {
    let x = lanes.mul_add(lanes.load(features), factor, shift);
    let m = lanes.mul_add(x, lanes.load(scale), lanes.load(offset));
    lanes.store(lanes.add(m, lanes.load(bias)), features);
    [x, m]
}

/// One row.
#[inline(always)]
fn modulate<'a>(
    lanes: impl Lanes,
    affine: [f32; 2],
    [scale, offset, bias]: [&[f32]; 3],
    features: &mut [Part<f32>],
    activated: impl Iterator<Item = &'a mut Part<u16>>,
) {
    let affine = [lanes.splat(affine[0]), lanes.splat(affine[1])];
    let maps = parts(scale).iter().zip(parts(offset)).zip(parts(bias));
    for ((features, activated), ((scale, offset), bias)) in
        features.iter_mut().zip(activated).zip(maps)
    {
        let [_, m] = modulate_part(lanes, affine, [scale, offset, bias], features);
        *activated = lanes.round(lanes.mul(m, lanes.sigmoid(m)));
    }
}

/// The same, with the normalised features and SiLU's slope.
#[inline(always)]
fn modulate_and_keep<'a>(
    lanes: impl Lanes,
    affine: [f32; 2],
    [scale, offset, bias]: [&[f32]; 3],
    features: &mut [Part<f32>],
    [normalised, slope]: [&mut [u16]; 2],
    activated: impl Iterator<Item = &'a mut Part<u16>>,
) {
    let affine = [lanes.splat(affine[0]), lanes.splat(affine[1])];
    let maps = parts(scale).iter().zip(parts(offset)).zip(parts(bias));
    let kept = parts_mut(normalised).iter_mut().zip(parts_mut(slope));
    for (((features, activated), (normalised, slope)), ((scale, offset), bias)) in
        features.iter_mut().zip(activated).zip(kept).zip(maps)
    {
        let [x, m] = modulate_part(lanes, affine, [scale, offset, bias], features);
        let [value, derivative] = lanes.silu(m);
        *activated = lanes.round(value);
        *normalised = lanes.round(x);
        *slope = lanes.round(derivative);
    }
}

/// Sum of a row's elements, and of their squares.
#[inline(always)]
fn moments<S: Simd>(simd: S, x: &[f32]) -> [f32; 2] {
    /// Sums side by side: one alone would wait for its last addition.
    const CHAINS: usize = 4;
    let (x, rest) = S::as_simd_f32s(x);
    let (parts, last) = x.as_chunks::<CHAINS>();
    let zero = simd.splat_f32s(0.0);
    let (mut sums, mut squares) = ([zero; CHAINS], [zero; CHAINS]);
    let mut add = |k: usize, x| {
        sums[k] = simd.add_f32s(sums[k], x);
        squares[k] = simd.mul_add_f32s(x, x, squares[k]);
    };
    for part in parts {
        for (k, x) in part.iter().enumerate() {
            add(k, *x);
        }
    }
    last.iter().enumerate().for_each(|(k, x)| add(k, *x));
    let total = |[a, b, c, d]: [S::f32s; CHAINS]| {
        simd.reduce_sum_f32s(simd.add_f32s(simd.add_f32s(a, b), simd.add_f32s(c, d)))
    };
    let squares_of_rest: f32 = rest.iter().map(|x| x * x).sum();
    [
        total(sums) + rest.iter().sum::<f32>(),
        total(squares) + squares_of_rest,
    ]
}

/// [`ModulateBackward`](super::film::ModulateBackward), with the gradient by the features also
/// rounded, as a left matrix, and summed over the rows.
pub struct ModulateBackward<'a> {
    pub features: &'a mut [f32],
    pub activated: &'a [f32],
    pub scale: &'a [f32],
    pub tape: &'a BlockTape,
    pub d_scale: &'a mut [f32],
    pub d_offset: &'a mut [f32],
    pub rounded: &'a mut Tiles,
    pub sum: &'a mut [f32],
}

impl Kernel for ModulateBackward<'_> {
    #[inline(always)]
    fn run_with<S: Simd>(self, _: S, lanes: impl Lanes) {
        let tape = self.tape;
        let (width, rows) = (self.scale.len(), tape.inverse_deviation.len());
        let stride = self.features.len() / rows;
        for row in 0..rows {
            let d = parts_mut(&mut self.features[row * stride..][..width]);
            let d_activated = parts(&self.activated[row * stride..][..width]);
            let kept = row * width..(row + 1) * width;
            let normalised = parts(&tape.normalised[kept.clone()]);
            let slope = parts(&tape.slope[kept]);

            // Gradient by the normalised features x, its sum, and its scalar product with x; gradients by scale and offset.
            let (mut sum, mut slant) = (lanes.splat(0.0), lanes.splat(0.0));
            let inputs = d_activated.iter().zip(parts(self.scale));
            let inputs = inputs.zip(normalised.iter().zip(slope));
            let d_maps = parts_mut(self.d_scale)
                .iter_mut()
                .zip(parts_mut(self.d_offset));
            for ((d, ((d_activated, scale), (normalised, slope))), (d_scale, d_offset)) in
                d.iter_mut().zip(inputs).zip(d_maps)
            {
                let x = lanes.widen(normalised);
                let by_s = lanes.load(d_activated);
                let by_m = lanes.mul_add(by_s, lanes.widen(slope), lanes.load(d));
                lanes.store(lanes.mul_add(by_m, x, lanes.load(d_scale)), d_scale);
                lanes.store(lanes.add(by_m, lanes.load(d_offset)), d_offset);
                let by_x = lanes.mul(by_m, lanes.load(scale));
                lanes.store(by_x, d);
                sum = lanes.add(sum, by_x);
                slant = lanes.mul_add(by_x, x, slant);
            }

            // Gradient by the features: `(d - mean(d) - x mean(d x)) / deviation`.
            let inverse_deviation = tape.inverse_deviation[row];
            let each = -inverse_deviation / width as f32;
            let shift = lanes.splat(lanes.total(sum) * each);
            let slant = lanes.splat(lanes.total(slant) * each);
            let factor = lanes.splat(inverse_deviation);
            let outputs = self.rounded.row_mut(row).zip(parts_mut(self.sum));
            for ((d, normalised), (rounded, sum)) in d.iter_mut().zip(normalised).zip(outputs) {
                let centred = lanes.mul_add(lanes.load(d), factor, shift);
                let by_h = lanes.mul_add(lanes.widen(normalised), slant, centred);
                lanes.store(by_h, d);
                lanes.store(lanes.add(by_h, lanes.load(sum)), sum);
                *rounded = lanes.round(by_h);
            }
        }
    }
}
