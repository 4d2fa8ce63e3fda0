//! Either network behind one type: what users make, train and evaluate.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::hybrid::{
    ContextLayers, ContextNet, Hybrid, HybridShape, HybridWorkspace, PvcnnContext,
};
use super::kernels::Precision;
use super::layers::VARIANCE;
use super::mlp::{Batch, Cloud, Mlp, MlpShape, MlpWorkspace};
use super::parameters::{
    InitialWeights, NetworkShapeError, Parameters, Table, TensorRole, TensorSpec, require_precision,
};
use crate::channels::Channels;
use crate::flow::VelocityField;

/// Shape of a velocity network.
///
/// Files tell the two apart by their fields: a hybrid's has a `context`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, try_from = "Value")]
#[non_exhaustive]
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
    /// Returns an error if the sizes do not describe a network.
    pub fn check(&self) -> Result<(), NetworkShapeError> {
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

    /// Number of learned parameters: all but running statistics.
    pub fn learned_parameters(&self) -> usize {
        let tensors = self.tensors().into_iter();
        let learned = tensors.filter(|tensor| tensor.role == TensorRole::Learned);
        learned.map(|tensor| tensor.range.len()).sum()
    }

    /// Whether [`Network::loss_and_gradient`] has a gradient: not of [`ContextLayers::Pvcnn`], whose BatchNorm learns from the
    /// moments over all clouds of a batch.
    pub fn has_gradient(&self) -> bool {
        match self {
            Self::Mlp(_) => true,
            Self::Hybrid(shape) => shape.context.layers == ContextLayers::Residual,
        }
    }

    /// The same shape for conditions of another dimension.
    #[must_use]
    pub fn with_condition_dim(mut self, condition_dim: usize) -> Self {
        match &mut self {
            Self::Mlp(shape) => shape.condition_dim = condition_dim,
            Self::Hybrid(shape) => shape.head.condition_dim = condition_dim,
        }
        self
    }

    /// The layers that act on every point.
    fn head(&self) -> &MlpShape {
        match self {
            Self::Mlp(shape) => shape,
            Self::Hybrid(shape) => &shape.head,
        }
    }
}

/// A velocity network: the paper's MLP or its Hybrid.
#[derive(Clone, Debug)]
pub struct Network {
    shape: NetworkShape,
    precision: Precision,
    params: Vec<f32>,
    layers: Layers,
}

/// What a network does with its parameters.
#[derive(Clone, Debug)]
enum Layers {
    Mlp(Box<Mlp>),
    Hybrid(Box<Hybrid<ContextNet>>),
    /// As the authors published it: it gives velocities. It is trained in PyTorch, as BatchNorm's moments are over all clouds of a
    /// batch, and here clouds run one after another.
    Authors(Box<Hybrid<PvcnnContext>>),
}

/// Buffers of [`Network::loss_and_gradient`], kept from step to step.
#[derive(Debug, Default)]
pub struct Workspace {
    mlp: MlpWorkspace,
    hybrid: HybridWorkspace,
}

impl Layers {
    /// Adds the tensors of a network of `shape` to `table`.
    fn declare(shape: NetworkShape, table: &mut Table) -> Self {
        match shape {
            NetworkShape::Mlp(shape) => Self::Mlp(Box::new(Mlp::declare(shape, table))),
            NetworkShape::Hybrid(shape) => match shape.context.layers {
                ContextLayers::Residual => Self::Hybrid(Box::new(Hybrid::declare(shape, table))),
                ContextLayers::Pvcnn => Self::Authors(Box::new(Hybrid::declare(shape, table))),
            },
        }
    }
}

impl Network {
    /// A network with fresh parameters drawn from `rng`.
    ///
    /// Dense layers and convolutions start as PyTorch's do, weight and bias uniform in `+-1/sqrt(inputs)`; norms start as the
    /// identity. The FiLM heads start at zero (gamma = beta = 0): every block starts as a plain residual block and the
    /// embedding enters by the input layer alone, so no command or time starts with an accidental gain. The output layers of
    /// a Hybrid's context start at zero too, so that it starts as its head alone.
    ///
    /// # Errors
    /// [`NetworkShapeError`] where `shape` is out of bounds.
    pub fn new(
        shape: impl Into<NetworkShape>,
        rng: &mut ChaCha8Rng,
    ) -> Result<Self, NetworkShapeError> {
        Self::starting(shape, InitialWeights::default(), rng)
    }

    /// The same where the MLP's layers, or a Hybrid's head, start as `initial` says.
    ///
    /// # Errors
    /// As [`Network::new`].
    pub fn starting(
        shape: impl Into<NetworkShape>,
        initial: InitialWeights,
        rng: &mut ChaCha8Rng,
    ) -> Result<Self, NetworkShapeError> {
        let shape = shape.into();
        shape.check()?;
        let mut table = Table::starting(initial);
        Layers::declare(shape, &mut table);
        Self::from_params(shape, table.initial_params(rng))
    }

    /// A network with given parameters, in the order of [`NetworkShape::tensors`].
    ///
    /// # Errors
    /// [`NetworkShapeError`] where `shape` is out of bounds, `params` has another length than it needs, or a running variance
    /// is negative.
    pub fn from_params(
        shape: impl Into<NetworkShape>,
        params: Vec<f32>,
    ) -> Result<Self, NetworkShapeError> {
        let shape = shape.into();
        shape.check()?;
        let mut table = Table::default();
        let layers = Layers::declare(shape, &mut table);
        let (found, expected) = (params.len(), table.len());
        if found != expected {
            return Err(NetworkShapeError::ParameterCount { found, expected });
        }
        require_variances(&table, &params)?;
        Ok(Self {
            shape,
            precision: Precision::default(),
            params,
            layers,
        })
    }

    /// The network's shape.
    pub fn shape(&self) -> NetworkShape {
        self.shape
    }

    /// The flat parameter vector, in the order of [`NetworkShape::tensors`].
    pub fn params(&self) -> &[f32] {
        &self.params
    }

    /// The flat parameter vector, to be changed in place.
    pub fn params_mut(&mut self) -> &mut [f32] {
        &mut self.params
    }

    /// Operand type of its products: [`Precision::Float32`] unless asked for otherwise.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// The same network with another operand type.
    ///
    /// # Errors
    /// [`NetworkShapeError::Precision`] where its width does not suit it.
    pub fn with_precision(self, precision: Precision) -> Result<Self, NetworkShapeError> {
        require_precision(precision, self.shape.width())?;
        Ok(Self { precision, ..self })
    }

    /// Floating-point operations of the velocities of a cloud of `points` points, products alone.
    pub fn flops(&self, points: usize) -> u64 {
        match &self.layers {
            Layers::Mlp(layers) => layers.flops(points),
            Layers::Hybrid(layers) => layers.flops(points),
            Layers::Authors(layers) => layers.flops(points),
        }
    }

    /// Mean squared velocity error over all `B N 3` components of the positions (paper, Eq. fm_loss_tdcr, divided by
    /// their number), plus [`Batch::color_weight`] times that of the colours (Eq. rgb_loss_tdcr); and its gradient by the
    /// parameters, written over `gradient`.
    ///
    /// Points run in parallel, and a Hybrid's voxels; the result does not depend on the number of threads.
    ///
    /// # Panics
    /// Where the batch holds no point, a slice's length does not fit the others or the network, or the network's shape has no
    /// gradient ([`NetworkShape::has_gradient`]).
    pub fn loss_and_gradient(
        &self,
        batch: &Batch,
        workspace: &mut Workspace,
        gradient: &mut [f32],
    ) -> f64 {
        let parameters = self.parameters();
        match &self.layers {
            Layers::Mlp(layers) => {
                layers.loss_and_gradient(parameters, batch, &mut workspace.mlp, gradient)
            }
            Layers::Hybrid(layers) => {
                layers.loss_and_gradient(parameters, batch, &mut workspace.hybrid, gradient)
            }
            Layers::Authors(_) => panic!("a network with BatchNorm has no gradient here"),
        }
    }

    fn parameters(&self) -> Parameters<'_> {
        Parameters {
            values: &self.params,
            precision: self.precision,
        }
    }
}

/// Returns an error where a running variance is negative.
fn require_variances(table: &Table, params: &[f32]) -> Result<(), NetworkShapeError> {
    let variances = (table.tensors.iter()).filter(|tensor| tensor.name.ends_with(VARIANCE));
    for tensor in variances {
        let negative = params[tensor.range.clone()]
            .iter()
            .find(|variance| **variance < 0.0);
        if let Some(&found) = negative {
            let tensor = tensor.name.clone();
            return Err(NetworkShapeError::Variance { tensor, found });
        }
    }
    Ok(())
}

impl VelocityField for Network {
    fn channels(&self) -> Channels {
        self.shape.channels()
    }

    /// Points run in parallel, and a Hybrid's voxels; the result does not depend on the number of threads.
    ///
    /// # Panics
    /// Where a slice's length does not fit the others or the network.
    fn velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]) {
        let parameters = self.parameters();
        let cloud = Cloud {
            time: t,
            condition,
            points,
        };
        match &self.layers {
            Layers::Mlp(layers) => layers.velocity(parameters, cloud, velocities),
            Layers::Hybrid(layers) => layers.velocity(parameters, cloud, velocities),
            Layers::Authors(layers) => layers.velocity(parameters, cloud, velocities),
        }
    }
}
