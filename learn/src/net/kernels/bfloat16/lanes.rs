//! Arithmetic on 32 numbers at a time: as many as a line of a tile has.

use std::f32::consts::{LN_2, LOG2_E};

use super::tile::{DEPTH, round, widen};

/// A part of a row.
pub type Part<T> = [T; DEPTH];

/// How 32 numbers are worked on.
pub trait Lanes: Copy {
    /// So many numbers, in registers.
    type Vector: Copy;

    /// The same number everywhere.
    fn splat(self, x: f32) -> Self::Vector;
    /// From memory.
    fn load(self, part: &Part<f32>) -> Self::Vector;
    /// To memory.
    fn store(self, x: Self::Vector, part: &mut Part<f32>);
    /// bfloat16 numbers from memory.
    fn widen(self, part: &Part<u16>) -> Self::Vector;
    /// Rounded to bfloat16.
    fn round(self, x: Self::Vector) -> Part<u16>;
    /// `a + b`.
    fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a b`.
    fn mul(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a b + c`.
    fn mul_add(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;
    /// `1/(1 + e^(-x))`, to about 1e-4 relative: finer than bfloat16 numbers are.
    fn sigmoid(self, x: Self::Vector) -> Self::Vector;
    /// The sum of all.
    fn total(self, x: Self::Vector) -> f32;

    /// `SiLU(x) = x sigmoid(x)` and its derivative.
    #[inline(always)]
    fn silu(self, x: Self::Vector) -> [Self::Vector; 2] {
        let sigmoid = self.sigmoid(x);
        let value = self.mul(x, sigmoid);
        let opposite = self.mul_add(sigmoid, self.splat(-1.0), self.splat(1.0));
        [value, self.mul_add(value, opposite, sigmoid)]
    }
}

/// Plain loops.
#[derive(Clone, Copy)]
pub struct Loops;

impl Lanes for Loops {
    type Vector = Part<f32>;

    #[inline(always)]
    fn splat(self, x: f32) -> Part<f32> {
        [x; DEPTH]
    }

    #[inline(always)]
    fn load(self, part: &Part<f32>) -> Part<f32> {
        *part
    }

    #[inline(always)]
    fn store(self, x: Part<f32>, part: &mut Part<f32>) {
        *part = x;
    }

    #[inline(always)]
    fn widen(self, part: &Part<u16>) -> Part<f32> {
        let mut x = [0.0; DEPTH];
        for k in 0..DEPTH {
            x[k] = widen(part[k]);
        }
        x
    }

    #[inline(always)]
    fn round(self, x: Part<f32>) -> Part<u16> {
        let mut part = [0; DEPTH];
        for k in 0..DEPTH {
            part[k] = round(x[k]);
        }
        part
    }

    #[inline(always)]
    fn add(self, mut a: Part<f32>, b: Part<f32>) -> Part<f32> {
        for k in 0..DEPTH {
            a[k] += b[k];
        }
        a
    }

    #[inline(always)]
    fn mul(self, mut a: Part<f32>, b: Part<f32>) -> Part<f32> {
        for k in 0..DEPTH {
            a[k] *= b[k];
        }
        a
    }

    #[inline(always)]
    fn mul_add(self, a: Part<f32>, b: Part<f32>, mut c: Part<f32>) -> Part<f32> {
        for k in 0..DEPTH {
            c[k] = a[k].mul_add(b[k], c[k]);
        }
        c
    }

    #[inline(always)]
    fn sigmoid(self, mut x: Part<f32>) -> Part<f32> {
        for x in &mut x {
            *x = reciprocal(1.0 + exp(-*x));
        }
        x
    }

    #[inline(always)]
    fn total(self, x: Part<f32>) -> f32 {
        x.iter().sum()
    }
}

/// `e^x`, to about 4e-6 relative for `x` in [-87, 87]; clamped to that interval.
///
/// As the floats' exponential, with a Taylor polynomial of degree 5.
#[inline(always)]
fn exp(x: f32) -> f32 {
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

/// 1.5 * 2^23: adding it leaves the nearest integer in the low bits of the mantissa.
const ROUND: f32 = 12_582_912.0;

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

#[cfg(target_arch = "x86_64")]
pub use wide::Wide;

#[cfg(target_arch = "x86_64")]
mod wide {
    use std::arch::x86_64::{__m256i, __m512, __m512i};

    use pulp::Simd;
    use pulp::x86::V4;

    use super::*;

    /// Two vectors of AVX-512, whose instructions scale by powers of two, estimate reciprocals and join halves of vectors.
    ///
    /// No closures here: their bodies may be left calls to code without these instructions.
    #[derive(Clone, Copy)]
    pub struct Wide(pub V4);

    /// Lanes of a vector.
    const LANES: usize = DEPTH / 2;

    /// Taylor coefficients of `2^f`, of degree 5 to 0.
    const POWERS: [f32; 6] = [
        1.333_355_8e-3,
        9.618_129e-3,
        5.550_411e-2,
        0.240_226_5,
        LN_2,
        1.0,
    ];

    /// The upper halves of the lanes of two vectors.
    const HALVES: Part<u16> = {
        let mut halves = [0; DEPTH];
        let mut k = 0;
        while k < DEPTH {
            halves[k] = 2 * k as u16 + 1;
            k += 1;
        }
        halves
    };

    impl Wide {
        /// `2^(-x log2 e)` scaled by its own power of two, and the processor's estimate of a reciprocal, which is to 6e-5.
        #[inline(always)]
        fn sigmoid_of_half(self, x: __m512) -> __m512 {
            let unit = self.0.avx512f;
            let (rate, round) = (unit._mm512_set1_ps(-LOG2_E), unit._mm512_set1_ps(ROUND));
            let n = unit._mm512_sub_ps(unit._mm512_fmadd_ps(x, rate, round), round);
            let f = unit._mm512_fmsub_ps(x, rate, n);
            let mut power = unit._mm512_set1_ps(POWERS[0]);
            for coefficient in &POWERS[1..] {
                power = unit._mm512_fmadd_ps(power, f, unit._mm512_set1_ps(*coefficient));
            }
            let exponential = unit._mm512_scalef_ps(power, n);
            let denominator = unit._mm512_add_ps(exponential, unit._mm512_set1_ps(1.0));
            unit._mm512_rcp14_ps(denominator)
        }

        #[inline(always)]
        fn widen_half(self, numbers: [u16; LANES]) -> __m512 {
            let half: __m256i = pulp::cast(numbers);
            let unit = self.0.avx512f;
            pulp::cast(unit._mm512_slli_epi32::<16>(unit._mm512_cvtepu16_epi32(half)))
        }
    }

    impl Lanes for Wide {
        type Vector = [__m512; 2];

        #[inline(always)]
        fn splat(self, x: f32) -> [__m512; 2] {
            [self.0.avx512f._mm512_set1_ps(x); 2]
        }

        #[inline(always)]
        fn load(self, part: &Part<f32>) -> [__m512; 2] {
            let (halves, _) = part.as_chunks::<LANES>();
            [pulp::cast(halves[0]), pulp::cast(halves[1])]
        }

        #[inline(always)]
        fn store(self, x: [__m512; 2], part: &mut Part<f32>) {
            let (halves, _) = part.as_chunks_mut::<LANES>();
            halves[0] = pulp::cast(x[0]);
            halves[1] = pulp::cast(x[1]);
        }

        #[inline(always)]
        fn widen(self, part: &Part<u16>) -> [__m512; 2] {
            let (halves, _) = part.as_chunks::<LANES>();
            [self.widen_half(halves[0]), self.widen_half(halves[1])]
        }

        #[inline(always)]
        fn round(self, x: [__m512; 2]) -> Part<u16> {
            let unit = self.0.avx512f;
            let half = unit._mm512_set1_epi32(0x8000);
            let low = unit._mm512_add_epi32(pulp::cast(x[0]), half);
            let high = unit._mm512_add_epi32(pulp::cast(x[1]), half);
            let halves: __m512i = pulp::cast(HALVES);
            pulp::cast(self.0.avx512bw._mm512_permutex2var_epi16(low, halves, high))
        }

        #[inline(always)]
        fn add(self, a: [__m512; 2], b: [__m512; 2]) -> [__m512; 2] {
            let unit = self.0.avx512f;
            [
                unit._mm512_add_ps(a[0], b[0]),
                unit._mm512_add_ps(a[1], b[1]),
            ]
        }

        #[inline(always)]
        fn mul(self, a: [__m512; 2], b: [__m512; 2]) -> [__m512; 2] {
            let unit = self.0.avx512f;
            [
                unit._mm512_mul_ps(a[0], b[0]),
                unit._mm512_mul_ps(a[1], b[1]),
            ]
        }

        #[inline(always)]
        fn mul_add(self, a: [__m512; 2], b: [__m512; 2], c: [__m512; 2]) -> [__m512; 2] {
            let unit = self.0.avx512f;
            [
                unit._mm512_fmadd_ps(a[0], b[0], c[0]),
                unit._mm512_fmadd_ps(a[1], b[1], c[1]),
            ]
        }

        #[inline(always)]
        fn sigmoid(self, x: [__m512; 2]) -> [__m512; 2] {
            [self.sigmoid_of_half(x[0]), self.sigmoid_of_half(x[1])]
        }

        #[inline(always)]
        fn total(self, x: [__m512; 2]) -> f32 {
            let sum = self.0.avx512f._mm512_add_ps(x[0], x[1]);
            self.0.reduce_sum_f32s(pulp::cast(sum))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(f: impl Fn(f32) -> f32) -> Part<f32> {
        std::array::from_fn(|k| f(k as f32))
    }

    /// What every kind of lanes must do.
    fn assert_computes(lanes: impl Lanes) {
        let stored = |x| {
            let mut part = [0.0; DEPTH];
            lanes.store(x, &mut part);
            part
        };
        let (a, b) = (numbers(|k| k - 7.0), numbers(|k| 0.5 * k));
        let (x, y) = (lanes.load(&a), lanes.load(&b));
        assert_eq!(stored(lanes.add(x, y)), numbers(|k| 1.5 * k - 7.0));
        assert_eq!(stored(lanes.mul(x, y)), numbers(|k| (k - 7.0) * 0.5 * k));
        let sum = lanes.mul_add(x, y, lanes.splat(3.0));
        assert_eq!(stored(sum), numbers(|k| (k - 7.0) * 0.5 * k + 3.0));
        assert_eq!(lanes.total(x), a.iter().sum::<f32>());
        assert_eq!(
            stored(lanes.widen(&lanes.round(x))),
            a,
            "bfloat16 holds them"
        );
        let rounded = lanes.round(lanes.splat(1.0 + 1.0 / 200.0));
        assert_eq!(stored(lanes.widen(&rounded)), [1.0 + 1.0 / 128.0; DEPTH]);
    }

    /// SiLU and its slope of 640 arguments in [-100, 100], beside the exact ones.
    fn assert_activates(lanes: impl Lanes) {
        let near = |found: f32, exact: f64, x: f64| {
            let error = (f64::from(found) - exact).abs();
            assert!(
                error <= 1e-3 * exact.abs() + 1e-6,
                "{found} for {exact} at {x}"
            );
        };
        for part in 0..20 {
            let x = numbers(|k| ((part * DEPTH) as f32 + k) / 3.2 - 100.0);
            let [value, slope] = lanes.silu(lanes.load(&x));
            let (mut values, mut slopes) = ([0.0; DEPTH], [0.0; DEPTH]);
            lanes.store(value, &mut values);
            lanes.store(slope, &mut slopes);
            for k in 0..DEPTH {
                let x = f64::from(x[k]);
                let sigmoid = 1.0 / (1.0 + (-x).exp());
                near(values[k], x * sigmoid, x);
                near(slopes[k], sigmoid * (1.0 + x * (1.0 - sigmoid)), x);
            }
        }
        let nan = lanes.silu(lanes.splat(f32::NAN));
        assert!(lanes.total(nan[0]).is_nan(), "a NaN stays one");
    }

    #[test]
    fn loops_compute_and_activate() {
        assert_computes(Loops);
        assert_activates(Loops);
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn wide_vectors_compute_and_activate_where_there_are_some() {
        if let Some(simd) = pulp::x86::V4::try_new() {
            assert_computes(Wide(simd));
            assert_activates(Wide(simd));
        }
    }
}
