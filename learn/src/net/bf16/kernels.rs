//! Element-wise loops of the blocks, with bfloat16 numbers kept for the backward pass.

use std::f32::consts::{LN_2, LOG2_E};

use pulp::{Simd, WithSimd};

use super::super::kernels::{EPSILON, sum};
use super::tile::{DEPTH, Tiles, round, widen};

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
    /// Makes room for `rows` points of `width` features.
    pub fn resize(&mut self, rows: usize, width: usize) {
        self.normalised.resize(rows * width, 0);
        self.inverse_deviation.resize(rows, 0.0);
        self.activated.resize(rows, width);
        self.slope.resize(rows * width, 0);
    }
}

/// As the floats' [`Modulate`](super::super::kernels::Modulate).
pub struct Modulate<'a> {
    /// Rows may be apart by more than their numbers.
    pub features: &'a mut [f32],
    pub scale: &'a [f32],
    pub offset: &'a [f32],
    pub bias: &'a [f32],
    pub tape: &'a mut BlockTape,
}

impl WithSimd for Modulate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            features,
            scale,
            offset,
            bias,
            tape,
        } = self;
        let width = scale.len();
        let stride = features.len() / tape.inverse_deviation.len();
        let kept = (tape.normalised.chunks_exact_mut(width)).zip(tape.slope.chunks_exact_mut(width));
        let rows = features.chunks_exact_mut(stride).zip(&mut tape.inverse_deviation);
        for (index, ((features, inverse_deviation), (normalised, slope))) in rows.zip(kept).enumerate() {
            let features = &mut features[..width];
            let [mean, square] = moments(simd, features).map(|sum| sum / width as f32);
            let variance = mean.mul_add(-mean, square).max(0.0);
            *inverse_deviation = 1.0 / (variance + EPSILON).sqrt();
            let affine = [*inverse_deviation, -mean * *inverse_deviation];
            let (features, features_rest) = features.as_chunks_mut();
            let (scale, scale_rest) = scale.as_chunks();
            let (offset, offset_rest) = offset.as_chunks();
            let (bias, bias_rest) = bias.as_chunks();
            let (normalised, normalised_rest) = normalised.as_chunks_mut();
            let (slope, slope_rest) = slope.as_chunks_mut();
            let mut activated = tape.activated.row_mut(index);
            let affines = scale.iter().zip(offset).zip(bias);
            let outputs = features.iter_mut().zip(normalised).zip(slope);
            for (((scale, offset), bias), ((features, normalised), slope)) in affines.zip(outputs) {
                let activated = activated.next().expect("a line for every part");
                modulate(affine, [scale, offset, bias], features, normalised, slope, activated);
            }
            if let Some(activated) = activated.next() {
                let rest = features_rest.len();
                let padded = |x: &[f32]| std::array::from_fn(|k| if k < rest { x[k] } else { 0.0 });
                let mut features = padded(features_rest);
                let (mut normalised, mut slope) = ([0; DEPTH], [0; DEPTH]);
                let affines = [scale_rest, offset_rest, bias_rest].map(padded);
                modulate(affine, affines.each_ref(), &mut features, &mut normalised, &mut slope, activated);
                activated[rest..].fill(0);
                features_rest.copy_from_slice(&features[..rest]);
                normalised_rest.copy_from_slice(&normalised[..rest]);
                slope_rest.copy_from_slice(&slope[..rest]);
            }
        }
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
        for k in 0..CHAINS {
            add(k, part[k]);
        }
    }
    last.iter().enumerate().for_each(|(k, x)| add(k, *x));
    let total = |chains: [S::f32s; CHAINS]| {
        let [a, b, c, d] = chains;
        simd.reduce_sum_f32s(simd.add_f32s(simd.add_f32s(a, b), simd.add_f32s(c, d)))
    };
    let squares_of_rest: f32 = rest.iter().map(|x| x * x).sum();
    [
        total(sums) + rest.iter().sum::<f32>(),
        total(squares) + squares_of_rest,
    ]
}

/// Part of a row: features `h` become `m + bias`; `affine` makes the normalised ones of them.
#[inline(always)]
fn modulate(
    affine: [f32; 2],
    [scale, offset, bias]: [&[f32; DEPTH]; 3],
    features: &mut [f32; DEPTH],
    normalised: &mut [u16; DEPTH],
    slope: &mut [u16; DEPTH],
    activated: &mut [u16; DEPTH],
) {
    for k in 0..DEPTH {
        let x = features[k].mul_add(affine[0], affine[1]);
        let m = x.mul_add(scale[k], offset[k]);
        let (value, derivative) = silu(m);
        normalised[k] = round(x);
        activated[k] = round(value);
        slope[k] = round(derivative);
        features[k] = m + bias[k];
    }
}

/// `SiLU(x) = x sigmoid(x)` and its derivative, to about 1e-5: finer than bfloat16 numbers are, without a division.
#[inline(always)]
fn silu(x: f32) -> (f32, f32) {
    let sigmoid = reciprocal(1.0 + exp(-x));
    let value = x * sigmoid;
    (value, value.mul_add(1.0 - sigmoid, sigmoid))
}

/// `e^x`, to about 4e-6 relative for `x` in [-87, 87]; clamped to that interval.
///
/// As the floats' exponential, with a Taylor polynomial of degree 5.
#[inline(always)]
fn exp(x: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0;
    const TAYLOR: [f32; 6] = [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    let x = x.clamp(-87.0, 87.0);
    let shifted = x.mul_add(LOG2_E, ROUND);
    let r = (shifted - ROUND).mul_add(-LN_2, x);
    let mut polynomial = TAYLOR[0];
    for coefficient in &TAYLOR[1..] {
        polynomial = polynomial.mul_add(r, *coefficient);
    }
    let power = (shifted.to_bits() << 23).wrapping_add(1.0f32.to_bits());
    polynomial * f32::from_bits(power)
}

/// `1/x` for normal `x > 0`, to about 4e-6 relative: a guess from the bits, within 12 %, and a step each of third and of
/// second order.
#[inline(always)]
fn reciprocal(x: f32) -> f32 {
    let guess = f32::from_bits(0x7ef3_11c7u32.wrapping_sub(x.to_bits()));
    let error = (-x).mul_add(guess, 1.0);
    let better = guess.mul_add(error.mul_add(error, error), guess);
    let error = (-x).mul_add(better, 1.0);
    better.mul_add(error, better)
}

/// As the floats' [`ModulateBackward`](super::super::kernels::ModulateBackward).
pub struct ModulateBackward<'a> {
    /// Rows of this and of `activated` may be apart by more than their numbers.
    pub features: &'a mut [f32],
    pub activated: &'a [f32],
    pub scale: &'a [f32],
    pub tape: &'a BlockTape,
    pub d_scale: &'a mut [f32],
    pub d_offset: &'a mut [f32],
}

impl WithSimd for ModulateBackward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.scale.len();
        let tape = self.tape;
        let stride = self.features.len() / tape.inverse_deviation.len();
        let gradients = (self.features.chunks_exact_mut(stride)).zip(self.activated.chunks_exact(stride));
        let kept = (tape.normalised.chunks_exact(width)).zip(tape.slope.chunks_exact(width));
        let rows = gradients.zip(&tape.inverse_deviation).zip(kept);
        for (((d, d_activated), inverse_deviation), (normalised, slope)) in rows {
            let d = &mut d[..width];
            let sums = modulate_backward(
                simd,
                d,
                [&d_activated[..width], self.scale],
                [normalised, slope],
                [&mut *self.d_scale, &mut *self.d_offset],
            );
            let [mean, slant] = sums.map(|sum| -sum * inverse_deviation / width as f32);
            let normalised = &normalised[..d.len()];
            for k in 0..d.len() {
                let centred = d[k].mul_add(*inverse_deviation, mean);
                d[k] = widen(normalised[k]).mul_add(slant, centred);
            }
        }
    }
}

/// Numbers that a step of a loop takes: the lanes of the widest vectors.
const LANES: usize = 16;

/// A row's gradient by the normalised features in place of the one by the block's output; returns its sum and its scalar
/// product with those features.
#[inline(always)]
fn modulate_backward<S: Simd>(
    simd: S,
    d: &mut [f32],
    [d_activated, scale]: [&[f32]; 2],
    [normalised, slope]: [&[u16]; 2],
    [d_scale, d_offset]: [&mut [f32]; 2],
) -> [f32; 2] {
    let (d, d_rest) = d.as_chunks_mut::<LANES>();
    let (d_activated, d_activated_rest) = d_activated.as_chunks::<LANES>();
    let (scale, scale_rest) = scale.as_chunks::<LANES>();
    let (normalised, normalised_rest) = normalised.as_chunks::<LANES>();
    let (slope, slope_rest) = slope.as_chunks::<LANES>();
    let (d_scale, d_scale_rest) = d_scale.as_chunks_mut::<LANES>();
    let (d_offset, d_offset_rest) = d_offset.as_chunks_mut::<LANES>();
    let mut sums = [[0.0; LANES]; 2];
    let parts = d.iter_mut().zip(d_activated).zip(scale).zip(normalised).zip(slope);
    for (((((d, d_activated), scale), normalised), slope), (d_scale, d_offset)) in
        parts.zip(d_scale.iter_mut().zip(d_offset))
    {
        for k in 0..LANES {
            let x = widen(normalised[k]);
            let by_m = d_activated[k].mul_add(widen(slope[k]), d[k]);
            d_scale[k] = by_m.mul_add(x, d_scale[k]);
            d_offset[k] += by_m;
            d[k] = by_m * scale[k];
            sums[0][k] += d[k];
            sums[1][k] = d[k].mul_add(x, sums[1][k]);
        }
    }
    let [mut total, mut slant] = sums.map(|lanes| sum(simd, &lanes));
    for (k, d) in d_rest.iter_mut().enumerate() {
        let x = widen(normalised_rest[k]);
        let by_m = d_activated_rest[k].mul_add(widen(slope_rest[k]), *d);
        d_scale_rest[k] = by_m.mul_add(x, d_scale_rest[k]);
        d_offset_rest[k] += by_m;
        *d = by_m * scale_rest[k];
        total += *d;
        slant = d.mul_add(x, slant);
    }
    [total, slant]
}
