//! Shape of the network and the table of its tensors.

use std::ops::Range;

use serde::{Deserialize, Serialize};

/// Spatial dimension of a point.
pub const DIM: usize = 3;

/// Shape of an MLP velocity network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MlpShape {
    /// Hidden features per point `H`.
    pub width: usize,
    /// Layers as the paper counts them: the input layer and `depth - 1` residual blocks.
    pub depth: usize,
    /// Features of the time and condition embedding `E`; even, half cosines and half sines.
    pub embedding: usize,
    /// Condition dimension `D`.
    pub condition_dim: usize,
}

/// A [`MlpShape`] of which no network can be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShapeError {
    /// A size is outside what the network can be built with.
    #[error("network {field} is {found}, expected {expected}")]
    Size {
        /// Field of [`MlpShape`].
        field: &'static str,
        /// Its value.
        found: usize,
        /// What would be right.
        expected: &'static str,
    },
    /// A parameter vector of another length than the shape's.
    #[error("{found} parameters do not fit a network of {expected}")]
    ParameterCount {
        /// Length given.
        found: usize,
        /// Length expected.
        expected: usize,
    },
}

/// A named tensor and where it lies in the flat parameter vector, row-major.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorSpec {
    /// Name, as PyTorch would call it (`blocks.0.linear.weight`).
    pub name: String,
    /// Dimensions; a dense layer's weight is `(outputs, inputs)`.
    pub shape: Vec<usize>,
    /// Position in the flat vector.
    pub range: Range<usize>,
}

impl MlpShape {
    /// Number of residual blocks `L`.
    pub fn blocks(&self) -> usize {
        self.depth - 1
    }

    /// Refuses sizes of which no network can be made.
    ///
    /// The upper bounds are far above any useful network; they keep a damaged file from asking for the machine's memory.
    pub fn check(&self) -> Result<(), ShapeError> {
        let size = |field, found, accepted, expected| {
            if accepted {
                Ok(())
            } else {
                Err(ShapeError::Size {
                    field,
                    found,
                    expected,
                })
            }
        };
        let Self {
            width,
            depth,
            embedding,
            condition_dim,
        } = *self;
        size("width", width, (1..=8192).contains(&width), "1 to 8192")?;
        size("depth", depth, (1..=64).contains(&depth), "1 to 64")?;
        let even = embedding.is_multiple_of(2) && (2..=8192).contains(&embedding);
        size("embedding", embedding, even, "an even number, 2 to 8192")?;
        size(
            "condition_dim",
            condition_dim,
            (1..=4096).contains(&condition_dim),
            "1 to 4096",
        )
    }

    /// Length of a cloud's modulation vector: the input layer's shift `(H)`, then scale `(H)` and offset `(H)` per block.
    pub(super) fn modulation_len(&self) -> usize {
        self.width * (1 + 2 * self.blocks())
    }

    /// Length of the flat parameter vector.
    pub fn parameter_count(&self) -> usize {
        self.tensors().last().map_or(0, |tensor| tensor.range.end)
    }

    /// Position of the tensor `name` in the flat parameter vector.
    pub(super) fn tensor_range(&self, name: &str) -> Range<usize> {
        let tensor = self
            .tensors()
            .into_iter()
            .find(|tensor| tensor.name == name);
        tensor.expect("the network asks for its own tensors").range
    }

    /// The tensors in the order in which the flat parameter vector holds them.
    ///
    /// The input layer of `[x | e]` is stored as its two shares, `input.weight` `(H, 3)` of the point and `shift.weight`
    /// `(H, E)` of the embedding, which also has the bias; `film` yields gamma (rows `0..H`) and beta (rows `H..2H`).
    /// What is evaluated once per cloud comes first, what is evaluated at every point last.
    pub fn tensors(&self) -> Vec<TensorSpec> {
        let Self {
            width: h,
            embedding: e,
            condition_dim: d,
            ..
        } = *self;
        let blocks = 0..self.blocks();
        let mut table = Table::default();
        table.push("time.weight", &[e, e]);
        table.push("time.bias", &[e]);
        table.push("condition.weight", &[e, d]);
        table.push("condition.bias", &[e]);
        table.push("shift.weight", &[h, e]);
        blocks
            .clone()
            .for_each(|l| table.push(format!("blocks.{l}.film.weight"), &[2 * h, e]));
        table.push("shift.bias", &[h]);
        blocks
            .clone()
            .for_each(|l| table.push(format!("blocks.{l}.film.bias"), &[2 * h]));
        for l in blocks.clone() {
            table.push(format!("blocks.{l}.norm.weight"), &[h]);
            table.push(format!("blocks.{l}.norm.bias"), &[h]);
        }
        table.push("input.weight", &[h, DIM]);
        for l in blocks {
            table.push(format!("blocks.{l}.linear.weight"), &[h, h]);
            table.push(format!("blocks.{l}.linear.bias"), &[h]);
        }
        table.push("output.weight", &[DIM, h]);
        table.push("output.bias", &[DIM]);
        table.tensors
    }
}

#[derive(Default)]
struct Table {
    tensors: Vec<TensorSpec>,
}

impl Table {
    fn push(&mut self, name: impl Into<String>, shape: &[usize]) {
        let start = self.tensors.last().map_or(0, |tensor| tensor.range.end);
        let range = start..start + shape.iter().product::<usize>();
        self.tensors.push(TensorSpec {
            name: name.into(),
            shape: shape.to_vec(),
            range,
        });
    }
}
