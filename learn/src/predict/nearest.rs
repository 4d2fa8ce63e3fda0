//! The cloud of the training condition that is nearest.

use std::iter::zip;

use super::{About, PredictError, Prediction, Predictor};
use crate::data::{CloudSet, Condition, Normalisation};

/// Predicts the cloud of the nearest training condition: Euclidean, each number in units of its range in the training data.
pub struct NearestCommand {
    /// In the units of `normalisation`.
    training: CloudSet,
    normalisation: Normalisation,
}

impl NearestCommand {
    /// A predictor from training clouds in the units of `normalisation`.
    ///
    /// # Errors
    /// [`PredictError::NoTraining`] for a set without clouds.
    pub fn new(training: CloudSet, normalisation: Normalisation) -> Result<Self, PredictError> {
        match training.is_empty() {
            true => Err(PredictError::NoTraining),
            false => Ok(Self {
                training,
                normalisation,
            }),
        }
    }

    /// Distance of a condition from the nearest training condition, each number in units of its range in the training data.
    ///
    /// # Errors
    /// [`PredictError::Length`] where the condition has another length than those of the training data.
    pub fn distance(&self, condition: &Condition) -> Result<f64, PredictError> {
        let (nearest, condition) = self.nearest(condition)?;
        let pairs = zip(condition, self.training.condition(nearest));
        let squared: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        Ok(squared.sqrt())
    }

    /// Index of the nearest training condition, and the condition in the units of the training data.
    fn nearest(&self, condition: &Condition) -> Result<(usize, Vec<f32>), PredictError> {
        let condition = self.normalisation.condition(&condition.to_vec())?;
        let nearest = self.training.nearest_condition(&condition);
        Ok((nearest.ok_or(PredictError::NoTraining)?, condition))
    }
}

impl Predictor for NearestCommand {
    fn about(&self) -> About {
        About {
            key: "nearest".to_owned(),
            name: "nearest training command".to_owned(),
            method: "the cloud of the training command that is nearest".to_owned(),
            made_from: vec![(
                "training clouds".to_owned(),
                self.training.len().to_string(),
            )],
            ..About::default()
        }
    }

    fn predict(&self, condition: &Condition, _: usize, _: u64) -> Result<Prediction, PredictError> {
        let (nearest, _) = self.nearest(condition)?;
        let mut coordinates = self.training.cloud(nearest).to_vec();
        self.normalisation.denormalise_points(&mut coordinates);
        Ok(Prediction {
            points: coordinates.as_chunks().0.to_vec(),
            colors: None,
            ..Prediction::default()
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

    use super::*;

    #[test]
    fn the_nearest_cloud_is_given_in_metres_and_its_distance_in_ranges() {
        let normalisation = Normalisation {
            motor_min: vec![0.0, 0.01],
            motor_max: vec![0.04, 0.03],
            scale: 0.5,
        };
        let empty = CloudSet {
            condition_dim: 2,
            points_per_cloud: 1,
            conditions: vec![],
            points: vec![],
            colors: None,
            starts: None,
        };
        let refused = NearestCommand::new(empty.clone(), normalisation.clone());
        assert!(matches!(refused, Err(PredictError::NoTraining)));
        let training = CloudSet {
            conditions: vec![0.0, 0.0, 1.0, 1.0],
            points: vec![0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
            ..empty
        };
        let predictor = NearestCommand::new(training, normalisation).unwrap();
        let condition = |motors: &[f32]| Condition {
            motors: motors.to_vec(),
            payload: None,
        };
        let near = condition(&[0.03, 0.03]);
        let cloud = predictor.predict(&near, 7, 0).unwrap();
        assert_eq!(cloud.points, [[0.2, 0.25, 0.3]]);
        assert!((predictor.distance(&near).unwrap() - 0.25).abs() < 1e-6);
        let short = predictor.predict(&condition(&[0.03]), 7, 0);
        assert!(matches!(short, Err(PredictError::Length(_))));
    }
}
