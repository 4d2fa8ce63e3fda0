//! The network itself: parameters, initialisation, inference.

use rand_chacha::ChaCha8Rng;

use crate::flow::VelocityField;

use super::conditioner::{Conditioner, ConditionerTape};
use super::shape::{MlpShape, ShapeError, Table};
use super::trunk::{Trunk, TrunkTapes};
use super::trunk_bf16::PackedTrunk;
use crate::net::kernels::Precision;
use crate::net::layers::{Passes, Weights};
use crate::pool::Pool;

/// The paper's MLP velocity network (Sec. Method, Eq. mlp_velocity): every point alone, weights shared.
#[derive(Clone, Debug)]
pub struct Mlp {
    shape: MlpShape,
    precision: Precision,
    params: Vec<f32>,
    pub conditioner: Conditioner,
    pub trunk: Trunk,
    pub tapes: TrunkTapes,
    scratch: Pool<(ConditionerTape, PackedTrunk)>,
}

impl Mlp {
    /// A network with fresh parameters drawn from `rng`.
    ///
    /// Dense layers start as PyTorch's do, weight and bias uniform in `+-1/sqrt(inputs)`; LayerNorms start as the
    /// identity. The FiLM heads start at zero (gamma = beta = 0): every block starts as a plain residual block and
    /// `e` enters by the input layer alone, so no command or time starts with an accidental gain.
    ///
    /// # Errors
    /// [`ShapeError::Size`] where `shape` is out of bounds.
    pub fn new(shape: MlpShape, rng: &mut ChaCha8Rng) -> Result<Self, ShapeError> {
        shape.check()?;
        let mut table = Table::default();
        shape.declare(&mut table);
        let params = table.initial_params(rng);
        Self::from_params(shape, params)
    }

    /// A network with given parameters, in the order of [`MlpShape::tensors`].
    ///
    /// # Errors
    /// [`ShapeError`] where `shape` is out of bounds or `params` has another length than it needs.
    pub fn from_params(shape: MlpShape, params: Vec<f32>) -> Result<Self, ShapeError> {
        shape.check()?;
        let mut table = Table::default();
        let (conditioner, trunk) = shape.declare(&mut table);
        let expected = table.len();
        if params.len() != expected {
            return Err(ShapeError::ParameterCount {
                found: params.len(),
                expected,
            });
        }
        Ok(Self {
            conditioner,
            trunk,
            shape,
            precision: Precision::default(),
            params,
            tapes: TrunkTapes::default(),
            scratch: Pool::default(),
        })
    }

    /// The network's shape.
    pub fn shape(&self) -> MlpShape {
        self.shape
    }

    /// What numbers its products are of.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// The same network with products of other numbers.
    ///
    /// # Errors
    /// [`ShapeError::Precision`] where its width does not suit them.
    pub fn with_precision(self, precision: Precision) -> Result<Self, ShapeError> {
        precision.check(self.shape.width)?;
        Ok(Self { precision, ..self })
    }

    /// The trunk's weights, packed for `passes` where its products are of bfloat16 numbers.
    pub fn trunk_weights<'a>(
        &'a self,
        packed: &'a mut PackedTrunk,
        passes: Passes,
    ) -> Weights<'a, PackedTrunk> {
        let params = &self.params[self.trunk.range.clone()];
        let packed = match self.precision {
            Precision::Float32 => None,
            Precision::Bfloat16 => {
                packed.set(&self.trunk, params, passes);
                Some(&*packed)
            }
        };
        Weights { params, packed }
    }

    /// Floating-point operations of the velocities of a cloud of `points` points, products alone.
    pub fn flops(&self, points: usize) -> u64 {
        self.conditioner.flops() + self.trunk.flops(points)
    }

    /// The flat parameter vector, in the order of [`MlpShape::tensors`].
    pub fn params(&self) -> &[f32] {
        &self.params
    }

    /// The flat parameter vector, to be changed in place.
    pub fn params_mut(&mut self) -> &mut [f32] {
        &mut self.params
    }
}

impl VelocityField for Mlp {
    /// Tiles of points run in parallel; the result does not depend on the number of threads.
    ///
    /// # Panics
    /// Where a slice's length does not fit the others or the network.
    fn velocity(&self, t: f32, condition: &[f32], points: &[f32], velocities: &mut [f32]) {
        assert_eq!(
            condition.len(),
            self.shape.condition_dim,
            "condition dimension"
        );
        assert_eq!(points.len(), velocities.len(), "one velocity per point");
        self.scratch.with(Default::default, |(tape, packed)| {
            self.conditioner
                .forward(&self.params, &[t], condition, tape);
            let weights = self.trunk_weights(packed, Passes::Forward);
            self.trunk
                .velocities(weights, &tape.modulation, points, &self.tapes, velocities);
        });
    }
}
