//! Element-wise loops over rows of features, compiled for the widest vector unit that the machine has.
//!
//! Matrices are row-major, one row of features per point (or per cloud). The loops are plain; `pulp` dispatches to a
//! copy compiled for AVX-512, AVX2 or the baseline, whichever the processor has. Loops with reductions take the
//! vector type explicitly, because a compiler may not reorder a floating-point sum.

use std::f32::consts::LOG2_E;

use pulp::{Arch, Simd, WithSimd};

/// A function whose loops are compiled for the widest vector unit that the machine has, and chosen at run time.
///
/// A closure handed to `pulp` may be left a call to baseline code, where every fused product is a library call; the body
/// of `with_simd` is always inlined.
macro_rules! vectorised {
    ($(#[$attribute:meta])* $visible:vis fn $name:ident($($argument:ident: $type:ty),* $(,)?) $body:block) => {
        $(#[$attribute])*
        $visible fn $name<'a>($($argument: $type),*) {
            struct Loops<'a> {
                $($argument: $type),*
            }

            impl<'a> pulp::WithSimd for Loops<'a> {
                type Output = ();

                #[inline(always)]
                fn with_simd<S: pulp::Simd>(self, _: S) {
                    let Self { $($argument),* } = self;
                    $body
                }
            }

            pulp::Arch::new().dispatch(Loops { $($argument),* });
        }
    };
}
pub use vectorised;

/// Numbers (f32) in a vector of the kernels that the machine was found to run: 16 with AVX-512, 8 with AVX2, 4 with NEON,
/// 1 where they are plain loops.
pub fn vector_lanes() -> usize {
    struct Lanes;

    impl WithSimd for Lanes {
        type Output = usize;

        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> usize {
            S::F32_LANES
        }
    }

    Arch::new().dispatch(Lanes)
}

/// PyTorch's default epsilon of LayerNorm.
pub const EPSILON: f32 = 1e-5;

/// `e^x`, to about 1e-7 relative for `x` in [-87, 87]; clamped to that interval.
///
/// `e^x = 2^n e^r` with `n = round(x / ln 2)`, `|r| <= ln 2 / 2`, and a Taylor polynomial of degree 7 for `e^r`.
#[inline(always)]
fn exp(x: f32) -> f32 {
    /// 1.5 * 2^23: adding it leaves the nearest integer in the low bits of the mantissa.
    const ROUND: f32 = 12_582_912.0;
    /// ln 2 in two parts, the first short enough for exact products with `n`.
    const LN2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    /// 1/k!, k = 7 to 0.
    const TAYLOR: [f32; 8] = [
        1.0 / 5040.0,
        1.0 / 720.0,
        1.0 / 120.0,
        1.0 / 24.0,
        1.0 / 6.0,
        0.5,
        1.0,
        1.0,
    ];
    let x = x.clamp(-87.0, 87.0);
    let shifted = x.mul_add(LOG2_E, ROUND);
    let n = shifted - ROUND;
    let r = n.mul_add(-LN2[1], n.mul_add(-LN2[0], x));
    let mut polynomial = TAYLOR[0];
    for coefficient in &TAYLOR[1..] {
        polynomial = polynomial.mul_add(r, *coefficient);
    }
    let power = (shifted.to_bits() << 23).wrapping_add(1.0f32.to_bits());
    polynomial * f32::from_bits(power)
}

/// `SiLU(x) = x sigmoid(x)` and its derivative.
#[inline(always)]
pub fn silu(x: f32) -> (f32, f32) {
    let sigmoid = 1.0 / (1.0 + exp(-x));
    let value = x * sigmoid;
    (value, sigmoid + value * (1.0 - sigmoid))
}

/// `SiLU` of every element of `x` into `value`, and its derivative into `slope`.
pub fn activate(x: &[f32], value: &mut [f32], slope: &mut [f32]) {
    let (value, slope) = (&mut value[..x.len()], &mut slope[..x.len()]);
    Arch::new().dispatch(|| {
        for k in 0..x.len() {
            (value[k], slope[k]) = silu(x[k]);
        }
    });
}

/// Sets every row of `rows` to `row`.
pub fn fill_rows(rows: &mut [f32], row: &[f32]) {
    rows.chunks_exact_mut(row.len())
        .for_each(|target| target.copy_from_slice(row));
}

/// Adds every row of `rows` to `total`: the gradient of a row that [`fill_rows`] spread.
pub fn sum_rows(rows: &[f32], total: &mut [f32]) {
    Arch::new().dispatch(|| {
        for row in rows.chunks_exact(total.len()) {
            total.iter_mut().zip(row).for_each(|(t, r)| *t += r);
        }
    });
}

/// `y += x`.
pub fn add(x: &[f32], y: &mut [f32]) {
    Arch::new().dispatch(|| y.iter_mut().zip(x).for_each(|(y, x)| *y += x));
}

/// `y *= x`, element by element.
pub fn multiply(x: &[f32], y: &mut [f32]) {
    Arch::new().dispatch(|| y.iter_mut().zip(x).for_each(|(y, x)| *y *= x));
}

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
    /// Room for `rows` points of `width` features.
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

/// Sum of a row's elements.
#[inline(always)]
pub fn sum<S: Simd>(simd: S, x: &[f32]) -> f32 {
    let (x, rest) = S::as_simd_f32s(x);
    let lanes = x
        .iter()
        .fold(simd.splat_f32s(0.0), |sums, x| simd.add_f32s(sums, *x));
    simd.reduce_sum_f32s(lanes) + rest.iter().sum::<f32>()
}

/// Scalar product of two rows.
#[inline(always)]
pub fn dot<S: Simd>(simd: S, x: &[f32], y: &[f32]) -> f32 {
    let ((x, x_rest), (y, y_rest)) = (S::as_simd_f32s(x), S::as_simd_f32s(y));
    let lanes = x.iter().zip(y).fold(simd.splat_f32s(0.0), |sums, (x, y)| {
        simd.mul_add_f32s(*x, *y, sums)
    });
    let rest: f32 = x_rest.iter().zip(y_rest).map(|(x, y)| x * y).sum();
    simd.reduce_sum_f32s(lanes) + rest
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_the_exponential_to_2e_7_relative() {
        for k in -8_700..=8_700 {
            let x = k as f32 * 0.01;
            let exact = f64::from(x).exp();
            assert!((f64::from(exp(x)) / exact - 1.0).abs() < 2e-7, "at {x}");
        }
    }

    #[test]
    fn silu_and_its_slope_are_the_closed_forms() {
        for k in -2_000..=2_000 {
            let x = k as f32 * 0.01;
            let (value, slope) = silu(x);
            let sigmoid = 1.0 / (1.0 + f64::from(-x).exp());
            let exact = f64::from(x) * sigmoid;
            assert!((f64::from(value) - exact).abs() < 1e-6 * exact.abs().max(0.1));
            assert!((f64::from(slope) - sigmoid - exact * (1.0 - sigmoid)).abs() < 1e-6);
        }
    }

    #[test]
    fn silu_passes_nan_on() {
        assert!(silu(f32::NAN).0.is_nan());
    }
}
