//! The table of a network's tensors, and how their values start.

use std::ops::Range;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

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

/// Initial values of a tensor.
#[derive(Clone, Copy, Debug)]
pub enum Initial {
    /// All the same.
    Constant(f32),
    /// Uniform in plus and minus this bound.
    Uniform(f32),
}

/// Initial values of a layer as PyTorch draws them: uniform in `+-1/sqrt(inputs)`.
pub fn fan_in(inputs: usize) -> Initial {
    Initial::Uniform(1.0 / (inputs as f32).sqrt())
}

/// Tensors with their places in the flat parameter vector and their initial values.
#[derive(Debug, Default)]
pub struct Table {
    pub tensors: Vec<TensorSpec>,
    initials: Vec<Initial>,
}

impl Table {
    /// Length of the flat vector so far.
    pub fn len(&self) -> usize {
        self.tensors.last().map_or(0, |tensor| tensor.range.end)
    }

    /// Adds a tensor; returns its place.
    pub fn push(
        &mut self,
        name: impl Into<String>,
        shape: &[usize],
        initial: Initial,
    ) -> Range<usize> {
        let range = self.len()..self.len() + shape.iter().product::<usize>();
        self.tensors.push(TensorSpec {
            name: name.into(),
            shape: shape.to_vec(),
            range: range.clone(),
        });
        self.initials.push(initial);
        range
    }

    /// Fresh parameters, drawn tensor by tensor.
    pub fn initial_params(&self, rng: &mut ChaCha8Rng) -> Vec<f32> {
        let mut params = vec![0.0; self.len()];
        for (tensor, initial) in self.tensors.iter().zip(&self.initials) {
            let values = &mut params[tensor.range.clone()];
            match *initial {
                Initial::Constant(value) => values.fill(value),
                Initial::Uniform(bound) => values.fill_with(|| rng.random_range(-bound..=bound)),
            }
        }
        params
    }
}
