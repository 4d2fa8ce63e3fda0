//! Shape of the network and the table of its tensors.

use std::ops::Range;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::conditioner::{Conditioner, Part};
use super::trunk::Trunk;
use crate::channels::Channels;
use crate::net::hybrid::MAX_VOXEL_NUMBERS;
use crate::net::layers::Dense;

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
    /// What points consist of; positions alone in files that do not say.
    #[serde(default)]
    pub channels: Channels,
}

/// Most parameters of a network, twelve times the paper's largest: 512 MiB, and in training, where gradient, moments and
/// average are as large, a few times that.
pub const MAX_PARAMETERS: usize = 1 << 27;

/// A shape of which no network can be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShapeError {
    /// A size is outside what the network can be built with.
    #[error("network {field} is {found}, expected {expected}")]
    Size {
        /// Field of the shape.
        field: &'static str,
        /// Its value.
        found: usize,
        /// What would be right.
        expected: &'static str,
    },
    /// The sizes together make a network larger than any machine's memory should be asked for.
    #[error(
        "a network of these sizes has {found} parameters, expected at most {MAX_PARAMETERS}: choose smaller ones"
    )]
    Parameters {
        /// Their number.
        found: usize,
    },
    /// The grid of a stage is larger than any machine's memory should be asked for.
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
    /// The time gate of a hybrid network is no function of time.
    #[error("the time gate's centre or steepness is not a finite number")]
    Gate,
    /// Products of bfloat16 numbers take features 32 at a time.
    #[error(
        "the network's width is {width}, and with bfloat16 it must be a multiple of 32: choose such a width, or float32"
    )]
    Precision {
        /// Features of the layers on points.
        width: usize,
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
        let Self {
            width,
            depth,
            embedding,
            condition_dim,
            channels: _,
        } = *self;
        require_size("width", width, (1..=8192).contains(&width), "1 to 8192")?;
        require_size("depth", depth, (1..=64).contains(&depth), "1 to 64")?;
        let even = embedding.is_multiple_of(2) && (2..=8192).contains(&embedding);
        require_size("embedding", embedding, even, "an even number, 2 to 8192")?;
        require_size(
            "condition_dim",
            condition_dim,
            (1..=4096).contains(&condition_dim),
            "1 to 4096",
        )?;
        require_parameters(self.parameter_count())
    }

    /// Length of the flat parameter vector.
    pub fn parameter_count(&self) -> usize {
        self.tensors().last().map_or(0, |tensor| tensor.range.end)
    }

    /// The tensors in the order in which the flat parameter vector holds them.
    ///
    /// The input layer of `[x | e]` is stored as its two shares, `input.weight` `(H, C)` of the point and `shift.weight`
    /// `(H, E)` of the embedding, which also has the bias; `film` yields gamma (rows `0..H`) and beta (rows `H..2H`).
    /// What is evaluated once per cloud comes first, what is evaluated at every point last.
    pub fn tensors(&self) -> Vec<TensorSpec> {
        let mut table = Table::default();
        self.declare(&mut table);
        table.tensors
    }

    /// Adds the network's tensors to `table`; returns its layers.
    pub fn declare(&self, table: &mut Table) -> (Conditioner, Trunk) {
        let (embedding, inputs) = (self.embedding, self.channels.count());
        let shift = Part::new("shift", self.width, fan_in(inputs + embedding));
        let conditioner = Conditioner::declare(
            table,
            [embedding, self.condition_dim],
            &[shift],
            &self.films(""),
        );
        (conditioner, self.declare_trunk(table, "", inputs))
    }

    /// The blocks that FiLM modulates, their names after `prefix`, with their features.
    pub fn films(&self, prefix: &str) -> Vec<(String, usize)> {
        (0..self.blocks())
            .map(|l| (format!("{prefix}blocks.{l}"), self.width))
            .collect()
    }

    /// Adds what acts on points of `inputs` numbers, the tensors' names after `prefix`.
    pub fn declare_trunk(&self, table: &mut Table, prefix: &str, inputs: usize) -> Trunk {
        Trunk::declare(table, prefix, [inputs, self.channels.count()], self)
    }
}

/// Refuses networks of too many parameters.
pub fn require_parameters(found: usize) -> Result<(), ShapeError> {
    match found {
        0..=MAX_PARAMETERS => Ok(()),
        _ => Err(ShapeError::Parameters { found }),
    }
}

/// Refuses `found` unless it is `accepted`.
pub fn require_size(
    field: &'static str,
    found: usize,
    accepted: bool,
    expected: &'static str,
) -> Result<(), ShapeError> {
    if accepted {
        Ok(())
    } else {
        Err(ShapeError::Size {
            field,
            found,
            expected,
        })
    }
}

/// How a tensor starts.
#[derive(Clone, Copy, Debug)]
pub enum Initial {
    Constant(f32),
    /// Uniform in plus and minus this bound.
    Uniform(f32),
}

/// PyTorch's start of a layer: uniform in `+-1/sqrt(inputs)`.
pub fn fan_in(inputs: usize) -> Initial {
    Initial::Uniform(1.0 / (inputs as f32).sqrt())
}

/// Tensors, their places in the flat parameter vector, and how they start.
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

    /// Adds a dense layer that starts as `initial`.
    pub fn dense(&mut self, name: &str, inputs: usize, outputs: usize, initial: Initial) -> Dense {
        Dense {
            inputs,
            outputs,
            weight: self.push(format!("{name}.weight"), &[outputs, inputs], initial),
            bias: self.push(format!("{name}.bias"), &[outputs], initial),
        }
    }

    /// Adds a dense layer without bias.
    pub fn product(
        &mut self,
        name: &str,
        inputs: usize,
        outputs: usize,
        initial: Initial,
    ) -> Dense {
        Dense {
            inputs,
            outputs,
            weight: self.push(format!("{name}.weight"), &[outputs, inputs], initial),
            bias: 0..0,
        }
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
