//! What numbers the networks' products are of.

use serde::{Deserialize, Serialize};

use crate::net::kernels::bfloat16::{DEPTH, is_faster};
use crate::net::mlp::ShapeError;

/// Numbers that the products of a network's layers on points and voxels are of; sums, norms, weights and gradients are
/// floats (f32) in either.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Floats of 32 bits.
    #[default]
    Float32,
    /// Operands rounded to bfloat16: floats with a mantissa of 8 bits. Many times faster on a processor with a matrix unit
    /// (Intel's AMX), faster on AMD's with AVX-512 BF16 (Zen 4 and later), slower on others. The layers on points must have
    /// a multiple of 32 features.
    Bfloat16,
}

impl Precision {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Float32, Self::Bfloat16];

    /// The faster one on this machine for layers of `width` features.
    pub fn fastest(width: usize) -> Self {
        if is_faster() && Self::Bfloat16.check(width).is_ok() {
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

    /// Refuses layers of `width` features that it cannot take.
    pub fn check(self, width: usize) -> Result<(), ShapeError> {
        match self {
            Self::Bfloat16 if !width.is_multiple_of(DEPTH) => Err(ShapeError::Precision { width }),
            _ => Ok(()),
        }
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Float32 => "float32",
            Self::Bfloat16 => "bfloat16",
        }
    }
}
