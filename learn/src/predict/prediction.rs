//! A predicted cloud.

use tdcr_sim::cloud::PointCloud;

use crate::metrics::{isolation, surface_spread};

/// A predicted cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// Positions, world frame (m).
    pub points: Vec<[f32; 3]>,
    /// Colours of the points, 8-bit RGB; `None` where positions alone are predicted.
    pub colors: Option<Vec<[u8; 3]>>,
    /// Evaluations of a network that it took; 0 where no network predicts.
    pub evaluations: usize,
}

impl Prediction {
    /// How uncertain the network is of each point (m): how far the prediction spreads, normal to its surface, over the
    /// 16 points about it ([`surface_spread`]).
    ///
    /// A robot's surface has no thickness. Where a network is sure of it, all noise of the prior is carried to it, and
    /// where it is not, points come to lie before and behind it. The points are those of this prediction and of
    /// `others`, of the same command with other seeds. A network whose points move alone (the MLP) draws a point's
    /// noise as it draws a cloud's, so that one prediction is as many samples as it has points, and `others` may be
    /// empty; clouds of the Hybrid may also differ as a whole.
    ///
    /// Larger where predictions are worse, but no bound on the error: a network may be sure and wrong. Edges of the
    /// robot, and few points, make it larger. `None` where there are fewer than 16 points, or one is not finite.
    pub fn uncertainty(&self, others: &[Self]) -> Option<Vec<f32>> {
        let pool: Vec<_> = (std::iter::once(self).chain(others))
            .flat_map(|prediction| &prediction.points)
            .copied()
            .collect();
        surface_spread(&self.points, &pool).ok()
    }

    /// Indices, in order, of the `count` points that are the least alone ([`isolation`]); of all where there are no more, of the
    /// first where there are too few to tell. Points that a network brought to no surface have few others about them.
    pub fn least_isolated(&self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.points.len()).collect();
        if self.points.len() > count
            && let Ok(isolation) = isolation(&self.points)
        {
            order.sort_by(|&a, &b| isolation[a].total_cmp(&isolation[b]));
        }
        order.truncate(count);
        order.sort_unstable();
        order
    }

    /// Its points `which`.
    pub(crate) fn keep(self, which: &[usize]) -> Self {
        Self {
            points: which.iter().map(|&k| self.points[k]).collect(),
            colors: (self.colors).map(|colors| which.iter().map(|&k| colors[k]).collect()),
            evaluations: self.evaluations,
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
    fn points_off_the_surface_are_left_out_first() {
        // A plane of 20 x 20 points, and five points above it, one after each 80.
        let plane = (0..400).map(|k| [(k % 20) as f32 * 0.001, (k / 20) as f32 * 0.001, 0.0]);
        let mut points: Vec<[f32; 3]> = plane.collect();
        for k in 0..5 {
            points.insert(81 * k + 40, [0.01, 0.002 + 0.003 * k as f32, 0.002]);
        }
        let colors = (0..405).map(|k| [k as u8, (k / 256) as u8, 0]).collect();
        let prediction = Prediction {
            points,
            colors: Some(colors),
            evaluations: 7,
        };
        // Those at the plane's edges are alone as well; the outliers are the most so.
        let which = prediction.least_isolated(380);
        let kept = prediction.clone().keep(&which);
        assert_eq!((kept.points.len(), kept.evaluations), (380, 7));
        assert!(kept.points.iter().all(|point| point[2] == 0.0));
        // Points keep their colours and their order.
        let index = |color: &[u8; 3]| usize::from(color[0]) + 256 * usize::from(color[1]);
        let kept_colors = kept.colors.expect("colours");
        let order: Vec<usize> = kept_colors.iter().map(index).collect();
        assert!(order.is_sorted());
        for (point, k) in kept.points.iter().zip(order) {
            assert_eq!(*point, prediction.points[k]);
        }
        assert_eq!(prediction.least_isolated(405), (0..405).collect::<Vec<_>>());
    }
}
