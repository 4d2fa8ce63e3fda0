//! A predicted cloud.

use tdcr_sim::cloud::PointCloud;

use crate::metrics::surface_spread;

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

    /// The cloud; points without colours of their own get `color`.
    pub fn into_cloud(self, color: [u8; 3]) -> PointCloud {
        let Self { points, colors, .. } = self;
        let colors = colors.unwrap_or_else(|| vec![color; points.len()]);
        PointCloud { points, colors }
    }
}
