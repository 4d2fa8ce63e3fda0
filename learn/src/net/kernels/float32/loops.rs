//! Element-wise loops over rows of features, compiled for the widest vector unit that the machine has.
//!
//! Matrices are row-major, one row of features per point (or per cloud). The loops are plain; `pulp` dispatches to a
//! copy compiled for AVX-512, AVX2 or the baseline, whichever the processor has. Loops with reductions take the
//! vector type explicitly, because a compiler may not reorder a floating-point sum.

use std::f32::consts::LOG2_E;

use pulp::{Arch, Simd};

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
pub(in crate::net) use vectorised;

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

/// Makes `buffer` `len` zeros.
pub fn reset(buffer: &mut Vec<f32>, len: usize) {
    buffer.clear();
    buffer.resize(len, 0.0);
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
