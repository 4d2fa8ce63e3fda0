//! Initial weights of a run.

use tdcr_base::hash::hash;

use super::difference::{Difference, require_same};
use super::error::TrainError;
use super::model::{Model, Provenance};
use super::settings::{Target, TrainSettings};
use crate::flow::{Stream, rng};
use crate::net::{HybridShape, MlpShape, Network, NetworkShape, NetworkShapeError};

/// Initial weights of a run.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Start<'a> {
    /// Random weights of a network of this shape, a function of [`TrainSettings::seed`] and [`TrainSettings::procedure`].
    Random(NetworkShape),
    /// The weights of this network.
    Network(&'a Network),
}

impl From<NetworkShape> for Start<'_> {
    fn from(shape: NetworkShape) -> Self {
        Self::Random(shape)
    }
}

impl From<MlpShape> for Start<'_> {
    fn from(shape: MlpShape) -> Self {
        Self::Random(shape.into())
    }
}

impl From<HybridShape> for Start<'_> {
    fn from(shape: HybridShape) -> Self {
        Self::Random(shape.into())
    }
}

impl<'a> From<&'a Network> for Start<'a> {
    fn from(network: &'a Network) -> Self {
        Self::Network(network)
    }
}

impl<'a> Start<'a> {
    /// The weights of `model`, for a run of a network of `shape` on data of `provenance`.
    ///
    /// # Errors
    /// [`TrainError::OtherStart`] where the model has another shape, was distilled, was trained on data of another
    /// normalisation, in which the same numbers mean other commands and points, or on representatives by other symmetries
    /// than those of the data, so that it knows nothing of other commands. Subjects are not compared.
    pub fn at(
        model: &'a Model,
        shape: NetworkShape,
        provenance: &Provenance,
    ) -> Result<Self, TrainError> {
        let of_model = &model.provenance.normalisation;
        let (by_model, by_data) = (&model.provenance.reduction, &provenance.reduction);
        let reduced = match by_model.suits(by_data) {
            true => Ok(()),
            false => Err(Difference {
                what: "symmetry".to_owned(),
                found: by_model.to_string(),
                expected: format!("the data's {by_data}"),
            }),
        };
        reduced
            .and_then(|()| require_same("shape", &model.network.shape(), &shape))
            .and_then(|()| require_same("normalisation", of_model, &provenance.normalisation))
            .and_then(|()| require_same("target", &model.settings.target, &Target::Velocity))
            .map_err(TrainError::other_start)?;
        Ok(Self::Network(&model.network))
    }

    /// Shape of the network.
    pub fn shape(&self) -> NetworkShape {
        match self {
            Self::Random(shape) => *shape,
            Self::Network(network) => network.shape(),
        }
    }

    /// The network with its initial weights.
    pub(super) fn network(&self, settings: &TrainSettings) -> Result<Network, NetworkShapeError> {
        match self {
            Self::Random(shape) => {
                let initial = settings.procedure.initial_weights();
                let rng = &mut rng(settings.seed, Stream::Parameters);
                Network::starting(*shape, initial, rng)
            }
            Self::Network(network) => Ok((*network).clone()),
        }
    }

    /// What distinguishes it from other starts: [`fingerprint`] of a network; `None` for random weights, which the settings
    /// determine.
    pub(super) fn fingerprint(&self) -> Option<u64> {
        match self {
            Self::Random(_) => None,
            Self::Network(network) => Some(fingerprint(network)),
        }
    }
}

/// A hash of all weights of a network.
pub(super) fn fingerprint(network: &Network) -> u64 {
    hash(network.params().iter().map(|weight| weight.to_bits()))
}

/// A start in words, from its fingerprint.
pub(super) fn describe(fingerprint: Option<u64>) -> String {
    fingerprint.map_or("random".to_owned(), |hash| format!("network {hash:016x}"))
}
