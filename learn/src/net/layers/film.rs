//! LayerNorm under FiLM, and SiLU: what a residual block does to the features of each point before its product.

use pulp::{Simd, WithSimd};

use crate::net::kernels::float32::{dot, silu, sum};

/// PyTorch's default epsilon of LayerNorm and GroupNorm.
pub const EPSILON: f32 = 1e-5;

/// What a block's backward pass needs of its forward pass, one row per point of a tile of `T`.
#[derive(Debug)]
pub struct BlockTape {
    /// LayerNorm's output before any affine map, `(T, H)`.
    pub normalised: Vec<f32>,
    /// Reciprocal standard deviation of every row, `(T)`.
    pub inverse_deviation: Vec<f32>,
    /// SiLU of the modulated features, `(T, H)`.
    pub activated: Vec<f32>,
    /// SiLU's derivative there, `(T, H)`.
    pub slope: Vec<f32>,
}

impl BlockTape {
    /// Buffers for `rows` points of `width` features.
    pub fn new(rows: usize, width: usize) -> Self {
        Self {
            normalised: vec![0.0; rows * width],
            inverse_deviation: vec![0.0; rows],
            activated: vec![0.0; rows * width],
            slope: vec![0.0; rows * width],
        }
    }
}

/// LayerNorm, modulation and activation of the rows of `features` `h`: `m = scale * LN(h) + offset`, `s = SiLU(m)`.
///
/// Leaves `s` in the tape and `m + bias` in `features`, ready to take the product of the block's weight with `s`.
pub struct Modulate<'a> {
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
        let width = self.scale.len();
        let tape = self.tape;
        let rows = self
            .features
            .chunks_exact_mut(width)
            .zip(&mut tape.inverse_deviation)
            .zip(tape.normalised.chunks_exact_mut(width));
        let outputs = tape
            .activated
            .chunks_exact_mut(width)
            .zip(tape.slope.chunks_exact_mut(width));
        for (((features, inverse_deviation), normalised), (activated, slope)) in rows.zip(outputs) {
            *inverse_deviation = normalise_row(simd, features, normalised);
            modulate_row(normalised, self.scale, self.offset, features);
            activate_row(features, activated, slope);
            features
                .iter_mut()
                .zip(self.bias)
                .for_each(|(h, b)| *h += b);
        }
    }
}

/// Backward pass of [`Modulate`].
///
/// `features` holds the gradient by `m + bias` and returns the gradient by `h`; `activated` is the gradient by `s`.
/// The gradients by scale and offset are added, summed over the rows, to `d_scale` and `d_offset`.
pub struct ModulateBackward<'a> {
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
        let gradients = self
            .features
            .chunks_exact_mut(width)
            .zip(self.activated.chunks_exact(width));
        let rows = tape
            .inverse_deviation
            .iter()
            .zip(tape.normalised.chunks_exact(width))
            .zip(tape.slope.chunks_exact(width));
        for ((d, d_activated), ((inverse_deviation, normalised), slope)) in gradients.zip(rows) {
            activate_row_backward(d, d_activated, slope);
            modulate_row_backward(d, normalised, self.scale, self.d_scale, self.d_offset);
            normalise_row_backward(simd, d, normalised, *inverse_deviation);
        }
    }
}

/// `(h - mean) / deviation` into `normalised`; returns the reciprocal deviation. `h` returns centred.
#[inline(always)]
fn normalise_row<S: Simd>(simd: S, h: &mut [f32], normalised: &mut [f32]) -> f32 {
    let mean = sum(simd, h) / h.len() as f32;
    h.iter_mut().for_each(|h| *h -= mean);
    let variance = dot(simd, h, h) / h.len() as f32;
    let inverse_deviation = 1.0 / (variance + EPSILON).sqrt();
    for (x, h) in normalised.iter_mut().zip(h) {
        *x = *h * inverse_deviation;
    }
    inverse_deviation
}

/// Gradient by LayerNorm's input, `(d - mean(d) - x mean(d x)) / deviation`, in place of the gradient by its output `x`.
#[inline(always)]
fn normalise_row_backward<S: Simd>(
    simd: S,
    d: &mut [f32],
    normalised: &[f32],
    inverse_deviation: f32,
) {
    let mean = sum(simd, d) / d.len() as f32;
    let slant = dot(simd, d, normalised) / d.len() as f32;
    for (d, x) in d.iter_mut().zip(normalised) {
        *d = (*d - mean - x * slant) * inverse_deviation;
    }
}

/// `m = scale * x + offset`.
#[inline(always)]
fn modulate_row(x: &[f32], scale: &[f32], offset: &[f32], m: &mut [f32]) {
    let (x, scale, offset) = (&x[..m.len()], &scale[..m.len()], &offset[..m.len()]);
    for k in 0..m.len() {
        m[k] = x[k].mul_add(scale[k], offset[k]);
    }
}

/// Gradient by `x` in place of the gradient by `m`; adds those by scale and offset.
#[inline(always)]
fn modulate_row_backward(
    d: &mut [f32],
    x: &[f32],
    scale: &[f32],
    d_scale: &mut [f32],
    d_offset: &mut [f32],
) {
    let width = d.len();
    let (x, scale) = (&x[..width], &scale[..width]);
    let (d_scale, d_offset) = (&mut d_scale[..width], &mut d_offset[..width]);
    for k in 0..width {
        d_scale[k] = d[k].mul_add(x[k], d_scale[k]);
        d_offset[k] += d[k];
        d[k] *= scale[k];
    }
}

/// `s = SiLU(m)` and its derivative.
#[inline(always)]
fn activate_row(m: &[f32], activated: &mut [f32], slope: &mut [f32]) {
    let (activated, slope) = (&mut activated[..m.len()], &mut slope[..m.len()]);
    for k in 0..m.len() {
        (activated[k], slope[k]) = silu(m[k]);
    }
}

/// Adds the gradient by `m` that comes through `s` to `d`.
#[inline(always)]
fn activate_row_backward(d: &mut [f32], d_activated: &[f32], slope: &[f32]) {
    let (d_activated, slope) = (&d_activated[..d.len()], &slope[..d.len()]);
    for k in 0..d.len() {
        d[k] = d_activated[k].mul_add(slope[k], d[k]);
    }
}
