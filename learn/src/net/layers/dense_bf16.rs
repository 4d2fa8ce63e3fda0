//! Dense layers with bfloat16 weights.

use super::dense::Dense;
use super::pass::Passes;
use crate::net::kernels::bfloat16::{Floats, Tiles};

/// A dense layer's weight `W` `(outputs, inputs)` as its passes take it.
#[derive(Clone, Debug, Default)]
pub struct PackedWeight {
    /// The right matrix `W^T`, for `Y = X W^T`.
    pub forward: Tiles,
    /// The right matrix `W`, for `dX = dY W`.
    pub backward: Tiles,
}

impl PackedWeight {
    /// Packs the weight of `layer`.
    pub fn set(&mut self, layer: &Dense, params: &[f32], passes: Passes) {
        let weight = Floats::dense(&params[layer.weight.clone()], layer.inputs);
        self.forward.set_right_transposed(weight);
        if passes == Passes::Training {
            self.backward.set_right(weight);
        }
    }
}
