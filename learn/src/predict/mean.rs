//! The cloud of the mean training condition, whatever is asked.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tdcr_sim::cloud::PointCloud;
use tdcr_sim::robot::Robot;

use super::{About, PredictError, Prediction, Predictor};
use crate::data::{CloudSet, Condition, Normalisation, Recipe, Simulator};

/// Predicts one cloud for all conditions: that of the simulated robot under the mean of the training conditions.
pub struct MeanCommand {
    cloud: PointCloud,
    clouds: usize,
}

impl MeanCommand {
    /// A predictor from training clouds in the units of `normalisation`, which show `robot` as `recipe` says; `seed` chooses
    /// the points.
    ///
    /// # Errors
    /// [`PredictError::NoTraining`] for a set without clouds, [`PredictError::Simulate`] where the robot does not settle
    /// under the mean condition or is not seen.
    pub fn new(
        robot: &Robot,
        recipe: &Recipe,
        normalisation: &Normalisation,
        training: &CloudSet,
        seed: u64,
    ) -> Result<Self, PredictError> {
        if training.is_empty() {
            return Err(PredictError::NoTraining);
        }
        let condition = mean_condition(recipe, normalisation, training);
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        let mut simulator = Simulator::new(robot, recipe);
        let cloud = simulator.cloud(&condition, training.points_per_cloud, rng)?;
        Ok(Self {
            cloud,
            clouds: training.len(),
        })
    }
}

/// Mean over the training conditions, in the data set's units.
fn mean_condition(
    recipe: &Recipe,
    normalisation: &Normalisation,
    training: &CloudSet,
) -> Condition {
    let mean_of = |value: usize| -> f32 {
        let sum: f64 = (0..training.len())
            .map(|k| f64::from(training.condition(k)[value]))
            .sum();
        let (low, high) = (
            normalisation.motor_min[value],
            normalisation.motor_max[value],
        );
        (low + (high - low) * sum / training.len() as f64) as f32
    };
    let mut motors: Vec<f32> = (0..training.condition_dim).map(mean_of).collect();
    let payload = match recipe.subject.payload {
        Some(_) => motors.pop(),
        None => None,
    };
    Condition { motors, payload }
}

impl Predictor for MeanCommand {
    fn about(&self) -> About {
        About {
            key: "mean".to_owned(),
            name: "mean command".to_owned(),
            method: "the cloud of the mean training command".to_owned(),
            made_from: vec![("training clouds".to_owned(), self.clouds.to_string())],
            ..About::default()
        }
    }

    fn predict(&self, _: &Condition, _: usize, _: u64) -> Result<Prediction, PredictError> {
        Ok(Prediction {
            points: self.cloud.points.clone(),
            colors: None,
            ..Prediction::default()
        })
    }
}
