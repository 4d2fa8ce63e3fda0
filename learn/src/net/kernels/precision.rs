//! The operand type of the networks' products.

use serde::{Deserialize, Serialize};

use super::bfloat16::{DEPTH, is_faster};

/// Operand type of the products in the layers on points and voxels. Sums, norms, weights and gradients are 32-bit floats in
/// either.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Precision {
    /// 32-bit floats.
    #[default]
    Float32,
    /// Operands rounded to bfloat16: floats with a mantissa of 8 bits. Many times faster on a processor with a matrix unit
    /// (Intel's AMX), faster on AMD's with AVX-512 BF16 (Zen 4 and later), slower on others. The width of the layers on
    /// points must be a multiple of 32.
    Bfloat16,
}

impl Precision {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Float32, Self::Bfloat16];

    /// The faster one on this machine for layers of `width` features.
    pub fn fastest(width: usize) -> Self {
        if is_faster() && Self::Bfloat16.suits(width) {
            Self::Bfloat16
        } else {
            Self::Float32
        }
    }

    /// The one of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|precision| precision.name() == name)
    }

    /// Whether layers on points may have `width` features.
    pub(in crate::net) fn suits(self, width: usize) -> bool {
        self == Self::Float32 || width.is_multiple_of(DEPTH)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Float32 => "float32",
            Self::Bfloat16 => "bfloat16",
        }
    }
}
