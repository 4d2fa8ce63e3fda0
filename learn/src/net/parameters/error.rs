//! What is wrong with the shape of a network.
//!
//! The bounds are far above any useful network; they keep a damaged file from asking for the machine's memory.

use crate::net::kernels::Precision;

/// Most parameters of a network, twelve times the paper's largest: 512 MiB, and in training, where gradient, moments and
/// average are as large, a few times that.
const MAX_PARAMETERS: usize = 1 << 27;

/// Most numbers in a stage's grid of voxels, of which training keeps several: 256 MiB.
pub const MAX_VOXEL_NUMBERS: usize = 1 << 26;

/// Why no network can be made of a shape, or of a shape and parameters.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkShapeError {
    /// A size is out of bounds.
    #[error("network {field} is {found}, expected {expected}")]
    Size {
        /// Field of the shape.
        field: &'static str,
        /// Its value.
        found: usize,
        /// What would be right.
        expected: &'static str,
    },
    /// A number is NaN or infinite.
    #[error("network {field} is {found}, expected a finite number")]
    NotFinite {
        /// Field of the shape.
        field: &'static str,
        /// Its value.
        found: f32,
    },
    /// The sizes together make a network that needs too much memory.
    #[error(
        "a network of these sizes has {found} parameters, expected at most {MAX_PARAMETERS}: choose smaller ones"
    )]
    Parameters {
        /// Their number.
        found: usize,
    },
    /// The grid of a stage needs too much memory.
    #[error(
        "a grid of {resolution} voxels per edge with {channels} channels has {found} numbers, expected at most \
         {MAX_VOXEL_NUMBERS}: choose a smaller resolution, or fewer channels"
    )]
    Grid {
        /// Voxels per edge.
        resolution: usize,
        /// Features per voxel.
        channels: usize,
        /// Numbers in the grid.
        found: usize,
    },
    /// The products in bfloat16 take features 32 at a time.
    #[error(
        "the network's width is {width}, and with bfloat16 it must be a multiple of 32: choose such a width, or float32"
    )]
    Precision {
        /// Features of the layers on points.
        width: usize,
    },
    /// A running variance is below zero.
    #[error("`{tensor}` holds the variance {found}, expected none below 0")]
    Variance {
        /// The tensor.
        tensor: String,
        /// The number in it.
        found: f32,
    },
    /// The parameter vector has another length than the shape's.
    #[error("{found} parameters do not fit a network of {expected}")]
    ParameterCount {
        /// Length given.
        found: usize,
        /// Length expected.
        expected: usize,
    },
}

/// Returns an error if a network has too many parameters.
pub fn require_parameters(found: usize) -> Result<(), NetworkShapeError> {
    match found {
        0..=MAX_PARAMETERS => Ok(()),
        _ => Err(NetworkShapeError::Parameters { found }),
    }
}

/// Returns an error unless `found` is `accepted`.
pub fn require_size(
    field: &'static str,
    found: usize,
    accepted: bool,
    expected: &'static str,
) -> Result<(), NetworkShapeError> {
    match accepted {
        true => Ok(()),
        false => Err(NetworkShapeError::Size {
            field,
            found,
            expected,
        }),
    }
}

/// Returns an error unless `found` is finite.
pub fn require_finite(field: &'static str, found: f32) -> Result<(), NetworkShapeError> {
    match found.is_finite() {
        true => Ok(()),
        false => Err(NetworkShapeError::NotFinite { field, found }),
    }
}

/// Returns an error unless layers of `width` features can have this operand type.
pub fn require_precision(precision: Precision, width: usize) -> Result<(), NetworkShapeError> {
    match precision.suits(width) {
        true => Ok(()),
        false => Err(NetworkShapeError::Precision { width }),
    }
}
