//! What one cloud scores beside the true one.

use rand::Rng;
use rand::seq::index;
use tdcr_learn::data::Sample;
use tdcr_learn::metrics::{
    MetricError, chamfer, color_error, emd, emd_squared, nearest_distances, rank_correlation,
};
use tdcr_learn::predict::{ISOLATED_CORRECTED, Prediction, select};
use tdcr_sim::robot::Robot;
use tdcr_sim::statics::Equilibrium;

use super::eval_settings::Scoring;
use super::scores::{Distances, RowScore, UncertaintyScore};
use super::simulation::{Again, with_spare};
use super::tip::tip_error;

/// What is measured of a predictor's clouds.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
pub(super) enum Extent {
    /// Distances alone.
    Distances,
    /// How far the tip is off, too.
    Tip,
    /// Colours and uncertainty, too.
    All,
}

/// A test sample, and what clouds are measured by.
pub(super) struct Measure<'a> {
    pub scoring: Scoring,
    pub sample: &'a Sample,
    /// The points of the true cloud that all clouds are compared with.
    pub truth: Vec<[f32; 3]>,
    /// The robot and where its discs are, where that is known.
    pub settled: Option<(&'a Robot, Equilibrium)>,
    /// Whether colours can be judged.
    pub colored: bool,
}

impl Measure<'_> {
    /// The scores of a prediction, of whose points `rng` draws those that are compared.
    pub fn row(
        &self,
        key: &str,
        prediction: &Prediction,
        extent: Extent,
        rng: &mut impl Rng,
    ) -> Result<RowScore, MetricError> {
        let truth = &self.sample.cloud;
        let colors = prediction.colors.as_ref();
        let colors = colors.filter(|_| self.colored && extent == Extent::All);
        let color = |colors: &Vec<[u8; 3]>| {
            color_error((&prediction.points, colors), (&truth.points, &truth.colors))
        };
        let tip = match &self.settled {
            Some((robot, settled)) if extent >= Extent::Tip => {
                tip_error(robot, settled, &self.truth, &prediction.points)?
            }
            _ => None,
        };
        let few = self.scoring.emd_points;
        let cloud = subset(self.scoring.points, &prediction.points, rng);
        Ok(RowScore {
            tip,
            color: colors.map(color).transpose()?,
            uncertainty: match extent {
                Extent::All => uncertainty(prediction, &truth.points)?,
                _ => None,
            },
            evaluations: prediction.evaluations as f64,
            ..RowScore::new(
                key,
                distances([&cloud, &self.truth], [&cloud[..few], &self.truth[..few]])?,
            )
        })
    }

    /// What other samples of the true surface score: a perfect predictor, the same whose points are selected as those of a refined
    /// network are, and the sampling floor. For CD the floor's sample is a view in a random phase of pixels and voxels; but that has some
    /// parts, like a base, in another density, which counts in the earth mover's distances: for them it is other points of the
    /// true cloud, where there are enough.
    pub fn references(
        &self,
        [perfect, selected, floor]: [&str; 3],
        again: &Again,
        rng: &mut impl Rng,
    ) -> Result<[RowScore; 3], MetricError> {
        let (points, few) = (self.scoring.points, self.scoring.emd_points);
        let view = subset(points, &again.view.points, rng);
        let second = self.truth.get(few..2 * few).unwrap_or(&view[..few]);
        let of_floor = distances([&view, &self.truth], [second, &self.truth[..few]])?;
        // The floor's points of the earth mover's distances are independent of each other already.
        let independent = subset(points, &again.independent.points, rng);
        let of_perfect = Distances {
            cd: chamfer(&independent, &self.truth)?,
            ..of_floor
        };
        let select = |count: usize| {
            let drawn = &again.independent.points;
            let mut drawn = drawn[..with_spare(count).min(drawn.len())].to_vec();
            let kept = select(&mut drawn, count, ISOLATED_CORRECTED);
            kept.into_iter().map(|k| drawn[k]).collect::<Vec<_>>()
        };
        let clouds = [points, few].map(select);
        let of_selected = distances([&clouds[0], &self.truth], [&clouds[1], &self.truth[..few]])?;
        Ok([
            RowScore::new(perfect, of_perfect),
            RowScore::new(selected, of_selected),
            RowScore::new(floor, of_floor),
        ])
    }
}

/// `count` of the points, or all where there are fewer, drawn without replacement, in random order.
pub(super) fn subset(count: usize, points: &[[f32; 3]], rng: &mut impl Rng) -> Vec<[f32; 3]> {
    let count = count.min(points.len());
    index::sample(rng, points.len(), count)
        .iter()
        .map(|k| points[k])
        .collect()
}

/// CD of one pair of clouds, earth mover's distances of another.
pub(super) fn distances(
    [cloud, truth]: [&[[f32; 3]]; 2],
    [few_of_cloud, few_of_truth]: [&[[f32; 3]]; 2],
) -> Result<Distances, MetricError> {
    let emd = emd(few_of_cloud, few_of_truth)?;
    let emd_squared = emd_squared(few_of_cloud, few_of_truth)?;
    Ok(Distances {
        cd: chamfer(cloud, truth)?,
        emd: emd.value,
        emd_gap: emd.gap,
        emd_squared: emd_squared.value,
        emd_squared_gap: emd_squared.gap,
    })
}

/// How uncertain a prediction is, and how well that tells its distance from the true cloud.
fn uncertainty(
    prediction: &Prediction,
    truth: &[[f32; 3]],
) -> Result<Option<UncertaintyScore>, MetricError> {
    let Some(values) = prediction.uncertainty(&[]) else {
        return Ok(None);
    };
    let values: Vec<f64> = values.into_iter().map(f64::from).collect();
    let distances = nearest_distances(&prediction.points, truth)?;
    let pairs = values.iter().zip(&distances);
    let covered = pairs.filter(|(value, distance)| **distance <= 2.0 * **value);
    Ok(Some(UncertaintyScore {
        coverage: covered.count() as f64 / values.len() as f64,
        mean: values.iter().sum::<f64>() / values.len() as f64,
        rank_correlation: rank_correlation(&values, &distances),
    }))
}
