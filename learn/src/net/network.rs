//! Either network behind one type.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::flow::VelocityField;

use crate::channels::Channels;
use crate::net::hybrid::{Hybrid, HybridShape};
use crate::net::kernels::Precision;
use crate::net::mlp::{Batch, Mlp, MlpShape, ShapeError, TensorSpec, Workspace};

/// Shape of a velocity network.
///
/// Files tell the two apart by their fields: a hybrid's has a `context`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, try_from = "Value")]
pub enum NetworkShape {
    /// Every point alone.
    Mlp(MlpShape),
    /// Points with a context from the cloud about them.
    Hybrid(HybridShape),
}

impl TryFrom<Value> for NetworkShape {
    type Error = serde_json::Error;

    fn try_from(value: Value) -> serde_json::Result<Self> {
        if value.get("context").is_some() {
            serde_json::from_value(value).map(Self::Hybrid)
        } else {
            serde_json::from_value(value).map(Self::Mlp)
        }
    }
}

impl From<MlpShape> for NetworkShape {
    fn from(shape: MlpShape) -> Self {
        Self::Mlp(shape)
    }
}

impl From<HybridShape> for NetworkShape {
    fn from(shape: HybridShape) -> Self {
        Self::Hybrid(shape)
    }
}

impl NetworkShape {
    /// Refuses sizes of which no network can be made.
    pub fn check(&self) -> Result<(), ShapeError> {
        match self {
            Self::Mlp(shape) => shape.check(),
            Self::Hybrid(shape) => shape.check(),
        }
    }

    /// Condition dimension `D`.
    pub fn condition_dim(&self) -> usize {
        self.head().condition_dim
    }

    /// Features of the layers on points.
    pub fn width(&self) -> usize {
        self.head().width
    }

    /// What points consist of.
    pub fn channels(&self) -> Channels {
        self.head().channels
    }

    /// The tensors in the order in which the flat parameter vector holds them.
    pub fn tensors(&self) -> Vec<TensorSpec> {
        match self {
            Self::Mlp(shape) => shape.tensors(),
            Self::Hybrid(shape) => shape.tensors(),
        }
    }

    /// The layers that act on every point.
    fn head(&self) -> &MlpShape {
        match self {
            Self::Mlp(shape) => shape,
            Self::Hybrid(shape) => &shape.head,
        }
    }
}

/// A velocity network.
#[derive(Clone, Debug)]
pub enum Network {
    /// Every point alone.
    Mlp(Box<Mlp>),
    /// Points with a context from the cloud about them.
    Hybrid(Box<Hybrid>),
}

impl Network {
    /// A network with fresh parameters drawn from `rng`: [`Mlp::new`], [`Hybrid::new`].
    ///
    /// # Errors
    /// [`ShapeError`] where `shape` is out of bounds.
    pub fn new(shape: NetworkShape, rng: &mut ChaCha8Rng) -> Result<Self, ShapeError> {
        Ok(match shape {
            NetworkShape::Mlp(shape) => Self::Mlp(Box::new(Mlp::new(shape, rng)?)),
            NetworkShape::Hybrid(shape) => Self::Hybrid(Box::new(Hybrid::new(shape, rng)?)),
        })
    }

    /// A network with given parameters, in the order of [`NetworkShape::tensors`].
    ///
    /// # Errors
    /// [`ShapeError`] where `shape` is out of bounds or `params` has another length than it needs.
    pub fn from_params(shape: NetworkShape, params: Vec<f32>) -> Result<Self, ShapeError> {
        Ok(match shape {
            NetworkShape::Mlp(shape) => Self::Mlp(Box::new(Mlp::from_params(shape, params)?)),
            NetworkShape::Hybrid(shape) => {
                Self::Hybrid(Box::new(Hybrid::from_params(shape, params)?))
            }
        })
    }

    /// The network's shape.
    pub fn shape(&self) -> NetworkShape {
        match self {
            Self::Mlp(network) => network.shape().into(),
            Self::Hybrid(network) => network.shape().into(),
        }
    }

    /// The flat parameter vector, in the order of [`NetworkShape::tensors`].
    pub fn params(&self) -> &[f32] {
        match self {
            Self::Mlp(network) => network.params(),
            Self::Hybrid(network) => network.params(),
        }
    }

    /// The flat parameter vector, to be changed in place.
    pub fn params_mut(&mut self) -> &mut [f32] {
        match self {
            Self::Mlp(network) => network.params_mut(),
            Self::Hybrid(network) => network.params_mut(),
        }
    }

    /// What numbers its products are of: [`Precision::Float32`] unless asked for otherwise.
    pub fn precision(&self) -> Precision {
        match self {
            Self::Mlp(network) => network.precision(),
            Self::Hybrid(network) => network.precision(),
        }
    }

    /// The same network with products of other numbers.
    ///
    /// # Errors
    /// [`ShapeError::Precision`] where its width does not suit them.
    pub fn with_precision(self, precision: Precision) -> Result<Self, ShapeError> {
        Ok(match self {
            Self::Mlp(network) => Self::Mlp(Box::new(network.with_precision(precision)?)),
            Self::Hybrid(network) => Self::Hybrid(Box::new(network.with_precision(precision)?)),
        })
    }

    /// Floating-point operations of the velocities of a cloud of `points` points, products alone.
    pub fn flops(&self, points: usize) -> u64 {
        match self {
            Self::Mlp(network) => network.flops(points),
            Self::Hybrid(network) => network.flops(points),
        }
    }

    /// Loss and gradient: [`Mlp::loss_and_gradient`], [`Hybrid::loss_and_gradient`].
    ///
    /// # Panics
    /// Where the batch holds no point or a slice's length does not fit the others or the network.
    pub fn loss_and_gradient(
        &self,
        batch: &Batch,
        workspace: &mut Workspace,
        gradient: &mut [f32],
    ) -> f64 {
        match self {
            Self::Mlp(network) => network.loss_and_gradient(batch, workspace, gradient),
            Self::Hybrid(network) => network.loss_and_gradient(batch, workspace, gradient),
        }
    }
}

impl VelocityField for Network {
    /// # Panics
    /// Where a slice's length does not fit the others or the network.
    fn velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]) {
        match self {
            Self::Mlp(network) => network.velocity(t, condition, points, velocities),
            Self::Hybrid(network) => network.velocity(t, condition, points, velocities),
        }
    }
}
