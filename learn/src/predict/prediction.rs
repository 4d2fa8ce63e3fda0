//! A predicted cloud.

use tdcr_sim::cloud::PointCloud;

use crate::metrics::surface_spread;

/// A predicted cloud.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Prediction {
    /// Positions, world frame (m).
    pub points: Vec<[f32; 3]>,
    /// Colours of the points, 8-bit RGB; `None` where positions alone are predicted.
    pub colors: Option<Vec<[u8; 3]>>,
    /// Evaluations of a network that it took; 0 where no network predicts.
    pub evaluations: usize,
    /// What the spread of its points is multiplied by, to be their uncertainty: a trained model finds it in validation
    /// ([`Model::uncertainty_factor`](crate::train::Model::uncertainty_factor)). `None` where it is not known: 1.
    pub uncertainty_factor: Option<f32>,
}

impl Prediction {
    /// How uncertain the network is of each point (m): how far the prediction spreads, normal to its surface, over the
    /// 16 points about it ([`surface_spread`]), times [`uncertainty_factor`](Self::uncertainty_factor). With that factor, of
    /// the points of unseen commands 95 % are no farther than twice their uncertainty from the true cloud.
    ///
    /// A robot's surface has no thickness. Where a network is sure of it, all noise of the prior is carried to it, and
    /// where it is not, points come to lie before and behind it. The points are those of this prediction and of
    /// `others`, of the same command with other seeds. A network whose points move alone (the MLP) draws a point's
    /// noise as it draws a cloud's, so that one prediction is as many samples as it has points, and `others` may be
    /// empty; clouds of the Hybrid may also differ as a whole.
    ///
    /// Larger where predictions are worse, but no bound on the error: a network may be sure and wrong, which the factor makes
    /// good on average alone. Edges of the robot, and few points, make it larger. `None` where there are fewer than 16 points, or one is not finite.
    pub fn uncertainty(&self, others: &[Self]) -> Option<Vec<f32>> {
        let pool: Vec<_> = (std::iter::once(self).chain(others))
            .flat_map(|prediction| &prediction.points)
            .copied()
            .collect();
        let spread = surface_spread(&self.points, &pool).ok()?;
        let factor = self.uncertainty_factor.unwrap_or(1.0);
        Some(spread.into_iter().map(|spread| factor * spread).collect())
    }

    /// Its points `which`.
    pub(crate) fn keep(self, which: &[usize]) -> Self {
        Self {
            points: which.iter().map(|&k| self.points[k]).collect(),
            colors: (self.colors).map(|colors| which.iter().map(|&k| colors[k]).collect()),
            ..self
        }
    }

    /// The cloud; points without colours of their own get `color`.
    pub fn into_cloud(self, color: [u8; 3]) -> PointCloud {
        let Self { points, colors, .. } = self;
        let colors = colors.unwrap_or_else(|| vec![color; points.len()]);
        PointCloud { points, colors }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_that_are_kept_keep_their_colours_and_their_order() {
        let prediction = Prediction {
            points: (0..5).map(|k| [k as f32, 0.0, 0.0]).collect(),
            colors: Some((0..5).map(|k| [k, 0, 0]).collect()),
            evaluations: 7,
            uncertainty_factor: Some(3.0),
        };
        let kept = prediction.keep(&[1, 2, 4]);
        assert_eq!(kept.points, [1.0, 2.0, 4.0].map(|x| [x, 0.0, 0.0]));
        assert_eq!(kept.colors, Some([1, 2, 4].map(|k| [k, 0, 0]).to_vec()));
        assert_eq!(kept.evaluations, 7);
    }

    #[test]
    fn the_uncertainty_is_the_spread_times_the_factor() {
        let wavy = |k: usize| {
            [
                k as f32 * 0.01,
                (k * k % 7) as f32 * 0.01,
                (k % 3) as f32 * 0.001,
            ]
        };
        let plain = Prediction {
            points: (0..40).map(wavy).collect(),
            ..Prediction::default()
        };
        let spread = plain.uncertainty(&[]).expect("40 points");
        let factored = Prediction {
            uncertainty_factor: Some(2.5),
            ..plain
        };
        let uncertainty = factored.uncertainty(&[]).expect("40 points");
        assert!(spread.iter().all(|spread| *spread > 0.0));
        assert_eq!(
            uncertainty,
            spread.iter().map(|x| 2.5 * x).collect::<Vec<_>>()
        );
    }
}
