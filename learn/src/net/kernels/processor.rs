//! What this machine's processor offers the networks.

use pulp::{Arch, Simd, WithSimd};

use super::bfloat16::has_matrix_unit;

/// The units of this machine's processor that the networks run on, found at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Processor {
    /// 32-bit floats in a vector of the loops that were chosen: 16 with AVX-512, 8 with AVX2, 4 with NEON, 1 where they are
    /// plain loops.
    pub vector_lanes: usize,
    /// Whether bfloat16 products run on a matrix unit (Intel's AMX).
    pub matrix_unit: bool,
}

impl Processor {
    /// Those of this machine.
    pub fn detect() -> Self {
        struct Lanes;

        impl WithSimd for Lanes {
            type Output = usize;

            #[inline(always)]
            fn with_simd<S: Simd>(self, _: S) -> usize {
                S::F32_LANES
            }
        }

        Self {
            vector_lanes: Arch::new().dispatch(Lanes),
            matrix_unit: has_matrix_unit(),
        }
    }
}
