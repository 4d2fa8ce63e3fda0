//! The simulated robot itself.

use super::{About, PredictError, Prediction, Predictor};
use crate::data::Condition;
use crate::flow::{Stream, rng};
use crate::prior::SurfacePrior;

/// Predicts the surface of the simulated robot under the condition: what a network that starts there must beat.
impl Predictor for SurfacePrior {
    fn about(&self) -> About {
        About {
            key: "simulator".to_owned(),
            name: "simulator alone".to_owned(),
            method: "the surface of the simulated robot that the flow starts from".to_owned(),
            made_from: vec![("recipe".to_owned(), self.fingerprint())],
            ..About::default()
        }
    }

    fn predict(
        &self,
        condition: &Condition,
        points: usize,
        seed: u64,
    ) -> Result<Prediction, PredictError> {
        let rng = &mut rng(seed, Stream::Sample(0));
        let cloud = self.points(&condition.to_vec(), points, rng)?;
        let (points, _) = cloud.as_chunks();
        Ok(Prediction {
            points: points.to_vec(),
            colors: None,
            ..Prediction::default()
        })
    }
}
