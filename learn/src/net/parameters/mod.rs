//! What a network's parameters are: one flat vector, and the table of its tensors.
//!
//! Every layer is *declared* in a [`Table`]: it adds its tensors by name and shape and remembers where they lie. The order of
//! declaration is the order in the vector, in files and in the draw of initial values. A shape whose tensors cannot be laid
//! out is refused with a [`NetworkShapeError`].

mod error;
mod table;

use super::kernels::Precision;

pub use error::{
    MAX_VOXEL_NUMBERS, NetworkShapeError, require_finite, require_parameters, require_precision,
    require_size,
};
pub use table::{Initial, InitialWeights, Table, TensorRole, TensorSpec, fan_in};

/// The parameters of a network, and the operand type of its products.
#[derive(Clone, Copy, Debug)]
pub struct Parameters<'a> {
    /// In the order of the table.
    pub values: &'a [f32],
    pub precision: Precision,
}
