//! Numbers of several pixels at once.

use std::ops::{Add, Div, Mul, Neg, Sub};

use pulp::Simd;

/// A number of each of several pixels, in the lanes of a vector register; of one with `pulp::Scalar`.
/// The same operations in the same order on every machine, so results do not depend on it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lanes<S: Simd> {
    simd: S,
    pub numbers: S::f64s,
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub fn new(simd: S, numbers: S::f64s) -> Self {
        Self { simd, numbers }
    }

    #[inline(always)]
    pub fn splat(simd: S, x: f64) -> Self {
        Self::new(simd, simd.splat_f64s(x))
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self::new(self.simd, self.simd.sqrt_f64s(self.numbers))
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        Self::new(self.simd, self.simd.abs_f64s(self.numbers))
    }

    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        Self::new(self.simd, self.simd.max_f64s(self.numbers, other.numbers))
    }

    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        Self::new(self.simd, self.simd.min_f64s(self.numbers, other.numbers))
    }

    /// Where these are less than the others.
    #[inline(always)]
    pub fn less(self, other: Self) -> Mask<S> {
        let lanes = self.simd.less_than_f64s(self.numbers, other.numbers);
        Mask {
            simd: self.simd,
            lanes,
        }
    }

    /// Where these are at most the others.
    #[inline(always)]
    pub fn at_most(self, other: Self) -> Mask<S> {
        let lanes = (self.simd).less_than_or_equal_f64s(self.numbers, other.numbers);
        Mask {
            simd: self.simd,
            lanes,
        }
    }
}

/// Some of the pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mask<S: Simd> {
    simd: S,
    pub lanes: S::m64s,
}

impl<S: Simd> Mask<S> {
    #[inline(always)]
    pub fn and(self, other: Self) -> Self {
        Self {
            simd: self.simd,
            lanes: self.simd.and_m64s(self.lanes, other.lanes),
        }
    }

    /// One number in the mask, the other outside.
    #[inline(always)]
    pub fn select(self, inside: Lanes<S>, outside: Lanes<S>) -> Lanes<S> {
        let numbers = (self.simd).select_f64s(self.lanes, inside.numbers, outside.numbers);
        Lanes::new(self.simd, numbers)
    }
}

macro_rules! operator {
    ($operator:ident, $name:ident, $method:ident) => {
        impl<S: Simd> $operator for Lanes<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self::new(self.simd, self.simd.$method(self.numbers, other.numbers))
            }
        }

        impl<S: Simd> $operator<f64> for Lanes<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: f64) -> Self {
                self.$name(Self::splat(self.simd, other))
            }
        }
    };
}

operator!(Add, add, add_f64s);
operator!(Sub, sub, sub_f64s);
operator!(Mul, mul, mul_f64s);
operator!(Div, div, div_f64s);

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self::new(self.simd, self.simd.neg_f64s(self.numbers))
    }
}
