//! Predictions of validation clouds, and how far their uncertainty is to be trusted.

use rand::Rng;
use rayon::prelude::*;

use super::error::TrainError;
use super::model::Model;
use super::refined::Refined;
use super::settings::TrainSettings;
use crate::channels::DIM;
use crate::data::CloudSet;
use crate::flow::{Stream, VelocityField, rng};
use crate::metrics::{MetricError, nearest_distances};
use crate::predict::Prediction;
use crate::prior::start_from;

/// Share of the points that twice their uncertainty is to cover.
const COVERED: f64 = 0.95;

/// Validation clouds that tell the factor, and points of each.
const CLOUDS: usize = 32;
const POINTS: usize = 10_000;

/// The positions (normalised units) of `count` points of the prediction for a cloud of `set`, which are drawn and selected as those
/// of [`Model::predict`].
pub(super) fn predict_cloud(
    field: Refined,
    settings: &TrainSettings,
    (set, cloud): (&CloudSet, usize),
    count: usize,
    rng: &mut impl Rng,
) -> Vec<[f32; DIM]> {
    let channels = field.channels();
    let drawn = settings.sampler.drawn(count);
    let mut rows = vec![0.0; drawn * channels.count()];
    settings.path.sample_prior(rng, channels, &mut rows);
    if let Some(surface) = set.start(cloud) {
        // As many points of it as are wanted, at even distances in its order, which is random.
        let of = |row| row * set.points_per_cloud / drawn;
        let chosen: Vec<_> = (0..drawn).map(of).collect();
        start_from(surface, &chosen, channels, &mut rows);
    }
    let drawn = field.draw(&settings.sampler, set.condition(cloud), &mut rows, count);
    let kept = drawn.kept.into_iter();
    kept.map(|k| drawn.positions[k]).collect()
}

impl Model {
    /// How many clouds of `validation` [`calibrated`](Self::calibrated) looks at.
    pub fn calibration_clouds(validation: &CloudSet) -> usize {
        CLOUDS.min(validation.len())
    }

    /// The model with an [`uncertainty_factor`](Self::uncertainty_factor) from `validation`, clouds of commands that it was not
    /// trained on, in its units: the least with which twice the uncertainty covers 95 % of the points of a command. Each of up to
    /// 32 commands gives a share of covered points; their mean less its standard error is to reach 95 %, so that few commands
    /// make the factor larger. `made` is told of every command, and says whether to go on; `None` where it says no.
    ///
    /// Without a factor stays a model whose clouds have fewer than 16 points, of which nothing can be told.
    ///
    /// # Errors
    /// [`TrainError::Data`] where a predicted cloud is not finite.
    pub fn calibrated(
        self,
        validation: &CloudSet,
        made: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Self>, TrainError> {
        let clouds = Self::calibration_clouds(validation);
        let ratios = (0..clouds).into_par_iter().map(|k| {
            let cloud = k * validation.len() / clouds;
            match made() {
                true => self.error_by_uncertainty(validation, cloud).map(Some),
                false => Ok(None),
            }
        });
        let ratios: Result<Option<Vec<_>>, MetricError> = ratios.collect();
        let ratios = ratios.map_err(|error| TrainError::Data {
            set: "validation",
            reason: error.to_string(),
        })?;
        Ok(ratios.map(|ratios| Self {
            uncertainty_factor: ratios
                .into_iter()
                .collect::<Option<Vec<_>>>()
                .and_then(factor),
            ..self
        }))
    }

    /// What half of each point's distance from a validation cloud is of its spread, in ascending order; `None` where too few points
    /// tell a spread.
    fn error_by_uncertainty(
        &self,
        validation: &CloudSet,
        cloud: usize,
    ) -> Result<Option<Vec<f64>>, MetricError> {
        let settings = &self.settings;
        let count = POINTS.min(validation.points_per_cloud);
        let mut rng = rng(settings.seed, Stream::Sample(cloud as u64));
        let points = predict_cloud(self.field(), settings, (validation, cloud), count, &mut rng);
        let (truth, _) = validation.cloud(cloud).as_chunks::<DIM>();
        let distances = nearest_distances(&points, truth)?;
        let prediction = Prediction {
            points,
            ..Prediction::default()
        };
        Ok(prediction.uncertainty(&[]).map(|spread| {
            let pairs = distances.iter().zip(spread);
            // Where both are zero, any factor does.
            let ratio = |(distance, spread): (&f64, f32)| match *distance {
                0.0 => 0.0,
                distance => distance / (2.0 * f64::from(spread)),
            };
            let mut ratios: Vec<f64> = pairs.map(ratio).collect();
            ratios.sort_by(f64::total_cmp);
            ratios
        }))
    }
}

/// The least factor that covers enough, of the ratios of each command in ascending order; `None` where none does.
fn factor(ratios: Vec<Vec<f64>>) -> Option<f32> {
    let count = ratios.len() as f64;
    let covers = |factor: f64| {
        let share = |ratios: &Vec<f64>| {
            ratios.partition_point(|ratio| *ratio <= factor) as f64 / ratios.len() as f64
        };
        let shares: Vec<f64> = ratios.iter().map(share).collect();
        let mean = shares.iter().sum::<f64>() / count;
        let squares: f64 = shares.iter().map(|share| (share - mean).powi(2)).sum();
        let error = (squares / (count - 1.0).max(1.0) / count).sqrt();
        mean - error >= COVERED
    };
    let mut all: Vec<f64> = ratios.iter().flatten().copied().collect();
    all.sort_by(f64::total_cmp);
    // Up to the least factor nearly all commands gain with it, as does their mean less its error.
    let least = all.partition_point(|&factor| !covers(factor));
    let least = all.get(least).filter(|factor| factor.is_finite())?;
    Some(*least as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factor_covers_what_it_is_to_cover_and_is_larger_for_few_commands() {
        // Ratios evenly spread from 0 to 1 in each command: 95 % lie below 0.95.
        let even = |top: f64| {
            (1..=1000)
                .map(|k| top * f64::from(k) / 1000.0)
                .collect::<Vec<_>>()
        };
        let alike = factor(vec![even(1.0); 9]).expect("a factor");
        assert!((alike - 0.95).abs() < 2e-3, "{alike}");
        // Of two kinds of commands, the mean of the shares less its error.
        let mixed = |count: usize| {
            let tops = (0..count).map(|k| if k % 2 == 0 { 1.0 } else { 2.0 });
            f64::from(factor(tops.map(even).collect()).expect("a factor"))
        };
        // Shares f / 2 and 1 have the mean (1 + f / 2) / 2 and the deviation (1 - f / 2) / 2.
        for count in [4, 40] {
            let n = count as f64;
            let found = mixed(count) / 2.0;
            let error = (1.0 - found) / 2.0 / (n - 1.0).sqrt();
            assert!(((1.0 + found) / 2.0 - error - 0.95).abs() < 1e-3, "{found}");
        }
        assert!(mixed(4) > mixed(40));
        assert_eq!(factor(vec![vec![f64::INFINITY; 20]]), None);
    }
}
