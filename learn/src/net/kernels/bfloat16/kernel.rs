//! Element-wise loops over rows, compiled for the widest vectors that the machine has.

#[cfg(target_arch = "x86_64")]
use pulp::NullaryFnOnce;
#[cfg(target_arch = "x86_64")]
use pulp::x86::V4;
use pulp::{Arch, Simd, WithSimd};

#[cfg(target_arch = "x86_64")]
use super::lanes::Wide;
use super::lanes::{Lanes, Loops, Part};

/// A loop over rows.
pub trait Kernel: Sized {
    /// Runs with the given vectors, and on parts with the given lanes.
    fn run_with<S: Simd>(self, simd: S, lanes: impl Lanes);

    /// Runs on the widest vectors that the machine has.
    fn run(self) {
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = V4::try_new() {
            return simd.vectorize(OnWide(self, simd));
        }
        Arch::new().dispatch(OnLoops(self));
    }
}

#[cfg(target_arch = "x86_64")]
struct OnWide<K>(K, V4);

#[cfg(target_arch = "x86_64")]
impl<K: Kernel> NullaryFnOnce for OnWide<K> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self(kernel, simd) = self;
        kernel.run_with(simd, Wide(simd));
    }
}

struct OnLoops<K>(K);

impl<K: Kernel> WithSimd for OnLoops<K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.0.run_with(simd, Loops);
    }
}

/// The parts of a row.
#[inline(always)]
pub fn parts<T>(row: &[T]) -> &[Part<T>] {
    row.as_chunks().0
}

/// The parts of a row.
#[inline(always)]
pub fn parts_mut<T>(row: &mut [T]) -> &mut [Part<T>] {
    row.as_chunks_mut().0
}
