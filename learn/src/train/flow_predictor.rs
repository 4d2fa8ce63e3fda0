//! A trained model with a sampler: the flow as a predictor.

use std::sync::Arc;

use super::Model;
use crate::data::Condition;
use crate::flow::Sampler;
use crate::net::Channels;
use crate::predict::{About, PredictError, Prediction, Predictor, TrainingCost};
use crate::prior::Prior;

/// Predicts by a model's network, whose flow is followed by a sampler.
#[derive(Clone)]
pub struct FlowPredictor {
    model: Arc<Model>,
    sampler: Sampler,
}

impl FlowPredictor {
    /// A predictor by `model`, in the precision that its network has, with `sampler`.
    pub fn new(model: Arc<Model>, sampler: Sampler) -> Self {
        Self { model, sampler }
    }
}

impl Predictor for FlowPredictor {
    fn about(&self) -> About {
        let Model {
            provenance,
            settings,
            step,
            validation_distance,
            network,
            refinement,
            reach,
            uncertainty_factor,
        } = &*self.model;
        let facts = [
            ("step", step.to_string()),
            ("validation distance", validation_distance.to_string()),
            ("sampler", format!("{:?}", self.sampler)),
            ("precision", network.precision().name().to_owned()),
        ];
        let facts = facts.map(|(name, value)| (name.to_owned(), value));
        let prior = match &settings.prior {
            Prior::Gaussian => None,
            prior => Some(("prior".to_owned(), prior.fingerprint())),
        };
        let refinement = refinement.as_ref().and(settings.refinement);
        let refinement = refinement.map(|refinement| {
            let words = format!("{} steps", refinement.steps);
            ("refinement".to_owned(), words)
        });
        let reach = reach.map(|reach| ("reach".to_owned(), format!("{reach:?}")));
        let factor =
            uncertainty_factor.map(|factor| ("uncertainty factor".to_owned(), factor.to_string()));
        let symmetries = (!provenance.reduction.is_trivial())
            .then(|| ("symmetry".to_owned(), provenance.reduction.to_string()));
        About {
            key: "network".to_owned(),
            name: "network".to_owned(),
            method: match settings.prior {
                Prior::Gaussian => "a network that carries noise to the robot's surface",
                _ => "a network that carries the simulated surface to the robot's",
            }
            .to_owned(),
            made_from: (facts.into_iter())
                .chain(refinement)
                .chain(reach)
                .chain(factor)
                .chain(prior)
                .chain(symmetries)
                .collect(),
            subject: provenance.subject.clone(),
            colors: network.shape().channels() == Channels::XyzRgb,
            training: TrainingCost {
                points: step.saturating_mul((settings.clouds * settings.points) as u64),
                ..TrainingCost::default()
            },
            prediction_seconds: None,
        }
    }

    fn predict(
        &self,
        condition: &Condition,
        points: usize,
        seed: u64,
    ) -> Result<Prediction, PredictError> {
        let condition = condition.to_vec();
        self.model.predict(&condition, points, seed, &self.sampler)
    }
}
