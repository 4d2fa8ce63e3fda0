//! The table of a network's tensors, and how their values start.

use std::ops::Range;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// A named tensor and where it lies in the flat parameter vector, row-major.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorSpec {
    /// Name, as PyTorch would call it (`blocks.0.linear.weight`).
    pub name: String,
    /// Dimensions; a dense layer's weight is `(outputs, inputs)`.
    pub shape: Vec<usize>,
    /// Position in the flat vector.
    pub range: Range<usize>,
    /// What it is for.
    pub role: TensorRole,
}

/// What a tensor is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TensorRole {
    /// Parameters that the optimiser moves.
    Learned,
    /// A running statistic of BatchNorm: followed in training, not learned.
    Statistic,
}

/// Initial values of a tensor.
#[derive(Clone, Copy, Debug)]
pub enum Initial {
    /// All the same.
    Constant(f32),
    /// Uniform in plus and minus this bound.
    Uniform(f32),
    /// Normal with mean 0 and this standard deviation.
    Normal(f32),
}

impl Initial {
    /// Initial values of the bias of a layer whose weight starts so: as the weight, but zero beside a normal one.
    pub fn of_bias(self) -> Self {
        match self {
            Self::Normal(_) => Self::Constant(0.0),
            other => other,
        }
    }
}

/// How the MLP's layers start, and those of a Hybrid's head; all other layers start as PyTorch's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InitialWeights {
    /// Layers as PyTorch's, FiLM at gamma = beta = 0, so that every block starts as a plain residual block.
    #[default]
    ZeroFilm,
    /// The authors': embeddings normal with deviation 0.02, hidden layers Kaiming normal (He et al., ICCV 2015), FiLM's weights
    /// as PyTorch's; all of these biases zero.
    Authors,
}

impl InitialWeights {
    /// Of the layers of time and condition, from `inputs` numbers.
    pub fn embedding(self, inputs: usize) -> Initial {
        match self {
            Self::ZeroFilm => fan_in(inputs),
            Self::Authors => Initial::Normal(0.02),
        }
    }

    /// Of the input layer and the blocks' layers, from `inputs` numbers.
    pub fn hidden(self, inputs: usize) -> Initial {
        match self {
            Self::ZeroFilm => fan_in(inputs),
            Self::Authors => Initial::Normal((2.0 / inputs as f32).sqrt()),
        }
    }

    /// Of the weights of FiLM, from `inputs` numbers.
    pub fn film(self, inputs: usize) -> Initial {
        match self {
            Self::ZeroFilm => Initial::Constant(0.0),
            Self::Authors => fan_in(inputs),
        }
    }
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
    /// What layers ask for how they start.
    pub initial: InitialWeights,
}

impl Table {
    /// An empty table of a network that starts so.
    pub fn starting(initial: InitialWeights) -> Self {
        Self {
            initial,
            ..Self::default()
        }
    }

    /// Length of the flat vector so far.
    pub fn len(&self) -> usize {
        self.tensors.last().map_or(0, |tensor| tensor.range.end)
    }

    /// Adds a tensor of learned parameters; returns its place.
    pub fn push(
        &mut self,
        name: impl Into<String>,
        shape: &[usize],
        initial: Initial,
    ) -> Range<usize> {
        self.push_as(TensorRole::Learned, name, shape, initial)
    }

    /// Adds a tensor; returns its place.
    pub fn push_as(
        &mut self,
        role: TensorRole,
        name: impl Into<String>,
        shape: &[usize],
        initial: Initial,
    ) -> Range<usize> {
        let range = self.len()..self.len() + shape.iter().product::<usize>();
        self.tensors.push(TensorSpec {
            name: name.into(),
            shape: shape.to_vec(),
            range: range.clone(),
            role,
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
                Initial::Normal(deviation) => values.fill_with(|| {
                    let normal: f32 = StandardNormal.sample(rng);
                    deviation * normal
                }),
            }
        }
        params
    }
}
